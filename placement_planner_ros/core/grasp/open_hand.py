"""Release and retreat: the hand opens, then leaves the placed object along a straight line.

Links of the hand that touch the object, when it has opened, may do so until they have come off it,
and for the first `PARTING_M` of the way at the longest; what has come off must not meet it again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.arm import (
    PLACED_OBJECT,
    ArmCollision,
    CollisionSettings,
    Meeting,
)
from placement_planner_ros.core.collision.attached_object import PlacedObject
from placement_planner_ros.core.grasp.hand_sweep import with_opening_hand
from placement_planner_ros.core.grasp.settings import LONGEST_RETREAT_M, PARTING_M, GraspSettings
from placement_planner_ros.core.reach.ik import InverseKinematics
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.robot.model import Arm
from placement_planner_ros.core.robot.moving_arm import MovingArm
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array

_TOUCHING_M = 1e-3
"""m; a touch link of the open hand that is closer to the object than this touches it still."""

_STATIONS = (0.001, 0.002, PARTING_M)
"""m of the retreat at which links that touch the object still are looked at again."""

_BISECTIONS = 20

EdgeFree = Callable[[Array, Array, Array], bool]


class _Leaving:
    """The arm, its hand open, while it leaves the object it held in one grasp.

    Attributes:
        touching: touch links that touch the object when the hand has opened. They may do so until
            they have come off, and no longer than for the first `PARTING_M` of the way; all other
            links must not meet it.
    """

    def __init__(self, open_: ArmCollision, touching: frozenset[str]) -> None:
        self._open = open_
        self.touching = touching
        self._without: dict[frozenset[str], ArmCollision] = {}
        self._only = {link: _link_alone(open_, link, open_.settings) for link in touching}

    def without(self, links: frozenset[str]) -> ArmCollision:
        """The arm, where these links may touch the object."""
        if links not in self._without:
            self._without[links] = self._open.with_pairs(
                lambda a, b: PLACED_OBJECT not in (a, b) or not links & {a, b}
            )
        return self._without[links]

    def still(self, links: frozenset[str], q: Array, reserve: float) -> frozenset[str]:
        """Those of the links that have not come off the object at q (dof,)."""
        return frozenset(link for link in links if not self._only[link].free(q, reserve))


def _link_alone(open_: ArmCollision, link: str, settings: CollisionSettings) -> ArmCollision:
    """The link against the placed object, and nothing else."""
    return open_.with_pairs(lambda a, b: {a, b} == {link, PLACED_OBJECT}, settings, False)


class OpenHand:
    """One arm a with its hand open or opening, the object standing where it was placed.

    Shared by the arm's grasps; not to be shared between threads.

    Args:
        moving: the arm, its hand closed on the object.
        body: the object o.
    """

    def __init__(
        self,
        moving: MovingArm,
        body: Body,
        obstacles: ObstacleSet,
        settings: GraspSettings,
    ) -> None:
        robot, arm, collision = moving.robot, moving.arm, settings.collision
        # The arm with its hand open, and with what it sweeps by opening.
        opened = moving.with_open_hand()
        self._settings = settings.retreat
        self._reserve = collision.planning_reserve
        self._ik = InverseKinematics(Chain.from_robot(robot, arm, opened.q_rest), settings.ik)
        sweeping = replace(moving, robot=with_opening_hand(robot, arm, moving.q_rest))
        self._opening = ArmCollision(sweeping, None, obstacles, collision)
        # Every link is paired with the object, then those pairs are left out that do not count.
        touching_nothing = replace(opened, arm=replace(arm, touch_links=()))
        standing = PlacedObject(body, pin.SE3.Identity())
        self._open = ArmCollision(touching_nothing, standing, obstacles, collision)
        self._parted = self._open.with_pairs(
            lambda a, b: PLACED_OBJECT in (a, b),
            replace(collision, self_margin=collision.collision_margin),
            environment=False,
        )
        # What leaves the object in each grasp.
        tip = Chain.from_robot(robot, arm, moving.q_rest).forward(np.zeros(arm.dof))
        self._leaving = [self._leaving_grasp(arm, pin.SE3(tip) * grasp) for grasp in arm.grasps]
        self._placed: pin.SE3 | None = None
        # The directions of the retreat, of unit length.
        self._directions = [
            (np.array(direction) / np.linalg.norm(direction), in_tip)
            for in_tip, directions in (
                (True, settings.retreat.tip_directions),
                (False, settings.retreat.world_directions),
            )
            for direction in directions
        ]

    def release_free(self, q: Array) -> bool:
        """Whether the fingers, as they open at q (dof,), keep the margins all the way."""
        return self._opening.free(q, self._reserve)

    def release_meeting(self, q: Array) -> Meeting | None:
        """What the fingers meet as they open at q (dof,); None where nothing."""
        return self._opening.meeting(q, self._reserve)

    def retreat_meeting(self, q: Array, grasp: int, T_world_object: pin.SE3) -> Meeting | None:
        """What the open hand meets first on its own way back from q (dof,), along the tip's z.

        None where nothing, or where the arm cannot follow that way at all.
        """
        self._place(T_world_object)
        # The way back along the tip's z, in steps.
        settings = self._settings
        steps = max(1, round(settings.retreat_distance / settings.retreat_step))
        T_world_tip = self._ik.chain.forward(q)
        poses = np.repeat(T_world_tip[None], steps, axis=0)
        along = settings.retreat_distance / steps * np.arange(1, steps + 1)
        poses[:, :3, 3] -= along[:, None] * T_world_tip[:3, 2]
        # Follow it until something is met.
        leaving = self._leaving[grasp].without(frozenset())
        way = q
        for pose in poses[along >= PARTING_M]:
            tracked = self._ik.track(pose[None], way)
            if tracked is None:
                return None
            way = tracked[-1]
            found = leaving.meeting(way, self._reserve)
            if found is not None:
                return found
        return None

    def retreat(self, q: Array, grasp: int, T_world_object: pin.SE3) -> Array | None:
        """(m, dof) certified waypoints straight away from the object, from q on; None without.

        Args:
            grasp: index into the arm's grasps.
            T_world_object: x, where the object stands.
        """
        self._place(T_world_object)
        T_world_tip = self._ik.chain.forward(q)
        # The first direction in which a way is found.
        for direction, in_tip in self._directions:
            if in_tip:
                direction = T_world_tip[:3, :3] @ direction
            way = self._way(q, grasp, T_world_tip, direction)
            if way is not None:
                return way
        return None

    def edge_free(self, grasp: int, T_world_object: pin.SE3, way: Array) -> EdgeFree:
        """(a, b, deviation) -> whether the open hand leaves the object there on that motion.

        Args:
            way: (m, dof) what `retreat` returned, which the motion is along.
        """
        # How far the tip must have gone before each link has to be off.
        leaving, chain = self._leaving[grasp], self._ik.chain
        start = chain.forward(way[0])[:3, 3]
        self._place(T_world_object)
        stages = self._stages(leaving, way)

        def gone(q: Array) -> float:
            return float(np.linalg.norm(chain.forward(q)[:3, 3] - start))

        def leaves(a: Array, b: Array, deviation: Array) -> bool:
            self._place(T_world_object)
            # Nothing touches: one stage for the whole way.
            if len(stages) == 1:
                return stages[0][1].edge_free(a, b, deviation=deviation)
            # The part of the motion within each stage.
            near, far = (a, b) if gone(a) <= gone(b) else (b, a)
            for end, arm in stages:
                if gone(near) >= end:
                    continue
                last = far if gone(far) <= end else _configuration_between(near, far, gone, end)
                if not arm.edge_free(near, last, deviation=deviation):
                    return False
                if last is far:
                    break
                near = last
            return True

        return leaves

    def _stages(self, leaving: _Leaving, way: Array) -> list[tuple[float, ArmCollision]]:
        """How far along the way (m, dof) of the placed object's which arm counts, metres."""
        touching, stages = leaving.touching, []
        if touching:
            for end, q in zip(_STATIONS, way[1:], strict=False):
                stages.append((end, leaving.without(touching)))
                touching = leaving.still(touching, q, self._reserve)
        return [*stages, (np.inf, leaving.without(frozenset()))]

    def _place(self, T_world_object: pin.SE3) -> None:
        if self._placed is None or self._placed != T_world_object:
            self._open.place(T_world_object)
            self._placed = pin.SE3(T_world_object)

    def _way(self, q: Array, grasp: int, T_world_tip: Array, direction: Array) -> Array | None:
        settings, leaving = self._settings, self._leaving[grasp].without(frozenset())
        # The way on which links come off, if they touch.
        steps = max(1, round(settings.retreat_distance / settings.retreat_step))
        step = settings.retreat_distance / steps
        way = self._parting(q, grasp, T_world_tip, direction)
        if way is None:
            return None
        # Where links had to come off first, the way has gone on for as long as that may take.
        done = int(PARTING_M / step + 1e-9) if len(way) > 1 else 0
        first = done
        # Go on until the whole hand is off, or for as long as a retreat may be.
        while done == first or not self._parted.free(way[-1], self._reserve):
            further = np.arange(done + 1, max(steps, done + 1) + 1)
            if further[-1] * step > LONGEST_RETREAT_M + 1e-9:
                return None
            # Follow the line, and certify states and edges.
            tracked = self._ik.track(
                _poses_along(T_world_tip, direction, step * further.astype(float)), way[-1]
            )
            if tracked is None or not leaving.free_batch(tracked, self._reserve).all():
                return None
            ends = np.vstack([way[-1:], tracked])
            if not all(leaving.edge_free(*e, reserve=self._reserve) for e in pairwise(ends)):
                return None
            way = np.vstack([way, tracked])
            done = int(further[-1])
        return way

    def _parting(self, q: Array, grasp: int, T_world_tip: Array, direction: Array) -> Array | None:
        """(k, dof) the way from q on, on which links come off that touch the object still."""
        leaving = self._leaving[grasp]
        touching = leaving.touching
        if not touching:
            return q[None]
        # Follow the line from station to station; links that came off must stay off.
        tracked = self._ik.track(_poses_along(T_world_tip, direction, np.array(_STATIONS)), q)
        if tracked is None:
            return None
        way = np.vstack([q[None], tracked])
        for a, b in pairwise(way):
            if not leaving.without(touching).edge_free(a, b, reserve=self._reserve):
                return None
            touching = leaving.still(touching, b, self._reserve)
        return None if touching else way

    def _leaving_grasp(self, arm: Arm, T_world_object: pin.SE3) -> _Leaving:
        """The arm while it leaves an object held there with all joints at zero."""
        step(f"looking what of arm {arm.name} leaves the object")
        self._open.place(T_world_object)
        # Links that touch the object with the hand open.
        near = replace(self._open.settings, self_margin=_TOUCHING_M)
        zero = np.zeros(arm.dof)
        touching = {
            link for link in arm.touch_links if not _link_alone(self._open, link, near).free(zero)
        }
        return _Leaving(self._open, frozenset(touching))


def _poses_along(T_world_tip: Array, direction: Array, distances: Array) -> Array:
    """(n, 4, 4) the pose moved by distances (n,) along a direction (3,)."""
    poses = np.repeat(T_world_tip[None], len(distances), axis=0)
    poses[:, :3, 3] += distances[:, None] * direction
    return poses


def _configuration_between(
    near: Array, far: Array, gone: Callable[[Array], float], end: float
) -> Array:
    """Where on the straight motion from `near` to `far` (dof,) the tip has gone `end` metres, or
    just less."""
    # Bisect, keeping the end that has not gone too far.
    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if gone(near + middle * (far - near)) <= end else (low, middle)
    return np.asarray(near + low * (far - near))
