"""Where the frame of a cloud is: by parameter, by the robot's kinematics, or by tf2."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.point_cloud import FAR_M, some_of
from placement_planner_ros.ros.parameters.values import ParameterSet


class CloudFrameError(PlacementPlannerError):
    """Nobody knows where a cloud's frame is."""

    code = "CLOUD_FRAME"


OPTICAL = "optical_frame"
"""How the name of a camera's frame ends whose z looks forward, x right and y down (REP 103)."""

JointValues = Callable[[Sequence[str]], Mapping[str, float]]
"""Where joints were when a cloud was taken, rad or m. Raises a PlacementPlannerError where nobody
knows, or they have moved since."""


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
        CloudFrameError: the frame is empty, unknown, too far away, or on a link whose joints are
            unknown.
    """
    found = parameters.sensor_pose(frame)
    if found is None and frame == robot.root_link:
        found = pin.SE3.Identity()
    elif found is None and robot.has_link(frame):
        found = _link_pose(frame, robot, joints)
    elif found is None and frame:
        found = transform(frame)
    if found is None:
        words = "publish clouds with their frame's name"
        if frame in parameters["sensor_frames"]:
            words = f"sensor_frames declares it, but sensor_poses.{frame} is not set"
        elif frame:
            words = (
                "is neither a declared sensor frame (sensor_frames, sensor_poses.<frame>), nor the "
                f"planning frame {robot.root_link!r}, nor a link of the robot, nor known to tf2"
            )
        raise CloudFrameError("cloud frame_id", frame, words)
    if not np.abs(found.translation).max() <= FAR_M:
        raise CloudFrameError("cloud frame_id", frame, f"is more than {FAR_M:g} m away")
    return found


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
    some = some_of(points)
    # the share of points that lie before the sensor, along each axis of its frame
    ahead = ((some - T_planning_cloud.translation) @ T_planning_cloud.rotation > 0.0).mean(axis=0)
    # a camera sees what is before it, so more of it lies along the axis that looks forward
    if ahead[2] >= ahead[0]:
        return ""
    return (
        f"the points in {frame} lie along its x axis, as in the frame of a body: in an optical "
        "frame z looks forward, x right and y down (REP 103); publish them with the body's frame, "
        "or turned"
    )


def _link_pose(link: str, robot: Robot, joints: JointValues) -> pin.SE3:
    try:
        values = joints(robot.joints_to(link))
        q = robot.with_positions(np.zeros(len(robot.joint_names)), values)
        # values in other units would put the sensor anywhere
        robot.require_plausible(q, values)
        return robot.link_pose(q, link)
    except CloudFrameError:
        raise
    except PlacementPlannerError as error:
        raise CloudFrameError("cloud frame_id", link, f"is a link, and {error}") from error
