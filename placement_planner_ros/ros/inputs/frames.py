"""Where the frame of a cloud is."""

from __future__ import annotations

from collections.abc import Callable

import pinocchio as pin

from placement_planner_ros.core.errors import JointStateError, PlacementPlannerError
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.ros.parameters.values import ParameterSet


class CloudFrameError(PlacementPlannerError):
    """Nobody knows where a cloud's frame is."""

    code = "CLOUD_FRAME"


def cloud_pose(
    frame: str,
    parameters: ParameterSet,
    robot: Robot,
    positions: dict[str, float],
    transform: Callable[[str], pin.SE3 | None],
) -> pin.SE3:
    """T_planning_cloud: by parameter, as the planning frame, by forward kinematics, by tf2.

    Args:
        positions: newest joint values, rad or m.
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
        try:
            return robot.link_pose(robot.configuration(positions), frame)
        except JointStateError as error:
            raise CloudFrameError(
                "cloud frame_id", frame, f"is a moving link, and {error}"
            ) from error
    found = transform(frame)
    if found is None:
        raise CloudFrameError(
            "cloud frame_id",
            frame,
            "is neither a declared sensor frame (sensor_frames, sensor_poses.<frame>), nor the "
            f"planning frame {robot.root_link!r}, nor a link of the robot, nor known to tf2",
        )
    return found
