"""What was measured on each surface of a `SupportMap`, and how densely, for kernels."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.obstacle_arrays import ObstacleArrays
from placement_planner_ros.core.types import Array

END, INNER, DEEP = 0, 1, 2
"""A surface ends in its column or beside it; goes on in all columns around; these do so too."""

FARTHEST = 1.5
"""Points surround what lies within so many cells at most ..."""
_GAP = 2.5
"""... and within so many of their spacings."""
_DENSE = 0.75
"""Where points surround what lies within so many cells, every quarter of a column has its own."""


class Columns(NamedTuple):
    """Surfaces by column of the grid; what kernels read of a `SupportMap`.

    Attributes:
        origin: (3,) lower corner of the grid, metres.
        cell_size: m.
        nx, ny: columns along x and y.
        start: (nx * ny + 1,) first surface of each column, and their number.
        height: (s,) z of each surface, metres.
        kind: (s,) whether the surface ends in its column or beside it, see above.
        radius: (s,) m, how far apart the points may be that surround what they support.
        first: (s + 1,) first of each surface's points, and their number.
        points: (k, 2) x and y of what was measured on the surfaces.
        step: heights of one surface differ by no more from one column to the next, m.
        alone: (s,) m, what lies further than that from all points of a surface that ends is a gap.
        first_hole: (s + 1,) first of the discs that reach into each surface's column, their number.
        holes: (h, 3) x, y and radius of discs that are gaps in the surface, metres.
    """

    origin: Array
    cell_size: float
    nx: int
    ny: int
    start: npt.NDArray[np.int64]
    height: Array
    kind: npt.NDArray[np.uint8]
    radius: Array
    first: npt.NDArray[np.int64]
    points: npt.NDArray[np.float32]
    step: float
    alone: Array
    first_hole: npt.NDArray[np.int64]
    holes: Array


@kernel(lean=True)
def surface_at(
    start: npt.NDArray[np.int64], height: Array, column: int, z: float, tolerance: float
) -> int:
    """The surface of that column nearest to z, within the tolerance of it, or -1."""
    best = -1
    for s in range(start[column], start[column + 1]):
        off = abs(height[s] - z)
        if off <= tolerance and (best < 0 or off < abs(height[best] - z)):
            best = s
    return best


@kernel(nogil=True)
def kinds(
    cells: npt.NDArray[np.int32],
    start: npt.NDArray[np.int64],
    height: Array,
    filled: npt.NDArray[np.bool_],
    holed: npt.NDArray[np.bool_],
    radius: Array,
    nx: int,
    ny: int,
    size: float,
    step: float,
) -> npt.NDArray[np.uint8]:
    """`Columns.kind`."""
    kind = np.zeros(len(height), np.uint8)
    for least in range(2):  # first where the surface goes on around, then where these do
        for s in range(len(height)):
            i, j = cells[s, 0], cells[s, 1]
            if i < 1 or j < 1 or i >= nx - 1 or j >= ny - 1 or kind[s] < least:
                continue
            whole = not holed[s] and (least > 0 or filled[s] or radius[s] > _DENSE * size)
            for di in range(-1, 2):
                for dj in range(-1, 2):
                    t = surface_at(start, height, (i + di) * ny + j + dj, height[s], step)
                    whole = whole and t >= 0 and kind[t] >= least
            if whole:
                kind[s] = least + 1
    return kind


@kernel(nogil=True)
def points_on(
    boxes: ObstacleArrays,
    measured: npt.NDArray[np.float32],
    measured_first: npt.NDArray[np.int64],
    cells: npt.NDArray[np.int32],
    height: Array,
    step: float,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
    """`Columns.first` and `points`; (s,) whether there are some in all quarters of the column.

    Points of a box that is as near to two surfaces of its column are of both.
    """
    nz = boxes.number_at.shape[2]
    first = np.zeros(len(height) + 1, np.int64)
    points = np.empty_like(measured)
    filled = np.zeros(len(height), np.bool_)
    n = 0
    for s in range(len(height)):
        i, j, layer = cells[s, 0], cells[s, 1], cells[s, 2]
        x = boxes.origin[0] + (i + 0.5) * boxes.cell_size
        y = boxes.origin[1] + (j + 0.5) * boxes.cell_size
        quarters = 0
        for k in range(max(layer - 1, 0), min(layer + 2, nz)):
            p = boxes.number_at[i, j, k] - 1
            while p >= 0:
                if abs(boxes.surface_height[p] - height[s]) <= step:
                    while n + measured_first[p + 1] - measured_first[p] > len(points):
                        points = np.concatenate((points, measured))
                    for m in range(measured_first[p], measured_first[p + 1]):
                        points[n] = measured[m]
                        quarters |= 1 << (2 * int(points[n, 0] > x) + int(points[n, 1] > y))
                        n += 1
                p = boxes.next[p]
        filled[s] = quarters == 15
        first[s + 1] = n
    return first, points[:n].copy(), filled


@kernel(nogil=True)
def radii(
    cells: npt.NDArray[np.int32],
    start: npt.NDArray[np.int64],
    height: Array,
    first: npt.NDArray[np.int64],
    nx: int,
    ny: int,
    size: float,
    step: float,
) -> Array:
    """`Columns.radius`: by the spacing in the fullest of the columns around."""
    radius = np.empty(len(height))
    for s in range(len(height)):
        most = 1
        for i in range(max(cells[s, 0] - 1, 0), min(cells[s, 0] + 2, nx)):
            for j in range(max(cells[s, 1] - 1, 0), min(cells[s, 1] + 2, ny)):
                t = surface_at(start, height, i * ny + j, height[s], step)
                if t >= 0:
                    most = max(most, first[t + 1] - first[t])
        radius[s] = min(_GAP * size / math.sqrt(most), FARTHEST * size)
    return radius
