"""What is shown of a motion: each stage, from a side from which the object is seen."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.pictures import animation
from placement_planner_ros.pictures.shapes import PLACED
from placement_planner_ros.pictures.stage import SIZE, Leg, Stage
from placement_planner_ros.playback import JointCurve, Playback
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.primitives import box
from placement_planner_ros.scenes.scenes import Scene
from placement_planner_ros.scenes.yumi import load_yumi, start_configuration, yumi_arm

OBJECT = object_by_name("small_crayons_box")
TO, BACK = (0.2, -0.1, 0.1, 0.3, 0.0, 0.2, 0.0), (0.0, 0.1, 0.0, -0.2, 0.0, 0.0, 0.0)
"""Radians that each joint turns on the way there, and back."""
OFF = np.array([0.1, -0.3, -0.2])

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


def shown_in(motion, *parts):
    placed = motion.T_world_placed.translation
    scene = Scene("walled", TargetVolume(placed - 0.1, placed + 0.1), parts)
    leg = Leg("crayons", OBJECT.vertices[OBJECT.triangles], motion)
    return Stage(scene, ROBOT, ARM.touch_links, [leg])


@pytest.mark.parametrize("walled", [False, True])
def test_the_object_is_seen_where_it_stands_whatever_is_before_it(motion, walled):
    placed = motion.T_world_placed.translation
    eye = shown_in(motion).view.T_world_camera.translation
    near = placed + 0.3 * (eye - placed)
    wall = box("wall", near - 0.08, near + 0.08, (0.8, 0.7, 0.5))
    shown = shown_in(motion, *([wall] if walled else []))
    colours = shown.draw(0, motion.duration).colours
    u, v, _ = shown.view.project(placed[None])[0]
    seen = colours[int(v), int(u)]
    if walled:
        around = colours[int(v) : int(v) + 2, int(u) : int(u) + 2]
        assert np.argmax(around.mean(axis=(0, 1))) == 1  # green through the wall
    else:
        np.testing.assert_allclose(seen / seen.max(), np.array(PLACED) / max(PLACED), atol=0.02)


def test_what_stands_aside_is_not_seen_through(motion):
    placed = motion.T_world_placed.translation
    colour = (0.0, 0.0, 1.0)
    beside = box("beside", placed + OFF, placed + OFF + 0.1, colour)
    shown = shown_in(motion, beside)
    u, v, _ = shown.view.project(beside.vertices.mean(axis=0)[None])[0].astype(int)
    around = shown.draw(0, 0.0).colours[v - 2 : v + 2, u - 2 : u + 2]
    assert (np.argmax(around, axis=2) == 2).all()


def test_pictures_show_before_and_after_and_all_of_the_motion(motion, tmp_path):
    motion = replace(
        motion,
        carry=replace(motion.carry, times=0.3 * motion.carry.times),
        approach_start=0.3 * motion.approach_start,
        retreat=replace(motion.retreat, times=0.3 * motion.retreat.times),
    )
    shown = shown_in(motion)
    still, moving = tmp_path / "still.png", tmp_path / "moving.gif"
    animation.draw_before_and_after(still, shown, "title")
    animation.draw_animation(moving, shown)
    halves = np.asarray(Image.open(still).convert("RGB"), dtype=float)
    left, right = halves[40:, : SIZE[0] - 10], halves[40:, -SIZE[0] + 10 :]
    assert np.abs(left - right).max(axis=2).mean() > 2.0
    drawn = Image.open(moving)
    assert drawn.size == (SIZE[0], SIZE[1] + animation.TITLE)
    assert moving.stat().st_size < 3_000_000
    assert drawn.n_frames >= motion.duration / 0.1
    played = 0.0
    for frame in range(drawn.n_frames):
        drawn.seek(frame)
        played += drawn.info["duration"] / 1000.0
    assert motion.duration < played < motion.duration + 4.0
