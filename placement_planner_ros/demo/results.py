"""Files that the demonstration leaves: a picture before and after, and an animation."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pinocchio as pin
from geometry_msgs.msg import Pose

from placement_planner_ros.client import Solution
from placement_planner_ros.demo.errors import DemoError
from placement_planner_ros.demo.search import Found
from placement_planner_ros.demo.setting import Setting
from placement_planner_ros.joint_curve import JointCurve
from placement_planner_ros.pictures.animation import (
    draw_animation,
    draw_before_and_after,
)
from placement_planner_ros.pictures.stage_set import Leg, StageSet
from placement_planner_ros.playback import Playback
from placement_planner_ros.progress import ProgressLine


def require_folder(folder: Path) -> None:
    """Make the folder and find out at once that nothing can be written there.

    Raises:
        DemoError: it cannot.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".probe"
        probe.write_bytes(bytes(5_000_000))
        probe.unlink()
    except OSError as error:
        raise unwritten(folder, error) from error


def require_physics() -> None:
    """Find out at once that a tour lacks something.

    Raises:
        DemoError: mujoco is not installed.
    """
    if find_spec("mujoco") is None:
        raise DemoError(
            "a tour is carried out by mujoco, which is not installed",
            "pip install 'placement_planner_ros[tour]'",
        )


def write_results(
    folder: Path, setting: Setting, found: Found, objective: str, line: ProgressLine
) -> list[tuple[Path, str]]:
    """Draw the best placement; each file with what it shows.

    Raises:
        DemoError: a file cannot be written.
    """
    best = found.improvements[-1]
    placement, motion = folder / "placement.png", folder / "motion.gif"
    try:
        line.show("  drawing the picture", always=True)
        body = setting.vertices, setting.triangles
        way, hand = playback_of(setting, best), setting.arm(best.arm).touch_links
        leg = Leg.played("the object", *body, setting.robot, way)
        shown = StageSet(setting.scene, setting.robot, hand, [leg])
        draw_before_and_after(
            placement, shown, f"{setting.title}: {objective} {best.objective:.4f}"
        )
        line.show("  drawing the animation", always=True)
        draw_animation(motion, shown)
    except OSError as error:
        raise unwritten(folder, error) from error
    line.clear()
    return [
        (placement, "before and after, with the way of the object"),
        (motion, "the whole motion, release and retreat included"),
    ]


def unwritten(folder: Path, error: OSError) -> DemoError:
    """What to say of a file that cannot be written."""
    return DemoError(
        f"nothing can be written to {folder}: {error.strerror or error}",
        "make room on the disk, or name another folder with --output",
    )


def playback_of(setting: Setting, best: Solution) -> Playback:
    """The solution's motion, from where the robot of the setting stands."""
    robot, arm = setting.robot, setting.arm(best.arm)
    retreat = best.retreat_trajectory
    start = zip(robot.joint_names, setting.q_start.tolist(), strict=True)
    return Playback(
        lambda positions: {
            arm.tip_frame: robot.link_pose(robot.configuration(positions), arm.tip_frame)
        },
        arm.tip_frame,
        dict(start),
        JointCurve.of(best.trajectory),
        best.approach_start,
        dict(zip(arm.gripper_joints, arm.gripper_open, strict=True)),
        None if retreat is None else JointCurve.of(retreat),
        pose_of(best.pose.pose),
    )


def pose_of(message: Pose) -> pin.SE3:
    """A pose that the node has published."""
    p, r = message.position, message.orientation
    return pin.XYZQUATToSE3(np.array([p.x, p.y, p.z, r.x, r.y, r.z, r.w]))
