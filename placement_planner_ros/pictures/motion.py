"""A placement as a motion in time: carrying, the way down, letting go and drawing back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.joint_curve import JointCurve

OPENING = 0.6
"""Seconds that opening the hand takes in pictures; a real hand has its own."""


@dataclass(frozen=True, slots=True, eq=False)
class MotionMoment:
    """One moment of a motion.

    Attributes:
        stage: what is being done, for people.
        q: (nq,) of the robot.
        T_world_object: where the object is.
    """

    stage: str
    q: Array
    T_world_object: pin.SE3


@dataclass(frozen=True, slots=True, eq=False)
class RecordedMotion:
    """How an arm puts down what it holds.

    Attributes:
        q_start: (nq,) where the robot stands at first.
        T_tip_object: the grasp.
        T_world_placed: where the object comes to stand.
        carry: the way to the placement.
        approach_start: seconds into it at which the way down begins.
        retreat: the way back with the hand open; None where there is none.
    """

    robot: Robot
    arm: Arm
    q_start: Array
    T_tip_object: pin.SE3
    T_world_placed: pin.SE3
    carry: JointCurve
    approach_start: float
    retreat: JointCurve | None

    @property
    def duration(self) -> float:
        """Seconds from the start to the end of the retreat."""
        return self.carry.duration + self._opening + (self.retreat.duration if self.retreat else 0)

    @property
    def _opening(self) -> float:
        return OPENING if self.arm.gripper_joints else 0.0

    def at(self, time: float) -> MotionMoment:
        """The moment so many seconds after the start; before and after it all is at rest."""
        time = float(np.clip(time, 0.0, self.duration))
        if time <= self.carry.duration:
            q = self.robot.with_positions(self.q_start, self.carry.at(time))
            T = self.robot.link_pose(q, self.arm.tip_frame) * self.T_tip_object
            return MotionMoment("way down" if time >= self.approach_start else "carry", q, T)
        q = self.robot.with_positions(self.q_start, self.carry.at(self.carry.duration))
        opened = self.robot.with_open_hand(q, self.arm)
        time -= self.carry.duration
        if self.retreat is None or time <= self._opening:
            share = min(1.0, time / self._opening) if self._opening else 1.0
            return MotionMoment("let go", q + share * (opened - q), self.T_world_placed)
        q = self.robot.with_positions(opened, self.retreat.at(time - self._opening))
        return MotionMoment("draw back", q, self.T_world_placed)

    def path(self, step: float = 0.02) -> Array:
        """(n, 3) where the object's origin is carried along, a point every `step` seconds."""
        times = np.linspace(0.0, self.carry.duration, max(2, round(self.carry.duration / step)))
        return np.array([self.at(time).T_world_object.translation for time in times])
