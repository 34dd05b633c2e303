"""What is shown of a motion: each stage, from a side from which the object is seen."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.joint_curve import JointCurve
from placement_planner_ros.pictures.animation import (
    TITLE,
    draw_animation,
    draw_before_and_after,
    frames_and_speed,
)
from placement_planner_ros.pictures.picture import PLACED
from placement_planner_ros.pictures.stage_set import SIZE, Leg, StageSet, tube
from placement_planner_ros.playback import Playback
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.primitives import box
from placement_planner_ros.scenes.scenes import Scene
from placement_planner_ros.scenes.yumi import load_yumi, start_configuration, yumi_arm

OBJECT = object_by_name("small_crayons_box")
TO, BACK = (0.2, -0.1, 0.1, 0.3, 0.0, 0.2, 0.0), (0.0, 0.1, 0.0, -0.2, 0.0, 0.0, 0.0)
"""Radians that each joint turns on the way there, and back."""


ROBOT = load_yumi()
ARM = yumi_arm(ROBOT, "right", OBJECT.grasps["right"])


@pytest.fixture(scope="module")
def motion():
    start = start_configuration(OBJECT.name)
    at = ROBOT.configuration(start)[ARM.q_index]
    there = at + TO
    tip = ARM.tip_frame

    def link_poses(positions):
        return {tip: ROBOT.link_pose(ROBOT.configuration(positions), tip)}

    reached = {**start, **dict(zip(ARM.joints, there, strict=True))}
    return Playback(
        link_poses,
        tip,
        start,
        JointCurve(ARM.joints, np.array([0.0, 1.0, 2.0]), np.array([at, (at + there) / 2, there])),
        1.5,
        dict(zip(ARM.gripper_joints, ARM.gripper_open, strict=True)),
        JointCurve(ARM.joints, np.array([0.0, 1.0]), np.array([there, there + BACK])),
        link_poses(reached)[tip] * ARM.grasps[0],
    )


def shown_in(motion, *sides):
    leg = Leg.played("crayons", OBJECT.vertices, OBJECT.triangles, ROBOT, motion)
    return StageSet(around(motion, *sides), ROBOT, ARM.touch_links, [leg])


def around(motion, *sides):
    """A scene with walls on some sides of all that the object passes."""
    path = motion.path()
    low, high = path.min(axis=0) - 0.1, path.max(axis=0) + 0.1
    low[2], high[2] = low[2] - 0.3, high[2] + 0.3
    walls = {
        "+x": ((high[0], low[1], low[2]), (high[0] + 0.02, high[1], high[2])),
        "-x": ((low[0] - 0.02, low[1], low[2]), (low[0], high[1], high[2])),
        "+y": ((low[0], high[1], low[2]), (high[0], high[1] + 0.02, high[2])),
        "-y": ((low[0], low[1] - 0.02, low[2]), (high[0], low[1], high[2])),
    }
    placed = motion.T_world_placed.translation
    volume = TargetVolume(placed - 0.1, placed + 0.1)
    return Scene("walled", volume, tuple(box(s, *walls[s], (0.8, 0.7, 0.5)) for s in sides))


@pytest.mark.parametrize("free", ["+x", "-y"])
def test_the_view_is_from_where_nothing_stands_before_the_object(motion, free):
    sides = [side for side in ("+x", "-x", "+y", "-y") if side != free]
    shown = shown_in(motion, *sides)
    toward = shown.view.eye - motion.T_world_placed.translation
    axis = {"x": 0, "y": 1}[free[1]]
    assert np.sign(toward[axis]) == (1.0 if free[0] == "+" else -1.0)
    assert abs(toward[axis]) > abs(toward[1 - axis])


def test_the_object_is_seen_where_it_stands_in_the_end(motion):
    shown = shown_in(motion)
    colours = shown.draw(0, shown.legs[0].looks[-1]).colours
    u, v, _ = shown.view.project(motion.T_world_placed.translation[None])[0]
    seen = colours[int(v), int(u)]
    np.testing.assert_allclose(seen / seen.max(), np.array(PLACED) / max(PLACED), atol=0.02)


def test_a_tube_keeps_its_radius():
    points = np.column_stack([np.linspace(0, 1, 9), np.zeros(9), np.linspace(0, 2, 9)])
    made = tube(points, 0.03, (1.0, 0.0, 0.0))
    along = points[-1] / np.linalg.norm(points[-1])
    off = made.vertices - np.outer(made.vertices @ along, along)
    np.testing.assert_allclose(np.linalg.norm(off, axis=1), 0.03)
    assert made.triangles.max() < len(made.vertices)


def test_pictures_show_before_and_after_and_all_of_the_motion(motion, tmp_path):
    motion = replace(
        motion,
        carry=replace(motion.carry, times=0.3 * motion.carry.times),
        approach_start=0.3 * motion.approach_start,
        retreat=replace(motion.retreat, times=0.3 * motion.retreat.times),
    )
    shown = shown_in(motion)
    still, moving = tmp_path / "still.png", tmp_path / "moving.gif"
    draw_before_and_after(still, shown, "title")
    draw_animation(moving, shown)
    halves = np.asarray(Image.open(still).convert("RGB"), dtype=float)
    left, right = halves[120:-90, : SIZE[0] - 10], halves[120:-90, -SIZE[0] + 10 :]
    assert np.abs(left - right).max(axis=2).mean() > 2.0
    animation = Image.open(moving)
    assert animation.size == (SIZE[0], SIZE[1] + TITLE)
    assert moving.stat().st_size < 3_000_000
    assert animation.n_frames >= motion.duration / 0.1
    played = 0.0
    for frame in range(animation.n_frames):
        animation.seek(frame)
        played += animation.info["duration"] / 1000.0
    assert motion.duration < played < motion.duration + 4.0


def test_long_motions_are_shown_faster_and_short_ones_in_real_time():
    assert frames_and_speed(4.0, 90) == (51, 1.0)
    count, speed = frames_and_speed(60.0, 90)
    assert count <= 90
    assert (count - 1) * 0.08 * speed == pytest.approx(60.0)
