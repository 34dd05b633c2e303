"""Reaching a placement with one arm and one grasp: configurations and the straight approach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body import Body
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.feasibility import PoseConstraints
from placement_planner_ros.core.robot.collision import ArmCollision, CollisionSettings
from placement_planner_ros.core.robot.ik import InverseKinematics, IKSettings
from placement_planner_ros.core.robot.kinematics import Chain
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import Array, Verdict


@dataclass(frozen=True, slots=True)
class ApproachSettings:
    """The straight way down onto the support.

    Attributes:
        approach_distance: height of the raised pre-placement above contact, metres.
        approach_minimum: the least height it may shrink to where there is less room, metres.
        approach_step: distance between joint waypoints, metres.
    """

    approach_distance: float = 0.05
    approach_minimum: float = 0.01
    approach_step: float = 0.01

    def __post_init__(self) -> None:
        if not 0.0 < self.approach_minimum <= self.approach_distance:
            raise ParameterError(
                "approach_distance",
                self.approach_distance,
                f"must be at least approach_minimum ({self.approach_minimum} m)",
            )
        if not self.approach_step > 0.0:
            raise ParameterError("approach_step", self.approach_step, "must be above zero")


class Reach:
    """One arm a holding the object in one grasp g, the rest of the robot at rest.

    Attributes:
        q_start: (dof,) the arm's part of q_0.
        collision: C_free of this arm with the object in this grasp.
    """

    def __init__(
        self,
        robot: Robot,
        arm: Arm,
        grasp: int,
        body: Body,
        obstacles: ObstacleSet,
        q_robot: Array,
        collision: CollisionSettings,
        ik: IKSettings,
        approach: ApproachSettings,
    ) -> None:
        self.arm = arm
        self.grasp = grasp
        self.q_start: Array = np.asarray(q_robot[arm.q_index])
        self.chain = Chain.from_robot(robot, arm, q_robot)
        self.collision = ArmCollision(robot, arm, grasp, body, obstacles, q_robot, collision)
        self._ik = InverseKinematics(self.chain, ik)
        self._T_object_tip = arm.grasps[grasp].inverse()
        self._settings = approach

    def tip_pose(self, T_world_object: pin.SE3) -> Array:
        """(4, 4) T_world_tip that brings the object to that pose."""
        return np.asarray((T_world_object * self._T_object_tip).homogeneous)

    def object_pose(self, q: Array) -> pin.SE3:
        """O(q)."""
        return pin.SE3(self.chain.forward(q)) * self.arm.grasps[self.grasp]

    def configurations(self, T_world_object: pin.SE3, seeds: Array) -> Array:
        """(k, dof) distinct configurations with O(q) = x, the nearest to q_0 first."""
        T_world_tip = self.tip_pose(T_world_object)
        if not self._ik.reachable(T_world_tip):
            return np.empty((0, len(self.q_start)))
        found = self._ik.solve(T_world_tip, seeds)
        return np.asarray(found[np.argsort(np.abs(found - self.q_start).sum(axis=1))])

    def follow(self, T_world_object: pin.SE3, q: Array) -> Array | None:
        """The configuration (dof,) continuing from `q` that brings the object to that pose."""
        tracked = self._ik.track(self.tip_pose(T_world_object)[None], q)
        return None if tracked is None else np.asarray(tracked[-1])

    def free_at_contact(self, q: Array) -> bool:
        """q ∈ C_free with the object resting on its support."""
        return self.collision.edge_free(q, q, contact=True)

    def approach(
        self, q: Array, T_world_object: pin.SE3, contact_height: float, poses: PoseConstraints
    ) -> Array | Verdict:
        """The certified straight approach that ends in `q`, as high as there is room.

        Returns:
            (k, dof) joint waypoints, raised pre-placement first, or the verdict that names what
            stood in the way.
        """
        settings = self._settings
        steps = max(1, round(settings.approach_distance / settings.approach_step))
        heights = np.linspace(0.0, settings.approach_distance, steps + 1)[1:]
        heights = np.unique(np.append(heights, settings.approach_minimum))
        upward = [q]
        raised: list[Array] = []
        for height in heights:
            above = pin.SE3(T_world_object)
            above.translation = T_world_object.translation + np.array([0.0, 0.0, height])
            q_next = self.follow(above, upward[-1])
            if q_next is None or not poses.free(T_world_object, contact_height, float(height)):
                break
            if not self.collision.edge_free(upward[-1], q_next, contact=True):
                break
            upward.append(q_next)
            enough = height >= settings.approach_minimum - 1e-9
            if enough and self.collision.free(q_next):
                raised = list(upward)
        if not raised:
            return Verdict.NO_APPROACH
        return np.array(raised[::-1])
