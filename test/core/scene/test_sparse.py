"""Clouds whose points are a cell apart: what they carry where rays tell, and where none do."""

from types import SimpleNamespace

import numpy as np
import pytest

from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.freespace import View
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.ros.run.surroundings import environment_notes

VOLUME = TargetVolume([-0.2, -0.2, -0.05], [0.2, 0.2, 0.05])
NOISE = 0.0005
CORNERS = np.array([(x, y, 0.0) for x in (-0.04, 0.04) for y in (-0.04, 0.04)])
SNAPSHOT = SimpleNamespace(
    parameters={"unknown_space": "free", "contact_tolerance": 0.003}, parts=()
)
TOLERANCE, MARGIN = 0.003, 0.003
SENSOR = np.array([0.05, -0.1, 1.0])
FLOOR = np.tile([1.5, 0.0, -0.7], (12, 1))


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


def carried(points, sensor=None, floor=FLOOR):
    """Share of 400 squares of 8 cm on the table that carry at all corners.

    Args:
        floor: (n, 3) what the sensor sees beside the table.
    """
    sights = () if sensor is None else [View(np.vstack([points, floor]), sensor)]
    environment = Environment.from_points(points, VOLUME, sights=sights, beyond_volume=False)
    places = np.random.default_rng(1).uniform(-0.15, 0.15, (400, 1, 2))
    corners = np.tile(CORNERS, (400, 1, 1))
    corners[..., :2] += places
    held = environment.support.supported(corners.reshape(-1, 3), TOLERANCE, MARGIN)
    return held.reshape(400, 4).all(axis=1).mean()


@pytest.mark.parametrize("noise", [0.0, NOISE])
@pytest.mark.parametrize("leaf", [0.008, 0.01])
def test_a_table_thinned_by_a_voxel_filter_carries_where_rays_show_it_whole(leaf, noise):
    assert carried(voxel_filtered(table, leaf, noise=noise), SENSOR) > 0.95
    assert carried(voxel_filtered(table, leaf, noise=noise)) < 0.02
    # one that sees nothing below the table would see nothing through its holes either
    assert carried(voxel_filtered(table, leaf, noise=noise), SENSOR, np.zeros((0, 3))) < 0.02


@pytest.mark.parametrize("leaf", [0.002, 0.003])
def test_one_thinned_to_less_than_half_of_a_hole_carries_without_rays(leaf):
    assert carried(voxel_filtered(table, leaf)) > 0.95


@pytest.mark.parametrize("sensor", [None, SENSOR])
@pytest.mark.parametrize("leaf", [0.005, 0.008, 0.01])
@pytest.mark.parametrize(("width", "pitch"), [(0.005, 0.015), (0.006, 0.02), (0.005, 0.03)])
def test_a_grating_is_no_floor(width, pitch, leaf, sensor):
    def bars(x, y):
        return np.where((y + 0.3) % pitch < width, 0.0, -0.03)

    for seed in range(3):
        assert carried(voxel_filtered(bars, leaf, seed), sensor) < 0.02


@pytest.mark.parametrize(
    ("spacing", "noise", "width", "pitch"),
    [(0.005, 0.003, 0.005, 0.015), (0.004, 0.002, 0.006, 0.02), (0.004, 0.002, 0.004, 0.02)],
)
def test_a_grating_is_no_floor_where_noise_hides_what_rays_passed(spacing, noise, width, pitch):
    """So near is what they met below it."""
    for seed in range(2):
        rng = np.random.default_rng(seed)
        line = [np.arange(-0.3, 0.3, spacing) + rng.uniform(0.0, spacing)] * 2
        x, y = (each.ravel() for each in np.meshgrid(*line))
        z = np.where((y + 0.3) % pitch < width, 0.0, -0.015) + rng.normal(0.0, noise, len(x))
        assert carried(np.column_stack([x, y, z]), SENSOR) < 0.02


@pytest.mark.parametrize(
    ("leaf", "sensor", "sparse"),
    [(0.003, None, False), (0.008, None, True), (0.008, SENSOR, False)],
)
def test_a_surface_that_is_lost_for_its_sparse_points_is_told(leaf, sensor, sparse):
    points = voxel_filtered(table, leaf)
    sights = () if sensor is None else [View(np.vstack([points, FLOOR]), sensor)]
    environment = Environment.from_points(points, VOLUME, sights=sights)
    told = environment_notes(SNAPSHOT, environment)
    assert (environment.sparse > 0.5) == sparse
    assert any("so far apart" in note for note in told) == sparse


def test_of_a_dense_grating_nothing_is_lost_for_sparse_points():
    points = voxel_filtered(lambda x, y: np.where((y + 0.3) % 0.015 < 0.005, 0.0, -0.03), 0.002)
    assert Environment.from_points(points, VOLUME).sparse < 0.1


def ribs(x, y):
    return np.where((y + 0.3) % 0.045 < 0.006, 0.003, 0.0)


def waves(x, y):
    return 0.0015 * np.sin(x * 2.0 * np.pi / 0.04)


def coins(x, y):
    away = [np.hypot(x - a, y - b) for a in np.arange(-0.2, 0.21, 0.1) for b in (-0.1, 0.0, 0.1)]
    return np.where(np.min(away, axis=0) < 0.0115, 0.0025, 0.0)


@pytest.mark.parametrize("relief", [ribs, waves, coins])
@pytest.mark.parametrize("leaf", [0.008, 0.01])
def test_on_low_relief_nothing_stands_without_rays(relief, leaf):
    assert carried(voxel_filtered(relief, leaf)) < 0.02
