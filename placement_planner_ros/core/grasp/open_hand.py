"""Release and retreat: the hand opens, then leaves the placed object along a straight line.

Links of the hand that touch the object when it has opened may do so for the first `PARTING_M` of
the way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pinocchio as pin
from scipy.optimize import bisect

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.arm import PLACED_OBJECT, ArmCollision, CollisionSettings
from placement_planner_ros.core.collision.attached_object import PlacedObject
from placement_planner_ros.core.grasp.hand_opening import with_opening_hand
from placement_planner_ros.core.grasp.settings import LONGEST_RETREAT_M, GraspSettings
from placement_planner_ros.core.grasp.straight_down import UP
from placement_planner_ros.core.reach.ik import InverseKinematics
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.robot.arm import MovingArm
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array, Mask

PARTING_M = 0.003
"""m of the retreat, at the longest, on which links of the open hand may touch the object still."""
_TOUCHING_M = 1e-3
"""m; a touch link of the open hand that is closer to the object than this touches it still."""
_SIDEWAYS = ((0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0))
_TIP_DIRECTIONS = [
    np.array(direction) / np.linalg.norm(direction)
    for direction in (
        (0.0, 0.0, -1.0),
        *((x, y, -1.0) for x, y in _SIDEWAYS),
        *((x, y, 0.0) for x, y in _SIDEWAYS),
        (0.0, 0.0, 1.0),
    )
]
"""Of retreat, in the tip frame: back along z, slanting to each side, then sideways, and last
forward along z, as some hands point along their frame's -z. Up is tried after these."""

EdgeFree = Callable[[Array, Array, Array], bool]


class OpenHand:
    """One arm a with its hand open or opening, the object standing where it was placed.

    Shared by the arm's grasps; not to be shared between threads.

    Args:
        moving: the arm, its hand closed on the object.
        body: the object o.

    Attributes:
        touching: per grasp, touch links that touch the object when the hand has opened.
    """

    def __init__(
        self, moving: MovingArm, body: Body, obstacles: ObstacleSet, settings: GraspSettings
    ) -> None:
        robot, arm, collision = moving.robot, moving.arm, settings.collision
        # The arm with its hand open, and with what it sweeps by opening.
        opened = replace(moving, q_rest=robot.with_open_hand(moving.q_rest, arm))
        self._arm = arm
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
        # What touches the object in each grasp, and the arm but for that.
        self._T_tip_zero = Chain.from_robot(robot, arm, moving.q_rest).forward(np.zeros(arm.dof))
        self.touching = [self._touching_links(grasp) for grasp in range(len(arm.grasps))]
        self._parting = [self._without(links) for links in self.touching]
        self._placed: pin.SE3 | None = None

    def release_free(self, q: Array) -> bool:
        """Whether the fingers, as they open at q (dof,), keep the margins all the way."""
        return self._opening.free(q, self._reserve)

    def releases_free(self, T_world_tip: Array, slack: float) -> Mask:
        """(n,) False where it is certain that at no q with the tip at (n, 4, 4) `release_free`."""
        return self._opening.hands_free(T_world_tip, slack, self._reserve)

    def retreat(self, q: Array, grasp: int, T_world_object: pin.SE3) -> Array | None:
        """(m, dof) certified waypoints straight away from the object, from q on; None without.

        Args:
            grasp: index into the arm's grasps.
            T_world_object: x, where the object stands.
        """
        self._place(T_world_object)
        T_world_tip = self._ik.chain.forward(q)
        # The first direction in which a way is found.
        for direction in (*(T_world_tip[:3, :3] @ each for each in _TIP_DIRECTIONS), UP):
            way = self._way(q, grasp, T_world_tip, direction)
            if way is not None:
                return way
        return None

    def edge_free(self, grasp: int, T_world_object: pin.SE3, way: Array) -> EdgeFree:
        """(a, b, deviation) -> whether the open hand leaves the object there on that motion.

        Args:
            way: (m, dof) what `retreat` returned, which the motion is along.
        """
        chain = self._ik.chain
        start = chain.forward(way[0])[:3, 3]

        def gone(q: Array) -> float:
            return float(np.linalg.norm(chain.forward(q)[:3, 3] - start))

        def leaves(a: Array, b: Array, deviation: Array) -> bool:
            self._place(T_world_object)
            # From the end nearer to where the retreat begins.
            near, far = (a, b) if gone(a) <= gone(b) else (b, a)
            # The part of the motion on which links may touch.
            if self.touching[grasp] and gone(near) < PARTING_M:
                last = far
                if gone(far) > PARTING_M:
                    way = far - near
                    share = bisect(lambda k: gone(near + k * way) - PARTING_M, 0.0, 1.0)
                    last = near + share * way
                if not self._parting[grasp].edge_free(near, last, deviation=deviation):
                    return False
                if last is far:
                    return True
                near = last
            return self._open.edge_free(near, far, deviation=deviation)

        return leaves

    def _place(self, T_world_object: pin.SE3) -> None:
        if self._placed is None or self._placed != T_world_object:
            self._open.place(T_world_object)
            self._placed = pin.SE3(T_world_object)

    def _way(self, q: Array, grasp: int, T_world_tip: Array, direction: Array) -> Array | None:
        """(m, dof) certified waypoints along a direction (3,); None without."""
        way: Array | None = q[None]
        begin = 0.0
        # First what touches comes off.
        if self.touching[grasp]:
            begin = PARTING_M
            first = _poses_along(T_world_tip, direction, np.array([begin]))
            way = self._followed(q[None], self._parting[grasp], first)
        # Then all that the way takes, and on until the whole hand is off.
        settings = self._settings
        steps = max(1, round(settings.retreat_distance / settings.retreat_step))
        step_size = settings.retreat_distance / steps
        stations = step_size * np.arange(1, round(LONGEST_RETREAT_M / step_size) + 1)
        least = stations[:steps]
        for further in (least[least > begin], *stations[steps:, None]):
            if way is None:
                return None
            way = self._followed(way, self._open, _poses_along(T_world_tip, direction, further))
            if way is not None and self._parted.free(way[-1], self._reserve):
                return way
        return None

    def _followed(self, way: Array, arm: ArmCollision, poses: Array) -> Array | None:
        """A way (m, dof) continued along poses (n, 4, 4), states and edges certified."""
        # The states first, then the edges between them.
        tracked = self._ik.track(poses, way[-1])
        if tracked is None or not arm.free_batch(tracked, self._reserve).all():
            return None
        for a, b in pairwise((way[-1], *tracked)):
            if not arm.edge_free(a, b, reserve=self._reserve):
                return None
        return np.vstack([way, tracked])

    def _touching_links(self, grasp: int) -> frozenset[str]:
        """Touch links that touch the object held so, the hand open."""
        step(f"looking what of arm {self._arm.name} leaves the object")
        self._open.place(pin.SE3(self._T_tip_zero) * self._arm.grasps[grasp])
        # What is nearer than that touches.
        near = replace(self._open.settings, self_margin=_TOUCHING_M)
        return frozenset(link for link in self._arm.touch_links if self._touches(link, near))

    def _touches(self, link: str, near: CollisionSettings) -> bool:
        """Whether a link of the open hand is near to the placed object."""
        alone = self._open.with_pairs(
            lambda a, b: {a, b} == {link, PLACED_OBJECT}, near, environment=False
        )
        return not alone.free(np.zeros(self._arm.dof))

    def _without(self, links: frozenset[str]) -> ArmCollision:
        """The arm, where these links may touch the object."""
        return self._open.with_pairs(lambda a, b: PLACED_OBJECT not in (a, b) or not links & {a, b})


def _poses_along(T_world_tip: Array, direction: Array, distances: Array) -> Array:
    """(n, 4, 4) the pose moved by distances (n,) along a direction (3,)."""
    poses = np.repeat(T_world_tip[None], len(distances), axis=0)
    poses[:, :3, 3] += distances[:, None] * direction
    return poses
