"""Fewer triangles for a robot, as a browser without a graphics card has to draw each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.types import Array
from placement_planner_ros.view.robot_shapes import LinkShape

MOST_OF_ROBOT = 25_000
"""Triangles of all links together."""
_FEW = 500
"""Triangles of a link that stays as it is."""
_FIRST, _STEP, _LAST = 0.002, 1.3, 0.05
"""Sides of the cubes that are tried, m: the first, how many times larger each next, the last."""


def coarse_enough(shapes: Sequence[LinkShape], most: int = MOST_OF_ROBOT) -> list[LinkShape]:
    """The shapes, made as coarse as leaves at most so many triangles, all to the same degree."""
    found, side = list(shapes), _FIRST
    while sum(len(shape.triangles) for shape in found) > most and side < _LAST:
        found = [_coarser(shape, side) for shape in shapes]
        side *= _STEP
    return found


def _coarser(shape: LinkShape, side: float) -> LinkShape:
    if len(shape.triangles) <= _FEW:
        return shape
    vertices, triangles = clustered(shape.vertices, shape.triangles, side)
    return replace(shape, vertices=vertices, triangles=triangles)


def clustered(
    vertices: Array, triangles: npt.NDArray[np.int64], side: float
) -> tuple[Array, npt.NDArray[np.int64]]:
    """A surface whose vertices in one cube become one, in their middle.

    Args:
        vertices, triangles: (n, 3) metres and (t, 3).
        side: of the cubes, metres; no vertex moves further than the diagonal of one.
    """
    cube = np.floor((vertices - vertices.min(axis=0)) / side).astype(np.int64)
    width = cube.max(axis=0) + 1
    number = (cube[:, 0] * width[1] + cube[:, 1]) * width[2] + cube[:, 2]
    _, which, count = np.unique(number, return_inverse=True, return_counts=True)
    middles = np.column_stack(
        [np.bincount(which, vertices[:, axis], len(count)) / count for axis in range(3)]
    )
    corners = which[triangles]
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a)]
    # One of those with the same corners, whichever way around: both sides are drawn.
    _, first = np.unique(np.sort(corners, axis=1), axis=0, return_index=True)
    return middles, corners[np.sort(first)]
