"""Pictures that the demonstration leaves: before and after, the motion, the objective over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from matplotlib.figure import Figure

from placement_planner_ros.client import Solution
from placement_planner_ros.demo.processes import DemoError
from placement_planner_ros.demo.setting import Setting
from placement_planner_ros.pictures.animation import draw_animation, draw_before_and_after
from placement_planner_ros.pictures.stage import Leg, Stage
from placement_planner_ros.playback import Playback
from placement_planner_ros.progress import ProgressLine

Searches = Sequence[tuple[Setting, Sequence[Solution]]]
"""What was put down, one after the other, and what was found for each, the best last."""


@contextmanager
def writing_to(folder: Path) -> Iterator[None]:
    """Files are written there meanwhile.

    Raises:
        DemoError: they cannot be.
    """
    try:
        yield
    except OSError as error:
        raise DemoError(
            f"nothing can be written to {folder}: {error.strerror or error}",
            "make room on the disk, or name another folder with --output",
        ) from error


def write_pictures(still: Path, moving: Path, searches: Searches, line: ProgressLine) -> None:
    """Draw what was put down."""
    line.show("  drawing the picture", always=True)
    first, _ = searches[0]
    # both hands, as either may be the one
    hands = [link for arm in first.arms.values() for link in arm.touch_links]
    legs = [_leg_of(setting, found[-1]) for setting, found in searches]
    stage = Stage(first.scene, first.robot, hands, legs)
    things = ", ".join(leg.name for leg in legs)
    draw_before_and_after(still, stage, f"{first.scene.name.replace('_', ' ')}, {things}")
    line.show("  drawing the animation", always=True)
    draw_animation(
        moving, stage, lambda done, count: line.show(f"  drawing: {done} of {count} frames")
    )
    line.clear()


def write_objective_plot(path: Path, searches: Searches, objective: str) -> None:
    """Draw the objective of the best placement over the seconds of each search."""
    figure = Figure(figsize=(6.0, 3.5), layout="constrained")
    axes = figure.subplots()
    for setting, found in searches:
        times, values = [each.search_time for each in found], [each.objective for each in found]
        # each is the best one until the next has come
        axes.step(times, values, "o-", where="post", label=setting.name)
    axes.set(xlabel="seconds since the start", ylabel=objective, xlim=(0.0, None))
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=120)


def _leg_of(setting: Setting, best: Solution) -> Leg:
    """The solution's motion, from where the robot of the setting stands."""
    robot, arm = setting.robot, setting.arms[best.arm]
    motion = Playback.of(
        best,
        lambda positions: {
            arm.tip_frame: robot.link_pose(robot.configuration(positions), arm.tip_frame)
        },
        arm.tip_frame,
        setting.positions,
        dict(zip(arm.gripper_joints, arm.gripper_open, strict=True)),
    )
    return Leg(setting.name, setting.corners, motion)
