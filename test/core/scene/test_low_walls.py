"""Noisy floors between walls that are hardly higher than a cell: trays, slots, rims."""

import numpy as np
import pytest

from placement_planner_ros.core.scene.environment import find_regions
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.planes import Planes
from placement_planner_ros.core.scene.regions import RegionSettings
from placement_planner_ros.core.types import TargetVolume

VOLUME = TargetVolume([-0.07, -0.024, -0.01], [0.07, 0.024, 0.01])
BOUNDS = (np.array([-0.3, -0.3, -0.2]), np.array([0.3, 0.3, 0.3]))
NOISE = 0.0015


def slot(rng, height=0.015, spacing=0.0025):
    """(n, 3) of a floor, and of the tops of walls around V and their inner sides."""
    x, y = np.meshgrid(*[np.arange(-0.2, 0.2, spacing)] * 2)
    xy = np.column_stack([x.ravel(), y.ravel()]) + rng.uniform(0.0, spacing, 2)
    beyond = (np.abs(xy) - VOLUME.upper[:2]).max(axis=1)
    top = (beyond > 0.0) & (beyond < 0.012)
    points = np.column_stack([xy, np.where(top, height, 0.0)])
    along = np.arange(-0.07, 0.07, spacing)
    for z in np.arange(0.002, height, spacing):
        for side in (-0.024, 0.024):
            wall = np.column_stack([along, np.full(len(along), side), np.full(len(along), z)])
            points = np.vstack([points, wall])
    return points + rng.normal(0.0, NOISE, points.shape)


@pytest.fixture(scope="module")
def obstacles():
    """Three, whose cells lie differently."""
    rng = np.random.default_rng(0)
    shifts = rng.uniform(0.0, 0.01, (3, 3))
    return [
        ObstacleSet.from_points(slot(rng), bounds=[corner + shift for corner in BOUNDS])
        for shift in shifts
    ]


def test_a_floor_carries_up_to_a_low_wall(obstacles):
    settings = RegionSettings()
    xy = np.random.default_rng(1).uniform(-1.0, 1.0, (3000, 2)) * (VOLUME.upper[:2] - 0.007)
    places = np.column_stack([xy, np.zeros(len(xy))])
    for each in obstacles:
        planes = Planes.of(each, VOLUME, settings)
        support = find_regions(each, VOLUME, settings, planes)[1]
        assert support.supported(places, 0.003, 0.003).mean() > 0.9


def test_the_tops_of_low_walls_and_the_floor_are_not_one_surface(obstacles):
    """Nothing is supported halfway up a wall, at whatever height it is asked for."""
    rng = np.random.default_rng(2)
    xy = rng.uniform(-1.0, 1.0, (3000, 2)) * 0.15
    places = np.column_stack([xy, rng.uniform(0.006, 0.009, len(xy))])
    for each in obstacles:
        support = find_regions(each, VOLUME)[1]
        assert support.supported(places, 0.003).mean() < 0.002
