"""The distance bound, against brute force over the boxes."""

import numpy as np
import pytest
from helpers.points import BOUNDS, floor_can_shelf_wall

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.scene.distance import distance_bound_field
from placement_planner_ros.core.scene.grid import ObstacleSet

CELL = 0.01


@pytest.fixture(scope="module")
def obstacles():
    return ObstacleSet.from_points(floor_can_shelf_wall(), bounds=BOUNDS)


def true_distance(obstacles, points):
    return np.array(
        [
            np.linalg.norm(
                np.maximum(np.maximum(obstacles.lower - p, p - obstacles.upper), 0.0), axis=1
            ).min()
            for p in points
        ]
    )


def levels_of(bound, cells):
    tile, (i, j, k) = tuple((cells // 4).T), (cells % 4).T
    return bound.levels[(*tile, 16 * i + 4 * j + k)].astype(np.float64)


@pytest.mark.parametrize("cap", [0.3, 0.04])
def test_bounds_hold_everywhere_and_are_exact_near(obstacles, cap):
    bound = distance_bound_field(obstacles, cap)
    rng = np.random.default_rng(6)
    cells = np.stack([rng.integers(n, size=2500) for n in obstacles.shape], axis=1)
    boxes = rng.integers(len(obstacles), size=1500)
    near = obstacles.cells[boxes] + rng.integers(-4, 5, (1500, 3))
    cells = np.vstack([cells, np.clip(near, 0, np.array(obstacles.shape) - 1)])
    centers = bound.origin + (cells + 0.5) * bound.cell_size
    levels = levels_of(bound, cells)
    true = true_distance(obstacles, centers)
    assert (levels * bound.step <= true).all()
    known = levels < bound.exact
    assert (true <= (levels + 1) * bound.step + 1e-9)[known].all()
    assert known[true < min(2.5 * CELL, cap) - 2 * bound.step].all()
    assert known.sum() > 300
    assert levels.max() * bound.step <= cap
    below = np.minimum(true, cap) - levels * bound.step
    assert below.max() <= np.sqrt(2.0) * CELL + bound.step + 1e-6


def test_a_cap_of_nothing_is_refused(obstacles):
    with pytest.raises(ParameterError):
        distance_bound_field(obstacles, 0.0)
