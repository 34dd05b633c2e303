"""Points of a cloud to the obstacle set."""

import numpy as np
import pytest
from helpers.points import BOUNDS, floor_and_wall, plane

from placement_planner_ros.core.errors import CloudError, ParameterError
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet


def inside_some_box(obstacles, points, slack=1e-9):
    size = obstacles.cell_size
    found = np.zeros(len(points), bool)
    cells = np.floor((points - obstacles.origin) / size).astype(int)
    for p, cell in enumerate(cells):
        row = obstacles.number_at[tuple(cell)] - 1
        while row >= 0:
            found[p] |= bool(
                (points[p] >= obstacles.lower[row] - slack).all()
                and (points[p] <= obstacles.upper[row] + slack).all()
            )
            row = obstacles.next[row]
    return found


def test_clean_points_all_lie_in_the_boxes_of_their_cells():
    rng = np.random.default_rng(0)
    points = np.vstack([floor_and_wall(), rng.uniform(0.3, 0.45, (4000, 3))])
    obstacles = ObstacleSet.from_points(points, bounds=BOUNDS)
    assert obstacles.noise == 0.0
    assert inside_some_box(obstacles, points).all()


def test_level_surface_is_flat_and_has_no_gaps_and_ends_at_its_measured_edge():
    lower, upper = (-0.2037, -0.1512, 0.0), (0.2111, 0.1644, 0.0)
    obstacles = ObstacleSet.from_points(plane(lower, upper, 0.004), bounds=BOUNDS)
    assert (obstacles.lower[:, 2] == 0.0).all()
    assert (obstacles.upper[:, 2] == 0.0).all()
    np.testing.assert_allclose(obstacles.lower.min(axis=0), lower, atol=1e-12)
    np.testing.assert_allclose(obstacles.upper.max(axis=0), upper, atol=1e-12)
    area = np.prod((obstacles.upper - obstacles.lower)[:, :2], axis=1).sum()
    assert area == pytest.approx((0.2111 + 0.2037) * (0.1644 + 0.1512), rel=1e-9)


def test_a_step_is_not_closed_sideways():
    low = plane((-0.2, -0.195, 0.0), (0.0, 0.195, 0.0))
    high = plane((0.0041, -0.195, 0.008), (0.2, 0.195, 0.008))
    obstacles = ObstacleSet.from_points(np.vstack([low, high]), bounds=BOUNDS)
    top = obstacles.upper[:, 2] > 0.007
    assert obstacles.lower[top, 0].min() == pytest.approx(0.0041, abs=1e-9)


def test_noisy_surface_becomes_level_and_the_corner_stays_usable():
    rng = np.random.default_rng(3)
    floor = plane((-0.25, -0.25, 0.0), (0.25, 0.2, 0.0), 0.002)
    wall = plane((-0.25, 0.2, 0.0), (0.25, 0.2, 0.3), 0.002)
    points = np.vstack([floor, wall])
    noisy = points + rng.normal(0.0, 0.002, points.shape)
    obstacles = ObstacleSet.from_points(noisy, bounds=BOUNDS)
    assert obstacles.noise == pytest.approx(0.002, rel=0.2)
    center = 0.5 * (obstacles.lower + obstacles.upper)
    middle = (np.abs(center[:, 0]) < 0.2) & (center[:, 1] < 0.16) & (center[:, 1] > -0.22)
    assert np.abs(obstacles.upper[middle, 2]).max() < 0.001
    assert np.abs(obstacles.lower[middle, 2]).max() < 0.001
    raw = ObstacleSet.from_points(noisy, GridSettings(noise_floor=1.0), bounds=BOUNDS)
    assert raw.upper[raw.upper[:, 1] < 0.15, 2].max() > 0.004
    # a strip of floor 5 to 10 mm off the wall: nothing stands above the contact tolerance
    beside = (obstacles.upper[:, 1] > 0.19) & (obstacles.lower[:, 1] < 0.195)
    beside &= (np.abs(center[:, 0]) < 0.2) & (obstacles.lower[:, 2] < 0.02)
    assert (obstacles.upper[beside, 2] < 0.003).mean() > 0.9


@pytest.mark.parametrize(("spacing", "noise"), [(0.003, 0.0002), (0.005, 0.00029)])
def test_little_noise_is_told(spacing, noise):
    """A glass of 57 mm found no place on a table whose noise was taken for its shape."""
    rng = np.random.default_rng(4)
    points = plane((-0.25, -0.25, 0.0), (0.25, 0.25, 0.0), spacing)
    noisy = points + rng.normal(0.0, noise, points.shape)
    obstacles = ObstacleSet.from_points(noisy, bounds=BOUNDS)
    assert obstacles.noise == pytest.approx(noise, rel=0.2)
    middle = (np.abs(0.5 * (obstacles.lower + obstacles.upper)[:, :2]) < 0.22).all(axis=1)
    assert obstacles.upper[middle, 2].std() < 0.5 * noise


def test_a_thin_stem_survives_noise():
    rng = np.random.default_rng(5)
    angle = rng.uniform(0.0, 2.0 * np.pi, 900)
    stem = np.c_[0.004 * np.cos(angle), 0.004 * np.sin(angle), rng.uniform(0.03, 0.2, len(angle))]
    floor = plane((-0.2, -0.2, 0.0), (0.2, 0.2, 0.0), 0.002)
    points = np.vstack([floor, stem]) + rng.normal(0.0, 0.002, (len(floor) + 900, 3))
    obstacles = ObstacleSet.from_points(points, bounds=BOUNDS)
    near = (np.abs(obstacles.lower[:, :2]) < 0.012).all(axis=1)
    for z in np.arange(0.04, 0.19, 0.01):
        assert (near & (obstacles.lower[:, 2] <= z) & (obstacles.upper[:, 2] >= z)).any()


def test_flying_pixels_are_dropped_from_dense_clouds_only():
    floor = plane((-0.2, -0.2, 0.0), (0.2, 0.2, 0.0))
    flying = np.array([[0.0, 0.0, 0.2], [0.1, 0.1, 0.3], [0.104, 0.1, 0.3]])
    dense = ObstacleSet.from_points(np.vstack([floor, flying]), bounds=BOUNDS)
    assert dense.upper[:, 2].max() < 0.01
    three = np.array([[0.1, 0.1, 0.3], [0.104, 0.1, 0.3], [0.1, 0.104, 0.3]])
    kept = ObstacleSet.from_points(np.vstack([floor, three]), bounds=BOUNDS)
    assert kept.upper[:, 2].max() == pytest.approx(0.3)
    sparse = ObstacleSet.from_points(flying, bounds=BOUNDS)
    assert inside_some_box(sparse, flying).all()


def test_a_sparse_clean_cloud_loses_nothing():
    flat = plane((-0.3, -0.3, 0.0), (0.3, 0.3, 0.0), 0.01)
    ridges = flat[np.abs(flat[:, 1]) < 0.1] + np.array([0.0, 0.0, 0.012])
    points = np.vstack([flat, ridges])
    for cell_size in (0.005, 0.01, 0.02):
        obstacles = ObstacleSet.from_points(points, GridSettings(cell_size=cell_size), BOUNDS)
        assert obstacles.noise == 0.0
        assert inside_some_box(obstacles, points).all()


def test_points_outside_and_nan_are_left_out():
    points = np.array([[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [np.nan, 0.0, 0.0], [0.0, np.inf, 0.0]])
    obstacles = ObstacleSet.from_points(points, bounds=BOUNDS)
    assert len(obstacles) == 1
    np.testing.assert_array_equal(obstacles.lower[0], np.zeros(3))


def test_nothing_seen_within_bounds_is_an_empty_set():
    for points in (np.zeros((0, 3)), np.full((4, 3), 9.0)):
        obstacles = ObstacleSet.from_points(points, bounds=BOUNDS)
        assert len(obstacles) == 0
        assert (obstacles.number_at == 0).all()


@pytest.mark.parametrize(
    ("points", "bounds"),
    [
        (np.full((5, 3), np.nan), BOUNDS),
        (np.zeros((0, 3)), None),
        (np.zeros((5, 2)), BOUNDS),
        (["a"], BOUNDS),
        (np.zeros((5, 3)), ((0, 0, 0), (1, 1, 0))),
        (np.zeros((5, 3)), ((0, 0, 0), (1, 1, np.nan))),
        (np.array([[0.0, 0.0, 0.0], [1e7, 0.0, 1e7]]), None),
        (np.zeros((5, 3)), ((-50, -50, -50), (50, 50, 50))),
    ],
)
def test_bad_clouds_are_refused(points, bounds):
    with pytest.raises(CloudError):
        ObstacleSet.from_points(points, bounds=bounds)


@pytest.mark.parametrize(
    "change",
    [
        {"cell_size": 0.0},
        {"cell_size": float("nan")},
        {"noise_floor": -1.0},
        {"min_points": -1},
        {"max_boxes_per_cell": 0},
        {"max_cells": 0},
    ],
)
def test_bad_settings_are_refused(change):
    with pytest.raises(ParameterError):
        GridSettings(**change)
