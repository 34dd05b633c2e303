"""aligned beside outlines of known form."""

import functools

import numpy as np
import pytest
from helpers.problems import problem_of

from benchmarks.cases import Case
from placement_planner_ros.core.objective.aligned import Aligned
from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.primitives import box, frustum, standing_box
from placement_planner_ros.scenes.scenes import Scene

GREY = (0.5, 0.5, 0.5)
FLOOR = box("floor", (-0.4, -0.4, -0.02), (0.4, 0.4, 0.0), GREY)
HALF = 0.5 * np.ptp(object_by_name("small_crayons_box").vertices, axis=0)
STRAIGHT = 0.07
"""rad: beside a straight outline."""


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


SCENES = {"bin": bin_of(0.3, 0.11), "tin": (FLOOR, frustum("tin", (0.04, 0.04), (0.0, 0.1), GREY))}


@functools.cache
def values_in(name):
    """Of a pose (4, 4) of the box of crayons in a scene."""
    body = problem_of(Case("table", "small_crayons_box", "maximize_clearance"))[0].body
    volume = TargetVolume(np.array([-0.4, -0.4, -0.05]), np.array([0.4, 0.4, 0.25]))
    cloud = complete_cloud(Scene(name, volume, SCENES[name]))
    term = Aligned(ObjectiveContext(Environment.from_points(cloud, volume), volume, body))
    return lambda T: float(term.values(T[None])[0])


def standing(x, y, angle):
    """(4, 4) the box as its mesh is, on z = 0, turned."""
    T = np.eye(4)
    T[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    T[:3, 3] = x, y, HALF[2]
    return T


@pytest.mark.parametrize("off", [0.0, 0.2, -0.4, 0.6])
def test_in_a_bin_under_a_board_it_is_the_angle_from_its_walls(off):
    value = values_in("bin")(standing(0.01, 0.02, 0.3 + off))
    assert value == pytest.approx(-abs(off), abs=STRAIGHT)


@pytest.mark.parametrize("angle", np.linspace(0.0, 6.0, 7))
def test_beside_a_tin_there_is_little_to_be_aligned_with(angle):
    T = standing(0.1 * np.cos(angle), 0.1 * np.sin(angle), 3.0 * angle)
    assert values_in("tin")(T) == pytest.approx(-np.pi / 8.0, abs=0.15)
