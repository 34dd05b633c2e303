"""A solution as pictures and pages play it: transit, approach, release, retreat.

Joints go straight between the points of a trajectory.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.types import Array

LinkPoses = Callable[[Mapping[str, float]], Mapping[str, pin.SE3]]

CARRIED = ("transit", "approach")
"""Stages in which the object is in the hand."""
RELEASE_DURATION = 0.6
"""Seconds that opening the hand is shown for; a real hand has its own."""


@dataclass(frozen=True, slots=True, eq=False)
class JointCurve:
    """Joint positions over time.

    Attributes:
        joints: (dof) names.
        times: (n,) seconds, increasing from 0 on.
        positions: (n, dof) rad or m.
    """

    joints: tuple[str, ...]
    times: Array
    positions: Array

    @classmethod
    def of(cls, message: Any) -> JointCurve:
        """Of a JointTrajectory with points.

        Raises:
            ValueError: its points do not fit its joints, or are not finite, or not in order.
        """
        points, joints = message.points, tuple(message.joint_names)
        times = np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in points])
        positions = np.array([p.positions for p in points], dtype=np.float64)
        if positions.shape != (len(points), len(joints)):
            raise ValueError(f"its points do not fit its {len(joints)} joints")
        if not np.isfinite(positions).all() or (np.diff(times) < 0.0).any():
            raise ValueError("its points are not finite, or not in order")
        return cls(joints, times, positions)

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self.times[-1])

    def at(self, time: float) -> dict[str, float]:
        """Position of each joint."""
        values = (np.interp(time, self.times, column) for column in self.positions.T)
        return dict(zip(self.joints, map(float, values), strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class PlaybackMoment:
    """One moment of a motion.

    Attributes:
        stage: transit, approach, release or retreat.
        positions: of the joints, rad or m.
        T_world_object: where the object is, in the planning frame.
    """

    stage: str
    positions: Mapping[str, float]
    T_world_object: pin.SE3


@dataclass(frozen=True, slots=True, eq=False)
class Playback:
    """How an arm puts down what it holds.

    What holds the object follows from the motion's end, where the object is at the placement.

    Attributes:
        link_poses: T_planning_link of every link at joint values, rad or m.
        tip: link that the object is fixed to.
        start: joint values before, rad or m.
        carry: the way to the placement.
        approach_start: seconds into it at which the straight way down begins.
        opened: joint values that open the hand.
        retreat: the way back with the hand open; None where there is none.
        T_world_placed: where the object comes to stand.
        T_tip_object: how the hand holds the object.
    """

    link_poses: LinkPoses
    tip: str
    start: Mapping[str, float]
    carry: JointCurve
    approach_start: float
    opened: Mapping[str, float]
    retreat: JointCurve | None
    T_world_placed: pin.SE3
    T_tip_object: pin.SE3 = field(init=False)

    @classmethod
    def of(
        cls,
        solution: Any,
        link_poses: LinkPoses,
        tip: str,
        start: Mapping[str, float],
        opened: Mapping[str, float],
    ) -> Self:
        """Of a client's solution, whose trajectory has points.

        Raises:
            ValueError: see `JointCurve.of`.
        """
        retreat = solution.retreat_trajectory
        return cls(
            link_poses,
            tip,
            start,
            JointCurve.of(solution.trajectory),
            solution.approach_start,
            opened,
            JointCurve.of(retreat) if retreat is not None and retreat.points else None,
            pose_of(solution.pose.pose),
        )

    def __post_init__(self) -> None:
        end = {**self.start, **self.carry.at(self.carry.duration)}
        T_world_tip = self.link_poses(end)[self.tip]
        object.__setattr__(self, "T_tip_object", T_world_tip.actInv(self.T_world_placed))

    @property
    def duration(self) -> float:
        """Seconds from the start to the end of the retreat."""
        return self.carry.duration + self._release + (self.retreat.duration if self.retreat else 0)

    @property
    def _release(self) -> float:
        return RELEASE_DURATION if self.opened else 0.0

    def at(self, time: float) -> PlaybackMoment:
        """The moment so many seconds after the start; before and after it all is at rest."""
        time = float(np.clip(time, 0.0, self.duration))
        if time <= self.carry.duration:
            positions = {**self.start, **self.carry.at(time)}
            T_world_tip = self.link_poses(positions)[self.tip]
            stage = "approach" if time >= self.approach_start else "transit"
            return PlaybackMoment(stage, positions, T_world_tip * self.T_tip_object)
        closed = {**self.start, **self.carry.at(self.carry.duration)}
        time -= self.carry.duration
        if self.retreat is None or time <= self._release:
            share = min(1.0, time / self._release) if self._release else 1.0
            now = {
                name: closed.get(name, 0.0) + share * (value - closed.get(name, 0.0))
                for name, value in self.opened.items()
            }
            return PlaybackMoment("release", {**closed, **now}, self.T_world_placed)
        positions = {**closed, **self.opened, **self.retreat.at(time - self._release)}
        return PlaybackMoment("retreat", {**positions, **self.opened}, self.T_world_placed)

    def path(self, count: int = 60) -> Array:
        """(count, 3) where the object's origin is carried along, evenly in time."""
        times = np.linspace(0.0, self.carry.duration, count)
        return np.array([self.at(time).T_world_object.translation for time in times])


def pose_of(message: Any) -> pin.SE3:
    """A pose from a geometry_msgs/Pose; see `pose_of_numbers`."""
    p, r = message.position, message.orientation
    return pose_of_numbers([p.x, p.y, p.z, r.x, r.y, r.z, r.w])


def pose_of_numbers(values: Sequence[float]) -> pin.SE3:
    """A pose from x y z qx qy qz qw, metres; the quaternion need not be of unit length.

    Not finite where the quaternion is zero or a number is not finite.

    Raises:
        ValueError: they are not seven, or one is no number.
    """
    numbers = np.array(values, dtype=np.float64)
    # people round quaternions
    numbers[3:] /= np.linalg.norm(numbers[3:])
    return pin.XYZQUATToSE3(numbers)
