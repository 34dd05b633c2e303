"""Dense clouds are thinned evenly; what is no denser than planning needs stays."""

import numpy as np
from scipy.spatial import cKDTree

from placement_planner_ros.core.scene.cloud import CELL_POINTS, DENSE_POINTS, thinned

SIZE = 0.01


def lattice(spacing, z=0.004):
    ticks = np.arange(0.0003, 0.2, spacing)
    flat = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.column_stack([flat, np.full(len(flat), z)])


def per_cell(points):
    return np.unique(np.floor(points / SIZE), axis=0, return_counts=True)[1]


def test_clouds_of_usual_density_are_kept_whole_but_for_what_was_not_seen():
    points = lattice(0.0025)
    assert per_cell(points).max() <= DENSE_POINTS
    points[::7] = np.nan
    seen = np.flatnonzero(np.isfinite(points).all(axis=1))
    assert thinned(points, SIZE).tolist() == seen.tolist()
    assert len(thinned(np.zeros((0, 3)), SIZE)) == 0


def test_dense_clouds_keep_four_points_a_cell_in_each_direction_evenly():
    points = lattice(0.0005)
    rows = thinned(points, SIZE)
    assert (np.diff(rows) > 0).all()
    left = points[rows]
    whole = per_cell(points) >= 380
    assert (np.abs(per_cell(left)[whole] - CELL_POINTS) <= 2).all()
    assert cKDTree(left).query(points)[0].max() < 0.005
    assert len(thinned(left, SIZE)) > 0.95 * len(left)
