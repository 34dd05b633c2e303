"""Release and retreat: the hand opens, then leaves the placed object along a straight line.

Links of the hand that touch the object when it has opened may do so for the first `PARTING_M` of
the way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.arm import (
    PLACED_OBJECT,
    ArmCollision,
    CollisionSettings,
)
from placement_planner_ros.core.collision.attached_object import PlacedObject
from placement_planner_ros.core.errors import GraspError
from placement_planner_ros.core.grasp.hand_sweep import with_opening_hand
from placement_planner_ros.core.grasp.settings import LONGEST_RETREAT_M, PARTING_M, GraspSettings
from placement_planner_ros.core.reach.ik import InverseKinematics
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.robot.moving_arm import MovingArm
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array

_TOUCHING_M = 1e-3
"""m; a touch link of the open hand that is closer to the object than this touches it still."""
_BISECTIONS = 20
_STATION_ROUNDING_M = 1e-9

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
        self,
        moving: MovingArm,
        body: Body,
        obstacles: ObstacleSet,
        settings: GraspSettings,
    ) -> None:
        robot, arm, collision = moving.robot, moving.arm, settings.collision
        # The arm with its hand open, and with what it sweeps by opening.
        opened = moving.with_open_hand()
        self._arm, self._body, self._room = arm, body, settings.room
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

    def leaving_error(self, grasp: int) -> GraspError | None:
        """What the hand meets on each of its straight ways off the object; None where one is clear.

        Only the hand and the object are looked at, wherever these come to be. What is refused here
        no placement could have: whatever stands around, and whatever the arm does, each way of
        `retreat` leads a link of the hand through the object, or too close past it.
        """
        # The links of the hand against the placed object, and nothing else.
        hand = self._open.hand_links
        alone = self._open.with_pairs(
            lambda a, b: PLACED_OBJECT in (a, b) and bool(hand & {a, b}), environment=False
        )
        T_object = pin.SE3(self._T_tip_zero) * self._arm.grasps[grasp]
        stations = self._stations(PARTING_M)
        met: list[tuple[float, str]] = []
        for words, direction in self._named_directions(T_object):
            step(f"looking whether the hand of arm {self._arm.name} can leave the object")
            # To move the object the other way is the same.
            for station in stations.tolist():
                self._place(pin.SE3(T_object.rotation, T_object.translation - station * direction))
                found = alone.meeting(np.zeros(self._arm.dof), self._reserve)
                if found is not None:
                    link = found.first if found.second == PLACED_OBJECT else found.second
                    met.append((station, f"{words}, where {link} is nearer after {station:.3f} m"))
                    break
            else:
                return None
        # In words: the first way and the furthest.
        furthest = max(met, key=lambda each: each[0])
        told = met[0][1]
        if furthest != met[0]:
            told += f", and at the furthest {furthest[1]}"
        return GraspError(
            f"{self._arm.name}.grasps[{grasp}]",
            pin.SE3ToXYZQUAT(self._arm.grasps[grasp]).round(4).tolist(),
            f"the open hand can leave the object in none of the {len(met)} directions that are "
            f"tried, {self._room:g} m from it: {told}; open the hand further (gripper_open), hold "
            "the object where the fingers do not close around it and the hand does not lie in it, "
            "check object.scale, or set require_retreat to false",
        )

    def retreat(self, q: Array, grasp: int, T_world_object: pin.SE3) -> Array | None:
        """(m, dof) certified waypoints straight away from the object, from q on; None without.

        Args:
            grasp: index into the arm's grasps.
            T_world_object: x, where the object stands.
        """
        self._place(T_world_object)
        T_world_tip = self._ik.chain.forward(q)
        # The first direction in which a way is found.
        for direction in _unit_vectors(self._settings.tip_directions):
            way = self._way(q, grasp, T_world_tip, T_world_tip[:3, :3] @ direction)
            if way is not None:
                return way
        for direction in _unit_vectors(self._settings.world_directions):
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
                parting, parted = self._parting[grasp], gone(far) > PARTING_M
                last = _configuration_between(near, far, gone) if parted else far
                if not parting.edge_free(near, last, deviation=deviation):
                    return False
                if not parted:
                    return True
                near = last
            return self._open.edge_free(near, far, deviation=deviation)

        return leaves

    def _place(self, T_world_object: pin.SE3) -> None:
        if self._placed is None or self._placed != T_world_object:
            self._open.place(T_world_object)
            self._placed = pin.SE3(T_world_object)

    def _stations(self, beyond: float) -> Array:
        """(n,) metres of the retreat at which there are waypoints, from `beyond` on."""
        settings = self._settings
        # Equal steps of the retreat, those before `beyond` left out.
        steps = max(1, round(settings.retreat_distance / settings.retreat_step))
        stations = settings.retreat_distance / steps * np.arange(1, steps + 1)
        return np.unique([beyond, *stations[stations > beyond + _STATION_ROUNDING_M]])

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
        stations = self._stations(begin)[1:]
        further = self._settings.retreat_step
        while way is not None and stations[-1] <= LONGEST_RETREAT_M + _STATION_ROUNDING_M:
            poses = _poses_along(T_world_tip, direction, stations)
            way = self._followed(way, self._open, poses)
            if way is not None and self._parted.free(way[-1], self._reserve):
                return way
            stations = stations[-1:] + further
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

    def _named_directions(self, T_object: pin.SE3) -> Iterator[tuple[str, Array]]:
        """Directions (3,) of the ways off an object at T_object with all joints at zero, in words;
        those in the world for each side that the object can stand on."""
        for direction in _unit_vectors(self._settings.tip_directions):
            yield (
                f"along {_numbers(direction)} in the tip frame",
                self._T_tip_zero[:3, :3] @ direction,
            )
        for direction in _unit_vectors(self._settings.world_directions):
            for number, face in enumerate(self._body.faces):
                words = f"along {_numbers(direction)} with the object standing on face {number}"
                R_object_face = face.T_face_object.rotation.T
                yield words, T_object.rotation @ R_object_face @ direction

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


def _unit_vectors(directions: tuple[tuple[float, float, float], ...]) -> list[Array]:
    return [np.array(each) / np.linalg.norm(each) for each in directions]


def _numbers(direction: Array) -> str:
    return f"({', '.join(f'{x:.3g}' for x in direction)})"


def _poses_along(T_world_tip: Array, direction: Array, distances: Array) -> Array:
    """(n, 4, 4) the pose moved by distances (n,) along a direction (3,)."""
    poses = np.repeat(T_world_tip[None], len(distances), axis=0)
    poses[:, :3, 3] += distances[:, None] * direction
    return poses


def _configuration_between(near: Array, far: Array, gone: Callable[[Array], float]) -> Array:
    """Where on the straight motion from `near` to `far` (dof,) the tip has gone `PARTING_M`, or
    just less."""
    # Bisect, keeping the end that has not gone too far.
    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        parted = gone(near + middle * (far - near)) > PARTING_M
        low, high = (low, middle) if parted else (middle, high)
    return np.asarray(near + low * (far - near))
