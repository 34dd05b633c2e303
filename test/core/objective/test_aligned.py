"""aligned beside the checker's, which computes it from true outlines of any form."""

import functools

import numpy as np
import pytest
from checker import Task, Tolerances
from checker.aligned import aligned_bounds
from helpers.problems import problem_of

from benchmarks.cases import Case
from placement_planner_ros.core.objective.aligned import Aligned
from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.primitives import ConvexPrimitive, box, frustum, standing_box
from placement_planner_ros.scenes.scenes import Scene

GREY = (0.5, 0.5, 0.5)
FLOOR = box("floor", (-0.4, -0.4, -0.02), (0.4, 0.4, 0.0), GREY)
HALF = 0.5 * np.ptp(object_by_name("small_crayons_box").vertices, axis=0)
STRAIGHT_ONES = ("bin", "two at equal distance")
"""Scenes with places where outlines run in one direction, or square to it."""


def wall(name, size, centre, yaw):
    return standing_box(name, size, centre, yaw, 0.0, GREY)


def bin_of(yaw, lid):
    """Four walls 2 cm thick, turned, 0.2 by 0.16 inside, and a board over all of it."""
    c, s = np.cos(yaw), np.sin(yaw)

    def turned(x, y):
        return (c * x - s * y, s * x + c * y)

    walls = [
        wall("left", (0.24, 0.02, 0.12), turned(0.0, 0.09), yaw),
        wall("right", (0.24, 0.02, 0.12), turned(0.0, -0.09), yaw),
        wall("front", (0.02, 0.16, 0.12), turned(0.11, 0.0), yaw),
        wall("back", (0.02, 0.16, 0.12), turned(-0.11, 0.0), yaw),
    ]
    board = standing_box("board", (0.24, 0.2, 0.02), (0.0, 0.0), yaw, lid, GREY)
    return (FLOOR, *walls, board)


SCENES = {
    "bin": bin_of(0.3, 0.11),
    "tin": (FLOOR, frustum("tin", (0.04, 0.04), (0.0, 0.1), GREY)),
    "post": (FLOOR, wall("post", (0.03, 0.03, 0.1), (0.0, 0.0), 0.5)),
    "two at equal distance": (
        FLOOR,
        wall("one", (0.2, 0.05, 0.1), (0.0, 0.1), 0.0),
        wall("other", (0.2, 0.05, 0.1), (0.0, -0.1), 0.4),
    ),
}


class Beside:
    """The box of crayons in a scene, and the checker's task."""

    def __init__(self, name):
        body = problem_of(Case("table", "small_crayons_box", "maximize_clearance"))[0].body
        volume = TargetVolume(np.array([-0.4, -0.4, -0.05]), np.array([0.4, 0.4, 0.25]))
        parts: tuple[ConvexPrimitive, ...] = SCENES[name]
        cloud = complete_cloud(Scene(name, volume, parts))
        environment = Environment.from_points(cloud, volume)
        self.term = Aligned(ObjectiveContext(environment, volume, body))
        self.task = Task.of(Scene(name, volume, parts), object_by_name("small_crayons_box"))

    def value(self, T):
        return float(self.term.values(T[None])[0])

    def bounds(self, T):
        return aligned_bounds(self.task, T, Tolerances())


@pytest.fixture(scope="module")
def beside():
    return functools.cache(Beside)


def standing(x, y, angle):
    """(4, 4) the box as its mesh is, on z = 0, turned."""
    T = np.eye(4)
    T[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    T[:3, 3] = x, y, HALF[2]
    return T


@pytest.mark.parametrize("name", SCENES)
def test_planner_and_checker_agree_beside_outlines_of_any_form(beside, name):
    rng, scene = np.random.default_rng(0), beside(name)
    within = 0.05 if name == "bin" else 0.16
    widths = []
    for _ in range(8):
        T = standing(*rng.uniform(-within, within, 2), rng.uniform(-np.pi, np.pi))
        low, high = scene.bounds(T)
        assert low <= scene.value(T) <= high
        widths.append(high - low)
    assert min(widths) < (0.09 if name in STRAIGHT_ONES else 0.55)  # of 0.79


def test_it_changes_steadily_where_another_thing_becomes_the_nearest(beside):
    scene = beside("two at equal distance")
    values = [scene.value(standing(0.0, y, 0.0)) for y in np.linspace(-0.03, 0.03, 61)]
    assert values[0] == pytest.approx(-0.4, abs=0.1)
    assert values[-1] == pytest.approx(0.0, abs=0.1)
    assert np.abs(np.diff(values)).max() < 0.05
