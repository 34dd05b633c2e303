"""Where the frame of a cloud is: by parameter, by the robot's kinematics, or by tf2."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from builtin_interfaces.msg import Time as TimeMessage
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.ros.parameters.values import ParameterSet

WAIT = Duration(nanoseconds=100_000_000)


class CloudFrameError(PlacementPlannerError):
    """Nobody knows where a cloud's frame is."""

    code = "CLOUD_FRAME"


class ChainMovingError(CloudFrameError):
    """A cloud was taken while joints that move its sensor moved."""


JointValues = Callable[[Sequence[str]], Mapping[str, float]]
"""Where joints were when a cloud was taken, rad or m. Raises a PlacementPlannerError where nobody
knows."""


def cloud_pose(
    frame: str,
    parameters: ParameterSet,
    robot: Robot,
    joints: JointValues,
    transform: Callable[[str], pin.SE3 | None],
) -> pin.SE3:
    """T_planning_cloud: by parameter, as the planning frame, by forward kinematics, by tf2.

    Args:
        joints: values when the cloud was taken.
        transform: T_planning_frame by tf2, None where it is not known there.

    Raises:
        CloudFrameError: the frame is empty, unknown, or on a link whose joints are unknown.
    """
    if not frame:
        raise CloudFrameError("cloud frame_id", frame, "publish clouds with their frame's name")
    given = parameters.sensor_pose(frame)
    if given is not None:
        return given
    if frame == robot.root_link:
        return pin.SE3.Identity()
    if robot.model.existFrame(frame, pin.FrameType.BODY):
        fixed = robot.model.frames[robot.frame_id(frame)]
        if fixed.parentJoint == 0:
            return pin.SE3(fixed.placement)
        return _link_pose(frame, robot, joints)
    found = transform(frame)
    if found is None:
        raise CloudFrameError(
            "cloud frame_id",
            frame,
            "is neither a declared sensor frame (sensor_frames, sensor_poses.<frame>), nor the "
            f"planning frame {robot.root_link!r}, nor a link of the robot, nor known to tf2",
        )
    return found


def _link_pose(link: str, robot: Robot, joints: JointValues) -> pin.SE3:
    try:
        values = joints(robot.joints_to(link))
        q = robot.with_positions(np.zeros(len(robot.joint_names)), values)
        robot.require_plausible(q, values)
    except CloudFrameError:
        raise
    except PlacementPlannerError as error:
        raise CloudFrameError("cloud frame_id", link, f"is a moving link, and {error}") from error
    return robot.link_pose(q, link)


class Transforms:
    """Looks transforms up by tf2; knows none where tf2_ros is not installed.

    The wheels do not have it; a real Jazzy does.
    """

    def __init__(self, node: Node) -> None:
        self._buffer: Any = None
        if importlib.util.find_spec("tf2_ros") is not None:
            tf2_ros = importlib.import_module("tf2_ros")
            self._error = tf2_ros.TransformException
            self._buffer = tf2_ros.Buffer()
            self._listener = tf2_ros.TransformListener(self._buffer, node, spin_thread=True)

    def pose(self, target: str, source: str, stamp: TimeMessage | None = None) -> pin.SE3 | None:
        """T_target_source at the stamp (the newest without one), or None."""
        if self._buffer is None:
            return None
        time = Time() if stamp is None else Time.from_msg(stamp)
        try:
            found = self._buffer.lookup_transform(target, source, time, timeout=WAIT).transform
        except self._error:
            return None
        r, t = found.rotation, found.translation
        rotation = pin.Quaternion(np.array([r.x, r.y, r.z, r.w])).normalized().toRotationMatrix()
        return pin.SE3(rotation, np.array([t.x, t.y, t.z]))
