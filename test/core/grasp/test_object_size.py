"""An object in another unit is noticed beside hand and reach; one that fits is not."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from helpers.scans import SHAPES

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.grasp.object_size import hand_size, size_doubt, stretched_length
from placement_planner_ros.scenes.objects import OBJECT_NAMES, object_by_name
from placement_planner_ros.scenes.yumi import load_yumi, yumi_arm


@pytest.fixture(scope="module")
def yumi():
    robot = load_yumi()
    return robot, tuple(yumi_arm(robot, name) for name in ("left", "right"))


@functools.cache
def bodies():
    things = {name: object_by_name(name) for name in OBJECT_NAMES}
    made = {n: Body.from_mesh(t.vertices, t.triangles) for n, t in things.items()}
    shapes = {name: SHAPES[name]() for name in ("tall box", "bottle", "mug", "banana", "ball")}
    return made | {n: Body.from_mesh(s.vertices, s.faces) for n, s in shapes.items()}


@pytest.mark.parametrize(("factor", "word"), [(1.0, ""), (10.0, "large"), (0.1, "small")])
def test_ten_times_too_large_or_small_is_told(yumi, factor, word):
    robot, arms = yumi
    q = np.zeros(len(robot.joint_names))
    for name, body in bodies().items():
        doubt = size_doubt(robot, arms, q, replace(body, vertices=body.vertices * factor))
        assert bool(doubt) == bool(word), (name, doubt)
        assert not word or (f"the object is {word}" in doubt and "object.scale" in doubt)


def test_hand_and_reach_are_those_of_the_robot(yumi):
    robot, arms = yumi
    q = np.zeros(len(robot.joint_names))
    assert 0.1 < hand_size(robot, arms[0], q) < 0.2
    assert 0.5 < stretched_length(robot, arms[0]) < 1.2
