"""The clearance objective over the regions, estimated from what the node publishes.

C(x) is the mean distance from the object's points to what stands around, sideways and upwards, at
most 0.5 m; what ends below a point does not count for it. The node publishes the middles of its
obstacles' cells only, and the page knows the object's hull only, so that the estimate is off by a
cell or so. It is for looking at; the planner never sees it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.spatial import ConvexHull, Delaunay, QhullError, cKDTree

from placement_planner_ros.core.types import Array

CAP = 0.5
"""m, the greatest distance that counts."""
LEVELS = 6
"""Heights of the object at which distances are taken."""
_POINTS = 160
_CELL = 0.02
"""m between two places at which a distance is taken."""
AGREES = 0.05
"""m by which the estimate and ξ as published may differ for the estimate to be shown."""


def inner_points(vertices: Array) -> Array:
    """(n, 3) points spread over the hull of an object's vertices (m, 3)."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    drawn = low + np.random.default_rng(0).random((8 * _POINTS, 3)) * (high - low)
    try:
        inside = drawn[Delaunay(vertices[ConvexHull(vertices).vertices]).find_simplex(drawn) >= 0]
    except QhullError:  # flat
        return np.asarray(vertices)
    return np.asarray(inside[:_POINTS] if len(inside) >= 20 else vertices)


def estimated_clearance(
    places: Array, T_world_object: pin.SE3, points: Array, cells: Array, cell_size: float
) -> Array:
    """(n,) C, metres, of the object moved to each of the places without turning.

    Args:
        places: (n, 3) on surfaces; the object's middle comes to be above them.
        points: (m, 3) spread over the object, in its frame.
        cells: (k, 3) middles of the obstacles' cells that count.
        cell_size: their side, metres.
    """
    turned = points @ T_world_object.rotation.T
    turned -= [*turned[:, :2].mean(axis=0), turned[:, 2].min()]
    values = np.full(len(places), CAP)
    steps = np.linspace(0.0, turned[:, 2].max() + 1e-9, LEVELS + 1)
    level = np.clip(np.searchsorted(steps, turned[:, 2], side="right") - 1, 0, LEVELS - 1)
    for rows, support in _by_height(places):
        total = np.zeros(len(rows))
        for k in range(LEVELS):
            here = turned[level == k, :2]
            if len(here) == 0:
                continue
            height = support + 0.5 * (steps[k] + steps[k + 1])
            distance = _distances(places[rows, :2], here, cells, height, support, cell_size)
            total += distance
        values[rows] = total / len(turned)
    return values


def _by_height(places: Array) -> Iterator[tuple[npt.NDArray[np.int64], float]]:
    """Those at one height, to a centimetre, and how high that is."""
    heights = np.round(places[:, 2], 2)
    for height in np.unique(heights):
        rows = np.flatnonzero(heights == height).astype(np.int64)
        yield rows, float(np.median(places[rows, 2]))


def _distances(
    xy: Array, offsets: Array, cells: Array, height: float, support: float, cell_size: float
) -> Array:
    """(n,) sums over the offsets (m, 2) of the distance at xy (n, 2) and that height."""
    half = 0.5 * cell_size
    counted = cells[cells[:, 2] > max(height - half, support + cell_size)]
    if len(counted) == 0:
        return np.full(len(xy), CAP * len(offsets))
    # As boxes are flat to whoever is beside them, only what begins above counts upwards.
    flat = np.column_stack([counted[:, :2], np.maximum(counted[:, 2] - half, height)])
    low = xy.min(axis=0) + offsets.min(axis=0)
    high = xy.max(axis=0) + offsets.max(axis=0)
    count = np.ceil((high - low) / _CELL).astype(int) + 1
    x, y = (low[i] + _CELL * np.arange(count[i]) for i in range(2))
    places = np.column_stack([*(g.ravel() for g in np.meshgrid(x, y, indexing="ij")),
                              np.full(count.prod(), height)])  # fmt: skip
    found, _ = cKDTree(flat).query(places, distance_upper_bound=CAP)
    table = np.minimum(np.maximum(found - half, 0.0), CAP).reshape(count)
    total = np.zeros(len(xy))
    for offset in offsets:
        i, j = np.rint((xy + offset - low) / _CELL).astype(int).T
        total += table[np.clip(i, 0, count[0] - 1), np.clip(j, 0, count[1] - 1)]
    return total


def counted(cells: Array, boxes: Array, beyond: float) -> Array:
    """The cells (k, 3) that count: those in V, boxes (m, 2, 3), or so far outside of it, metres."""
    near = np.zeros(len(cells), bool)
    for lower, upper in boxes:
        near |= ((cells >= lower - beyond) & (cells <= upper + beyond)).all(axis=1)
    return np.asarray(cells[near])


def sign_that_agrees(estimate: float, objective: float) -> int:
    """1 where ξ is C, -1 where it is -C, by what is published of one placement; 0 where neither."""
    for sign in (1, -1):
        if abs(sign * estimate - objective) <= AGREES:
            return sign
    return 0
