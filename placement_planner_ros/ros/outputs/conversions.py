"""Core types to messages. Pure functions."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from geometry_msgs.msg import Point, Pose, Quaternion
from rclpy.duration import Duration
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array, Trajectory


def trajectory_message(trajectory: Trajectory | None, key: str) -> JointTrajectory:
    """A trajectory to start at once (stamp 0); `key` goes into frame_id. Empty for None."""
    message = JointTrajectory(header=Header(frame_id=key))
    if trajectory is None:
        return message
    message.joint_names = list(trajectory.joints)
    message.points = [
        JointTrajectoryPoint(
            positions=trajectory.positions[row].tolist(),
            velocities=trajectory.velocities[row].tolist(),
            accelerations=trajectory.accelerations[row].tolist(),
            time_from_start=Duration(nanoseconds=round(float(time) * 1e9)).to_msg(),
        )
        for row, time in enumerate(trajectory.times)
    ]
    return message


def with_all_joints(trajectory: Trajectory, robot: Robot, q_start: Array) -> Trajectory:
    """The same motion naming every joint that is driven, the others held at q_start.

    Args:
        q_start: (nq,) configuration at which the other joints stay.
    """
    # joints that follow others, or that nothing drives, are not a controller's
    undriven = {*robot.mimics, *robot.passive}.difference(trajectory.joints)
    joints = tuple(name for name in robot.joint_names if name not in undriven)
    columns = [joints.index(name) for name in trajectory.joints]
    held = np.array([q_start[robot.index(name)] for name in joints])
    positions = np.tile(held, (len(trajectory.times), 1))
    velocities, accelerations = np.zeros_like(positions), np.zeros_like(positions)
    # the arm's joints move, the others keep their place at zero speed
    positions[:, columns] = trajectory.positions
    velocities[:, columns] = trajectory.velocities
    accelerations[:, columns] = trajectory.accelerations
    return Trajectory(joints, trajectory.times, positions, velocities, accelerations)


def pose_message(T: pin.SE3) -> Pose:
    """A pose, its quaternion of unit length."""
    px, py, pz = T.translation.tolist()
    x, y, z, w = pin.Quaternion(T.rotation).normalized().coeffs().tolist()
    return Pose(position=Point(x=px, y=py, z=pz), orientation=Quaternion(x=x, y=y, z=z, w=w))
