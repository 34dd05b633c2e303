"""Where the frame of a cloud is: by parameter, by the robot's kinematics, or by tf2."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.point_cloud import FAR
from placement_planner_ros.ros.parameters.values import ParameterSet


class CloudFrameError(PlacementPlannerError):
    """Nobody knows where a cloud's frame is."""

    code = "CLOUD_FRAME"


class ChainMovingError(CloudFrameError):
    """A cloud was taken while joints that move its sensor moved."""


OPTICAL = "optical_frame"
"""How the name of a camera's frame ends whose z looks forward, x right and y down (REP 103)."""
_LOOKED_AT = 2000
"""Points at which is looked to tell which way the axes point."""
_FORWARD = 0.9
"""Share of a camera's points that lie before it, at least."""

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


def is_eye(frame: str, height: int, parameters: ParameterSet) -> bool:
    """Whether a sensor looks from the frame's origin: its lines of sight begin there.

    Args:
        height: of the cloud; more than 1 where it is organised.
    """
    return frame in parameters["sensor_frames"] or (height > 1 and frame.endswith(OPTICAL))


def turned_axes(frame: str, points: Array, T_planning_cloud: pin.SE3) -> str:
    """In words, where an optical frame's points (n, 3), planning frame, lie as in a body's frame.

    '' where they do not.
    """
    if not frame.endswith(OPTICAL) or not len(points):
        return ""
    some = points[:: max(1, len(points) // _LOOKED_AT)]
    ahead = ((some - T_planning_cloud.translation) @ T_planning_cloud.rotation > 0.0).mean(axis=0)
    if ahead[2] >= _FORWARD or ahead[0] < _FORWARD:
        return ""
    return (
        f"the points in {frame} lie along its x axis, as in the frame of a body: in an optical "
        "frame z looks forward, x right and y down (REP 103); publish them with the body's frame, "
        "or turned"
    )


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
