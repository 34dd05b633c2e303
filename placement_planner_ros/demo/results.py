"""Pictures that the demonstration leaves: before and after, the motion, the objective over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
from matplotlib.figure import Figure

from placement_planner_ros.client import Solution
from placement_planner_ros.demo.processes import DemoError
from placement_planner_ros.demo.setting import Setting
from placement_planner_ros.joint_curve import JointCurve
from placement_planner_ros.pictures.animation import draw_animation, draw_before_and_after
from placement_planner_ros.pictures.stage import Leg, Stage
from placement_planner_ros.playback import Playback
from placement_planner_ros.progress import ProgressLine


def require_folder(folder: Path) -> None:
    """Make the folder and find out at once that nothing can be written there.

    Raises:
        DemoError: it cannot.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # as large as the files will be together
        probe = folder / ".probe"
        probe.write_bytes(bytes(5_000_000))
        probe.unlink()
    except OSError as error:
        raise _unwritten(folder, error) from error


def write_pictures(
    still: Path, moving: Path, setting: Setting, legs: Sequence[Leg], title: str, line: ProgressLine
) -> list[tuple[Path, str]]:
    """Draw what was put down; each file with what it shows.

    Raises:
        DemoError: a file cannot be written.
    """
    line.show("  drawing the picture", always=True)
    # both hands, as either may be the one
    hands = [link for arm in setting.arms.values() for link in arm.touch_links]
    stage = Stage(setting.scene, setting.robot, hands, legs)
    try:
        draw_before_and_after(still, stage, title)
        line.show("  drawing the animation", always=True)
        draw_animation(
            moving, stage, lambda done, count: line.show(f"  drawing: {done} of {count} frames")
        )
    except OSError as error:
        raise _unwritten(still.parent, error) from error
    line.clear()
    return [
        (still, "before and after, with the way of the object"),
        (moving, "the whole motion, release and retreat included"),
    ]


def write_objective_plot(path: Path, found: Sequence[Solution], objective: str) -> tuple[Path, str]:
    """Draw the objective of the best placement over the seconds of the search; and what it shows.

    Raises:
        DemoError: the file cannot be written.
    """
    figure = Figure(figsize=(6.0, 3.5), layout="constrained")
    axes = figure.subplots()
    # each is the best one until the next has come
    axes.step(
        [each.search_time for each in found], [each.objective for each in found], "o-", where="post"
    )
    axes.set(xlabel="seconds since the start", ylabel=objective, xlim=(0.0, None))
    axes.grid(alpha=0.3)
    try:
        figure.savefig(path, dpi=120)
    except OSError as error:
        raise _unwritten(path.parent, error) from error
    return path, "the objective of the best placement over time"


def _unwritten(folder: Path, error: OSError) -> DemoError:
    """What to say of a file that cannot be written."""
    return DemoError(
        f"nothing can be written to {folder}: {error.strerror or error}",
        "make room on the disk, or name another folder with --output",
    )


def leg_of(name: str, setting: Setting, best: Solution) -> Leg:
    """The solution's motion, from where the robot of the setting stands."""
    robot, arm, retreat = setting.robot, setting.arms[best.arm], best.retreat_trajectory
    p, r = best.pose.pose.position, best.pose.pose.orientation
    motion = Playback(
        lambda positions: {
            arm.tip_frame: robot.link_pose(robot.configuration(positions), arm.tip_frame)
        },
        arm.tip_frame,
        dict(zip(robot.joint_names, setting.q_start.tolist(), strict=True)),
        JointCurve.of(best.trajectory),
        best.approach_start,
        dict(zip(arm.gripper_joints, arm.gripper_open, strict=True)),
        None if retreat is None else JointCurve.of(retreat),
        pin.XYZQUATToSE3(np.array([p.x, p.y, p.z, r.x, r.y, r.z, r.w])),
    )
    return Leg(name, setting.vertices[setting.triangles], motion)
