"""The clearance objective over the regions in colours, estimated from what the node publishes.

C(x) is the mean distance from the object's points to what stands around, sideways and upwards, at
most 0.5 m; what ends below a point does not count for it. The node publishes the middles of its
obstacles' cells only, and the page knows the object's hull only, so that the estimate is off by a
cell or so. It is for looking at; the planner never sees it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.spatial import ConvexHull, Delaunay, QhullError, cKDTree

from placement_planner_ros.core.types import Array
from placement_planner_ros.view import colours
from placement_planner_ros.view.record import Improvement
from placement_planner_ros.view.world import Surface, World, pose_of

CAP = 0.5
"""m, the greatest distance that counts."""
AGREES_WITHIN_M = 0.05
"""By how much the estimate and ξ as published may differ for the estimate to be shown."""
_LEVELS, _POINTS = 6, 40
"""Heights of the object at which distances are taken, and points of it of which they are."""
_KNOWN = {"maximize_clearance", "minimize_clearance"}
"""Objectives that are estimated."""


def inner_points(vertices: Array) -> Array:
    """(n, 3) points spread over the hull of an object's vertices (m, 3)."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    drawn = low + np.random.default_rng(0).random((32 * _POINTS, 3)) * (high - low)
    try:
        inside = drawn[Delaunay(vertices[ConvexHull(vertices).vertices]).find_simplex(drawn) >= 0]
    except QhullError:  # flat
        return np.asarray(vertices)
    return np.asarray(inside[:_POINTS] if len(inside) >= _POINTS else vertices)


def counted_cells(cells: Array, boxes: Array, beyond: float) -> Array:
    """(m, 3) of the obstacles' cells (n, 3) those up to `beyond` metres outside of V (k, 2, 3)."""
    near = np.zeros(len(cells), bool)
    for lower, upper in boxes:
        near |= ((cells >= lower - beyond) & (cells <= upper + beyond)).all(axis=1)
    return cells[near]


def estimated_clearance(
    places: Array, T_world_object: pin.SE3, points: Array, cells: Array, cell_size: float
) -> Array:
    """(n,) C, metres, of the object moved to each of the places without turning.

    Args:
        places: (n, 3) on surfaces; the object's middle comes to be above them.
        points: (m, 3) spread over the object, in its frame.
        cells: (k, 3) middles of the obstacles' cells that count.
    """
    turned = points @ T_world_object.rotation.T
    turned -= [*turned[:, :2].mean(axis=0), turned[:, 2].min()]
    steps = np.linspace(0.0, turned[:, 2].max() + 1e-9, _LEVELS + 1)
    level = np.clip(np.searchsorted(steps, turned[:, 2], side="right") - 1, 0, _LEVELS - 1)
    values, half = np.zeros(len(places)), 0.5 * cell_size
    heights = np.round(places[:, 2], 2)
    for one_height in np.unique(heights):
        rows = np.flatnonzero(heights == one_height)
        support = float(np.median(places[rows, 2]))
        standing = cells[cells[:, 2] > support + cell_size]
        for k in range(_LEVELS):
            height = support + 0.5 * (steps[k] + steps[k + 1])
            near = standing[standing[:, 2] > height - half]
            # Boxes are flat to whoever is beside them: only what begins above counts upwards.
            near[:, 2] = np.maximum(near[:, 2] - half, height)
            xy = places[rows, None, :2] + turned[level == k, :2]
            at = np.dstack([xy, np.full(xy.shape[:2], height)])
            away, _ = cKDTree(near.reshape(-1, 3)).query(at, distance_upper_bound=CAP + half)
            values[rows] += np.clip(away - half, 0.0, CAP).sum(axis=1)
    return values / len(turned)


def sign_that_agrees(estimate: float, objective: float) -> int:
    """1 where ξ is C, -1 where it is -C, by what is published of one placement; 0 where neither."""
    for sign in (1, -1):
        if abs(sign * estimate - objective) <= AGREES_WITHIN_M:
            return sign
    return 0


RegionColours = tuple[npt.NDArray[np.uint8], tuple[float, float]]
"""Colours (n, 3), and the least and the greatest ξ that they stand for."""


def region_colours(
    pieces: Array,
    best: Improvement | None,
    surface: Surface | None,
    obstacles: Array,
    volume: Array,
    world: World,
) -> RegionColours | None:
    """Colours of the pieces (n, 4, 3), the object being turned as in the best placement.

    None where another objective is sought, or what is estimated of the best placement is not what
    the node says of it.
    """
    if best is None or surface is None or best.solution.terms or min(len(pieces), len(volume)) == 0:
        return None
    if world.parameter("objective", "") not in _KNOWN:
        return None
    T, points = pose_of(best.solution.pose.pose), inner_points(surface[0])
    cells = counted_cells(
        obstacles, volume, CAP if world.parameter("clearance.beyond_volume", True) else 0.0
    )
    middle = T * points.mean(axis=0)
    foot = (surface[0] @ T.rotation.T + T.translation)[:, 2].min()
    places = np.vstack([pieces.mean(axis=1), [*middle[:2], foot]])
    size = float(world.parameter("cloud.cell_size", 0.01))
    values = estimated_clearance(places, T, points, cells, size)
    sign = sign_that_agrees(float(values[-1]), best.solution.objective)
    if sign == 0:
        return None
    values = sign * values[:-1]
    low, high = float(values.min()), float(values.max())
    return colours.scale_colours((values - low) / max(high - low, 1e-6)), (low, high)
