"""Release and retreat: the hand opens, then leaves the placed object along a straight line."""

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
    Meeting,
)
from placement_planner_ros.core.collision.load import Standing
from placement_planner_ros.core.grasp.hand_sweep import with_opening_hand
from placement_planner_ros.core.grasp.settings import LONGEST_RETREAT, GraspSettings
from placement_planner_ros.core.reach.ik import InverseKinematics
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.robot.model import Arm
from placement_planner_ros.core.robot.moving_arm import MovingArm
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array

_TOUCHING = 1e-3
"""m; a touch link of the open hand that is closer to the object than this touches it still."""

EdgeFree = Callable[[Array, Array, Array], bool]


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
        opened = moving.with_open_hand()
        self._settings = settings.retreat
        self._reserve = collision.planning_reserve
        self._ik = InverseKinematics(Chain.from_robot(robot, arm, opened.q_rest), settings.ik)
        sweeping = replace(moving, robot=with_opening_hand(robot, arm, moving.q_rest))
        self._opening = ArmCollision(sweeping, None, obstacles, collision)
        # Every link is paired with the object, then those pairs are left out that do not count.
        touching_nothing = replace(opened, arm=replace(arm, touch_links=()))
        standing = Standing(body, pin.SE3.Identity())
        self._open = ArmCollision(touching_nothing, standing, obstacles, collision)
        self._parted = self._open.with_pairs(
            lambda a, b: PLACED_OBJECT in (a, b),
            replace(collision, self_margin=collision.collision_margin),
            environment=False,
        )
        tip = Chain.from_robot(robot, arm, moving.q_rest).forward(np.zeros(arm.dof))
        self._leaving = [self._leaving_grasp(arm, pin.SE3(tip) * grasp) for grasp in arm.grasps]
        self._placed: pin.SE3 | None = None
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
        settings = self._settings
        steps = max(1, round(settings.retreat_distance / settings.retreat_step))
        T_world_tip = self._ik.chain.forward(q)
        poses = np.repeat(T_world_tip[None], steps, axis=0)
        along = settings.retreat_distance / steps * np.arange(1, steps + 1)
        poses[:, :3, 3] -= along[:, None] * T_world_tip[:3, 2]
        leaving = self._leaving[grasp]
        way = q
        for pose in poses:
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
        for direction, in_tip in self._directions:
            if in_tip:
                direction = T_world_tip[:3, :3] @ direction
            way = self._way(q, grasp, T_world_tip, direction)
            if way is not None:
                return way
        return None

    def edge_free(self, grasp: int, T_world_object: pin.SE3) -> EdgeFree:
        """(a, b, deviation) -> whether the open hand leaves the object there on that motion."""

        def leaves(a: Array, b: Array, deviation: Array) -> bool:
            self._place(T_world_object)
            return self._leaving[grasp].edge_free(a, b, deviation=deviation)

        return leaves

    def _place(self, T_world_object: pin.SE3) -> None:
        if self._placed is None or self._placed != T_world_object:
            self._open.place(T_world_object)
            self._placed = pin.SE3(T_world_object)

    def _way(self, q: Array, grasp: int, T_world_tip: Array, direction: Array) -> Array | None:
        settings, leaving = self._settings, self._leaving[grasp]
        steps = max(1, round(settings.retreat_distance / settings.retreat_step))
        step = settings.retreat_distance / steps
        way = q[None]
        while len(way) == 1 or not self._parted.free(way[-1], self._reserve):
            further = np.arange(len(way), max(steps, len(way)) + 1)
            if further[-1] * step > LONGEST_RETREAT + 1e-9:
                return None
            poses = np.repeat(T_world_tip[None], len(further), axis=0)
            poses[:, :3, 3] += (further * step)[:, None] * direction
            tracked = self._ik.track(poses, way[-1])
            if tracked is None or not leaving.free_batch(tracked, self._reserve).all():
                return None
            ends = np.vstack([way[-1:], tracked])
            if not all(leaving.edge_free(*e, reserve=self._reserve) for e in pairwise(ends)):
                return None
            way = np.vstack([way, tracked])
        return way

    def _leaving_grasp(self, arm: Arm, T_world_object: pin.SE3) -> ArmCollision:
        """The arm while it leaves an object held there with all joints at zero.

        Touch links that the open hand still touches it with may slide along it; those that have
        come off must not meet it again.
        """
        step(f"looking what of arm {arm.name} leaves the object")
        self._open.place(T_world_object)
        near = replace(self._open.settings, self_margin=_TOUCHING)

        def touches(link: str) -> bool:
            only = self._open.with_pairs(lambda a, b: {a, b} == {link, PLACED_OBJECT}, near, False)
            return not only.free(np.zeros(arm.dof))

        touching = {link for link in arm.touch_links if touches(link)}
        return self._open.with_pairs(
            lambda a, b: PLACED_OBJECT not in (a, b) or not touching & {a, b}
        )
