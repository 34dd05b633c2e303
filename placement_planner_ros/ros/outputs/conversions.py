"""Core types to messages. Pure functions."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array, Trajectory

_NANOSECONDS = 1_000_000_000


def time_message(nanoseconds: int) -> Time:
    """A time from nanoseconds since the epoch."""
    return Time(sec=nanoseconds // _NANOSECONDS, nanosec=nanoseconds % _NANOSECONDS)


def duration_message(seconds: float) -> Duration:
    """A duration, rounded to nanoseconds."""
    nanoseconds = round(seconds * _NANOSECONDS)
    return Duration(sec=nanoseconds // _NANOSECONDS, nanosec=nanoseconds % _NANOSECONDS)


def trajectory_message(trajectory: Trajectory | None, key: str) -> JointTrajectory:
    """A trajectory to start at once (stamp 0); `key` goes into frame_id. Empty for None."""
    message = JointTrajectory(header=Header(frame_id=key))
    if trajectory is None:
        return message
    message.joint_names = list(trajectory.joints)
    message.points = [
        JointTrajectoryPoint(
            positions=positions.tolist(),
            velocities=velocities.tolist(),
            accelerations=accelerations.tolist(),
            time_from_start=duration_message(float(time)),
        )
        for time, positions, velocities, accelerations in zip(
            trajectory.times,
            trajectory.positions,
            trajectory.velocities,
            trajectory.accelerations,
            strict=True,
        )
    ]
    return message


def with_all_joints(trajectory: Trajectory, robot: Robot, q_start: Array) -> Trajectory:
    """The same motion naming every joint that is driven, the others held at q_start.

    Args:
        q_start: (nq,) configuration at which the other joints stay.
    """
    undriven = {*robot.mimics, *robot.passive}.difference(trajectory.joints)
    joints = tuple(name for name in robot.joint_names if name not in undriven)
    columns = [joints.index(name) for name in trajectory.joints]
    held = np.array([q_start[robot.index(name)] for name in joints])
    positions = np.tile(held, (len(trajectory.times), 1))
    velocities, accelerations = np.zeros_like(positions), np.zeros_like(positions)
    positions[:, columns] = trajectory.positions
    velocities[:, columns] = trajectory.velocities
    accelerations[:, columns] = trajectory.accelerations
    return Trajectory(joints, trajectory.times, positions, velocities, accelerations)


def pose_message(T: pin.SE3) -> Pose:
    """A pose, its quaternion of unit length."""
    px, py, pz = T.translation.tolist()
    x, y, z, w = pin.Quaternion(T.rotation).normalized().coeffs().tolist()
    return Pose(position=Point(x=px, y=py, z=pz), orientation=Quaternion(x=x, y=y, z=z, w=w))


def stamped_pose(T: pin.SE3, frame: str, stamp: Time) -> PoseStamped:
    """A pose in a frame."""
    return PoseStamped(header=Header(frame_id=frame, stamp=stamp), pose=pose_message(T))
