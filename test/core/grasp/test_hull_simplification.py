"""Hulls of few corners: how much they lack of the whole, by how far both reach."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from placement_planner_ros.core.grasp.hull_simplification import few_corners

TOLERANCE = 2e-4


@pytest.mark.parametrize("flatness", [1.0, 0.1, 0.01])
def test_the_few_enlarged_reach_as_far_as_the_many(flatness):
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(800, 3))
    corners *= [0.02, 0.01, 0.02 * flatness] / np.linalg.norm(corners, axis=1)[:, None]
    corners = corners[ConvexHull(corners).vertices]
    few, lost = few_corners(corners, TOLERANCE)
    assert len(few) < 0.5 * len(corners)
    assert 0.0 < lost <= TOLERANCE
    ways = rng.normal(size=(20_000, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    lacks = (corners @ ways.T).max(axis=0) - (few @ ways.T).max(axis=0)
    assert 0.5 * lost < lacks.max() <= lost + 1e-12


def test_hulls_of_few_corners_stay_as_they_are():
    corners = np.random.default_rng(0).normal(size=(20, 3))
    few, lost = few_corners(corners, TOLERANCE)
    assert few is corners
    assert lost == 0.0


def test_a_tilted_lens_of_which_only_the_rim_reaches_far():
    turns = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    rim = np.column_stack([np.cos(turns), np.sin(turns), 0.0 * turns]) * 0.02
    across = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    corners = np.vstack([rim, [[0.0, 0.0, 0.0015], [0.0, 0.0, -0.0015]]]) @ across
    few, lost = few_corners(corners, TOLERANCE)
    assert len(few) < len(corners)
    assert lost <= TOLERANCE
