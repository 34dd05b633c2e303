"""Noisy clouds with few points in 27 cells: tables are smoothed, low relief is not."""

import numpy as np
import pytest

from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import TargetVolume

VOLUME = TargetVolume([-0.2, -0.2, -0.05], [0.2, 0.2, 0.05])
NOISE = 0.0005
CORNERS = np.array([(x, y, 0.0) for x in (-0.04, 0.04) for y in (-0.04, 0.04)])
TOLERANCE, MARGIN = 0.003, 0.003


def voxel_filtered(height, leaf, seed=0, noise=NOISE):
    """(n, 3) a random one of the noisy points in each voxel, of a surface of height(x, y)."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(*[np.arange(-0.3, 0.3, 0.002) + 0.0003] * 2)
    x, y = x.ravel(), y.ravel()
    points = np.column_stack([x, y, height(x, y)]) + rng.normal(0.0, noise, (len(x), 3))
    points = points[rng.permutation(len(points))]
    _, first = np.unique(np.floor(points / leaf + 0.37), axis=0, return_index=True)
    return points[first]


def table(x, y):
    return np.zeros_like(x)


def carried(points):
    """Share of 400 squares of 8 cm on the table that carry at all corners and meet no box."""
    environment = Environment.from_points(points, VOLUME, beyond_volume=False)
    rng = np.random.default_rng(1)
    places = rng.uniform(-0.15, 0.15, (400, 1, 2))
    corners = np.tile(CORNERS, (400, 1, 1))
    corners[..., :2] += places
    held = environment.support.supported(corners.reshape(-1, 3), TOLERANCE, MARGIN)
    held = held.reshape(400, 4).all(axis=1)
    measured = environment.measured
    boxes = np.flatnonzero(measured.tops() > TOLERANCE)  # what is no support is in the way
    for k in np.flatnonzero(held):
        low, up = corners[k, 0, :2], corners[k, 3, :2]
        inside = (measured.upper[boxes, :2] > low) & (measured.lower[boxes, :2] < up)
        held[k] = not inside.all(axis=1).any()
    return held.mean()


@pytest.mark.parametrize(("leaf", "least"), [(0.008, 0.8), (0.01, 0.5)])
def test_a_table_thinned_by_a_voxel_filter_carries(leaf, least):
    obstacles = ObstacleSet.from_points(voxel_filtered(table, leaf))
    assert obstacles.noise == pytest.approx(NOISE, rel=0.15)
    assert np.abs(obstacles.points[:, 2]).std() < 0.4 * NOISE
    assert carried(voxel_filtered(table, leaf)) > least


def test_noise_that_could_hide_what_is_low_is_not_smoothed():
    obstacles = ObstacleSet.from_points(voxel_filtered(table, 0.01, noise=0.002))
    assert obstacles.noise == 0.0


def ribs(x, y):
    return np.where((y + 0.3) % 0.045 < 0.006, 0.003, 0.0)


def coins(x, y):
    away = [np.hypot(x - a, y - b) for a in np.arange(-0.2, 0.21, 0.1) for b in (-0.1, 0.0, 0.1)]
    return np.where(np.min(away, axis=0) < 0.0115, 0.0025, 0.0)


@pytest.mark.parametrize("relief", [ribs, coins])
@pytest.mark.parametrize("leaf", [0.008, 0.01])
def test_on_low_relief_hardly_anything_stands(relief, leaf):
    assert carried(voxel_filtered(relief, leaf)) < 0.15


@pytest.mark.parametrize(("width", "pitch"), [(0.005, 0.03), (0.006, 0.035)])
def test_a_grating_is_no_floor(width, pitch):
    def bars(x, y):
        return np.where((y + 0.3) % pitch < width, 0.0, -0.03)

    assert carried(voxel_filtered(bars, 0.01)) < 0.02


def test_a_clean_thinned_cloud_is_taken_as_it_is():
    points = voxel_filtered(table, 0.008, noise=0.0)
    obstacles = ObstacleSet.from_points(points)
    assert obstacles.noise == 0.0
    assert obstacles.barred is None
    assert len(obstacles.points) == len(points)
    assert not obstacles.points[:, 2].any()


def test_nothing_stands_on_what_is_in_doubt_and_it_stays_so_with_full_cells():
    obstacles = ObstacleSet.from_points(voxel_filtered(coins, 0.01))
    assert obstacles.barred.any()
    more = obstacles.with_full_cells(np.array([[0, 0, 0]], np.int32))
    assert more.barred.sum() == obstacles.barred.sum()
