"""What stands on uneven corners: neither leans nor rocks, by the planes of three corners each."""

import numpy as np
import pytest

from placement_planner_ros.core.stability.by_vertices import LEANS, in_one_plane

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def rocks(corners, gaps):
    """rad between the two ways in which a plate stands on three of the four corners (4, 2)."""
    points = np.column_stack([corners, gaps])
    ridge, others = (0, 2), (1, 3)
    if gaps[[0, 2]].sum() < gaps[[1, 3]].sum():
        ridge, others = others, ridge
    normals = []
    for other in others:
        normal = np.cross(points[ridge[1]] - points[ridge[0]], points[other] - points[ridge[0]])
        normals.append(normal * np.sign(normal[2]) / np.linalg.norm(normal))
    return np.arccos(np.clip(normals[0] @ normals[1], -1.0, 1.0))


@pytest.mark.parametrize("size", [(0.09, 0.09), (0.144, 0.036), (0.03, 0.05)])
def test_nothing_stands_that_could_rock_by_more_than_it_may_lean(size):
    rng = np.random.default_rng(0)
    corners = 0.5 * CORNERS * size
    gaps = rng.uniform(-0.0015, 0.0015, (4000, 4)) * rng.uniform(0.0, 1.0, (4000, 1))
    points = np.broadcast_to(np.column_stack([corners, np.zeros(4)]), (4000, 4, 3))
    stands = in_one_plane(points, gaps, 0.0)
    slope = np.linalg.lstsq(np.column_stack([corners, np.ones(4)]), gaps.T, rcond=None)[0][:2]
    lean, rock = np.linalg.norm(slope, axis=0), np.array([rocks(corners, each) for each in gaps])
    assert 0.05 < stands.mean() < 0.95
    assert lean[stands].max() <= LEANS
    assert rock[stands].max() <= LEANS
    assert stands[(lean <= LEANS) & (rock <= 0.7 * LEANS)].all()


def test_noise_excuses_errors_of_surfaces_but_no_step():
    noise, rng = 0.001, np.random.default_rng(0)
    points = np.column_stack([0.5 * CORNERS * (0.124, 0.036), np.zeros(4)])[None]
    errors = rng.normal(0.0, noise / 6.0, (2000, 4))
    assert in_one_plane(np.repeat(points, 2000, axis=0), errors, noise).mean() > 0.99
    steps = {"a corner 3 mm higher": [3.0, 0.0, 0.0, 0.0], "twisted": [0.75, -0.75, 0.75, -0.75]}
    for name, gaps in steps.items():
        assert not in_one_plane(points, 1e-3 * np.array([gaps]), noise)[0], name
