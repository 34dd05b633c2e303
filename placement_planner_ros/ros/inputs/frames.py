"""Where the frame of a cloud is: by parameter, by the robot's kinematics, or by tf2."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.ros.inputs.point_cloud import FAR
from placement_planner_ros.ros.parameters.values import ParameterSet


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
    moved: Callable[[], pin.SE3] = pin.SE3.Identity,
) -> pin.SE3:
    """T_planning_cloud: by parameter, as the planning frame, by forward kinematics, by tf2.

    Args:
        joints: values when the cloud was taken.
        transform: T_planning_frame by tf2, None where it is not known there.
        moved: by what the robot was elsewhere when the cloud was taken.

    Raises:
        CloudFrameError: the frame is empty, unknown, too far away, or on a link whose joints or
            whose robot's place are unknown.
    """
    if not frame:
        raise CloudFrameError("cloud frame_id", frame, "publish clouds with their frame's name")
    T_planning_cloud = _pose(frame, parameters, robot, joints, transform, moved)
    if not np.abs(T_planning_cloud.translation).max() <= FAR:
        raise CloudFrameError("cloud frame_id", frame, f"is more than {FAR:g} m away")
    return T_planning_cloud


def _pose(
    frame: str,
    parameters: ParameterSet,
    robot: Robot,
    joints: JointValues,
    transform: Callable[[str], pin.SE3 | None],
    moved: Callable[[], pin.SE3],
) -> pin.SE3:
    given = parameters.sensor_pose(frame)
    if given is not None:
        return given
    if frame == robot.root_link:
        return pin.SE3.Identity()
    if robot.model.existFrame(frame, pin.FrameType.BODY):
        return _link_pose(frame, robot, joints, moved)
    found = transform(frame)
    if found is None and frame in parameters["sensor_frames"]:
        raise CloudFrameError(
            "cloud frame_id",
            frame,
            f"sensor_frames declares it, but sensor_poses.{frame} is not set",
        )
    if found is None:
        raise CloudFrameError(
            "cloud frame_id",
            frame,
            "is neither a declared sensor frame (sensor_frames, sensor_poses.<frame>), nor the "
            f"planning frame {robot.root_link!r}, nor a link of the robot, nor known to tf2",
        )
    return found


def _link_pose(
    link: str, robot: Robot, joints: JointValues, moved: Callable[[], pin.SE3]
) -> pin.SE3:
    try:
        values = joints(robot.joints_to(link))
        q = robot.with_positions(np.zeros(len(robot.joint_names)), values)
        robot.require_plausible(q, values)
        return moved() * robot.link_pose(q, link)
    except CloudFrameError:
        raise
    except PlacementPlannerError as error:
        raise CloudFrameError("cloud frame_id", link, f"is a link, and {error}") from error
