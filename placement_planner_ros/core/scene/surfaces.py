"""Level surfaces of the obstacle set: tops of boxes with free space above, closed over gaps."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import Array

Index = npt.NDArray[np.int32]

_TOP_SHARE = 0.35
"""The points at the top of a thick box must span this share of it in x and y: a slope's do not."""

_SHEET = 0.001
_MOST_CLOSED = 0.3
"""Bounds along diagonals are moved out by at most so much of a cell where a side is closed."""


class LevelSurfaces(NamedTuple):
    """s level surfaces, by column.

    Attributes:
        cells: (s, 3) int32, in lexicographic order.
        start: (nx * ny + 1,) first surface of each column of the grid, and their number.
        height: (s,) z, metres.
        rectangle: (s, 4) xmin, ymin, xmax, ymax.
        diagonal: (s, 4) minimum and maximum of x + y and of x - y.
    """

    cells: Index
    start: npt.NDArray[np.int64]
    height: Array
    rectangle: Array
    diagonal: Array


def level_surfaces(obstacles: ObstacleSet, headroom: float, max_tilt: float) -> LevelSurfaces:
    """The tops of boxes on which something may stand.

    Nothing else lies within `headroom` above them, they are level (their own points and the tops
    around), and they are not where the workspace ends. Where the surface goes on in the next
    column, the rectangle is closed up to it; slanted edges are bounded along both diagonals.
    """
    tolerance = obstacles.surface_tolerance + 0.5 * obstacles.noise
    free, top = _tops(
        obstacles.cells,
        obstacles.lower,
        obstacles.upper,
        obstacles.surface_height,
        obstacles.surface_extent,
        obstacles.index,
        obstacles.next,
        obstacles.cell_size,
        headroom,
        tolerance,
    )
    level = _level(
        obstacles.cells,
        obstacles.surface_height,
        free,
        top,
        obstacles.index,
        obstacles.next,
        obstacles.cell_size,
        max_tilt,
        0.5 * obstacles.noise,
    )
    merged = _merge(
        np.flatnonzero(level),
        obstacles.cells,
        obstacles.surface_height,
        obstacles.surface_extent,
        tolerance,
    )
    cells, height, extent = _fill_holes(
        *merged,
        _column_starts(merged[0], obstacles.shape),
        obstacles.lower,
        obstacles.upper,
        obstacles.index,
        obstacles.next,
        obstacles.origin,
        obstacles.cell_size,
        headroom,
        tolerance,
    )
    order = np.lexsort((cells[:, 2], cells[:, 1], cells[:, 0]))
    cells, height, extent = cells[order], height[order], extent[order]
    start = _column_starts(cells, obstacles.shape)
    rectangle, diagonal = _close(
        cells,
        height,
        extent,
        start,
        obstacles.shape[0],
        obstacles.shape[1],
        obstacles.origin,
        obstacles.cell_size,
        tolerance,
        2.0 * obstacles.noise,
    )
    return LevelSurfaces(cells, start, height, rectangle, diagonal)


def _column_starts(cells: Index, shape: tuple[int, int, int]) -> npt.NDArray[np.int64]:
    """(nx * ny + 1,) first row of each column, cells being sorted, and their number."""
    column = cells[:, 0].astype(np.int64) * shape[1] + cells[:, 1]
    return np.searchsorted(column, np.arange(shape[0] * shape[1] + 1)).astype(np.int64)


@kernel(nogil=True)
def _tops(
    cells: Index,
    lower: Array,
    upper: Array,
    height: Array,
    extent: Array,
    index: Index,
    following: Index,
    cell_size: float,
    headroom: float,
    tolerance: float,
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """(m,) whether a box has free space above; whether its top is also as wide as the box."""
    m = len(cells)
    nz = index.shape[2]
    free = np.zeros(m, np.bool_)
    top = np.zeros(m, np.bool_)
    layers = int(headroom / cell_size) + 1
    for p in range(m):
        if cells[p, 2] == nz - 1:
            continue  # what lies above was cropped away
        width, depth = extent[p, 1] - extent[p, 0], extent[p, 3] - extent[p, 2]
        blocked = False
        for k in range(cells[p, 2], min(cells[p, 2] + layers + 1, nz)):
            q = index[cells[p, 0], cells[p, 1], k]
            while q >= 0 and not blocked:
                if (
                    q != p
                    and upper[q, 2] > height[p] + tolerance
                    and lower[q, 2] < height[p] + headroom
                ):
                    # a wall beside the surface takes a sliver of it, a thing on it much; a sheet
                    # counts as _SHEET thick, for a wall goes on in the cell above
                    along_x = min(extent[p, 1], upper[q, 0]) - max(extent[p, 0], lower[q, 0])
                    along_y = min(extent[p, 3], upper[q, 1]) - max(extent[p, 2], lower[q, 1])
                    shared = max(0.0, along_x + _SHEET) * max(0.0, along_y + _SHEET)
                    blocked = shared > 0.3 * (width + _SHEET) * (depth + _SHEET)
                q = following[q]
            if blocked:
                break
        free[p] = not blocked
        slack = 0.2 * cell_size  # boxes are closed up to their neighbours
        top[p] = not blocked and (
            upper[p, 2] - lower[p, 2] <= 2.0 * tolerance
            or (
                width + slack >= _TOP_SHARE * (upper[p, 0] - lower[p, 0])
                and depth + slack >= _TOP_SHARE * (upper[p, 1] - lower[p, 1])
            )
        )
    return free, top


@kernel(nogil=True)
def _level(
    cells: Index,
    height: Array,
    free: npt.NDArray[np.bool_],
    top: npt.NDArray[np.bool_],
    index: Index,
    following: Index,
    cell_size: float,
    max_tilt: float,
    scatter: float,
) -> npt.NDArray[np.bool_]:
    """Tops past which the surface does not go on up on one side and down on the other."""
    m = len(cells)
    nx, ny, nz = index.shape
    level = top.copy()
    reach = 2.0 * cell_size
    for p in range(m):
        if not top[p]:
            continue
        # on a slope of max_tilt the columns two further differ by this, beyond the scatter
        rise = 2.0 * cell_size * max_tilt + scatter
        for axis in range(2):
            steps = np.zeros(2)
            found = np.zeros(2, np.bool_)
            for side in range(2):
                i = cells[p, 0] + ((2 * side - 1) if axis == 0 else 0)
                j = cells[p, 1] + ((2 * side - 1) if axis == 1 else 0)
                if i < 0 or i >= nx or j < 0 or j >= ny:
                    continue
                best = np.inf
                for k in range(max(cells[p, 2] - 2, 0), min(cells[p, 2] + 3, nz)):
                    q = index[i, j, k]
                    while q >= 0:
                        if free[q]:
                            step = height[q] - height[p]
                            if abs(step) <= reach and abs(step) < abs(best):
                                best = step
                        q = following[q]
                if best < np.inf:
                    steps[side] = best
                    found[side] = True
            rises_on = found[0] and found[1] and steps[0] * steps[1] < 0.0
            if rises_on and abs(steps[1] - steps[0]) > rise:
                level[p] = False
    return level


@kernel(nogil=True)
def _merge(
    rows: npt.NDArray[np.int64], cells: Index, height: Array, extent: Array, tolerance: float
) -> tuple[Index, Array, Array]:
    """Boxes of one column at one height, split by a face between layers, as one surface each."""
    new_cells = np.empty((len(rows), 3), np.int32)
    new_height = np.empty(len(rows))
    new_extent = np.empty((len(rows), 8))
    n = 0
    for p in rows:
        same = (
            n > 0
            and new_cells[n - 1, 0] == cells[p, 0]
            and new_cells[n - 1, 1] == cells[p, 1]
            and abs(new_height[n - 1] - height[p]) <= 2.0 * tolerance
        )
        if same:
            new_height[n - 1] = 0.5 * (new_height[n - 1] + height[p])
            for a in range(0, 8, 2):
                new_extent[n - 1, a] = min(new_extent[n - 1, a], extent[p, a])
                new_extent[n - 1, a + 1] = max(new_extent[n - 1, a + 1], extent[p, a + 1])
        else:
            new_cells[n] = cells[p]
            new_height[n] = height[p]
            new_extent[n] = extent[p]
            n += 1
    return new_cells[:n], new_height[:n], new_extent[:n]


@kernel(nogil=True)
def _at_height(
    start: npt.NDArray[np.int64], height: Array, column: int, z: float, tolerance: float
) -> int:
    """The surface of that column within the tolerance of z, or -1."""
    for s in range(start[column], start[column + 1]):
        if abs(height[s] - z) <= tolerance:
            return s
    return -1


@kernel(nogil=True)
def _fill_holes(
    cells: Index,
    height: Array,
    extent: Array,
    start: npt.NDArray[np.int64],
    lower: Array,
    upper: Array,
    index: Index,
    following: Index,
    origin: Array,
    cell_size: float,
    headroom: float,
    tolerance: float,
) -> tuple[Index, Array, Array]:
    """Add columns in which nothing was measured and at least three of four sides are surface.

    Only where the surface is sampled thinly: a real slot shows points further down.
    """
    nx, ny, nz = index.shape
    layers = int(headroom / cell_size) + 1
    cells_out = [cells[0:0]]
    height_out = [height[0:0]]
    extent_out = [extent[0:0]]
    for s in range(len(cells)):
        for turn in range(4):
            i = cells[s, 0] + (1, -1, 0, 0)[turn]
            j = cells[s, 1] + (0, 0, 1, -1)[turn]
            if i < 1 or i >= nx - 1 or j < 1 or j >= ny - 1:
                continue
            z, found, first = 0.0, 0, len(cells)
            for side in range(4):
                column = (i + (1, -1, 0, 0)[side]) * ny + j + (0, 0, 1, -1)[side]
                t = _at_height(start, height, column, height[s], 2.0 * tolerance)
                if t >= 0:
                    z += height[t]
                    found += 1
                    first = min(first, t)
            if found < 3 or first != s:  # each hole once
                continue
            empty = True
            for k in range(max(cells[s, 2] - layers, 0), min(cells[s, 2] + layers + 1, nz)):
                empty = empty and index[i, j, k] < 0
            if not empty:
                continue
            x0, y0 = origin[0] + i * cell_size, origin[1] + j * cell_size
            x1, y1 = x0 + cell_size, y0 + cell_size
            cells_out.append(np.array([[i, j, cells[s, 2]]], dtype=np.int32))
            height_out.append(np.array([z / found]))
            extent_out.append(np.array([[x0, x1, y0, y1, x0 + y0, x1 + y1, x0 - y1, x1 - y0]]))
    added = len(cells_out) - 1
    total = len(cells) + added
    all_cells = np.empty((total, 3), np.int32)
    all_height = np.empty(total)
    all_extent = np.empty((total, 8))
    all_cells[: len(cells)] = cells
    all_height[: len(cells)] = height
    all_extent[: len(cells)] = extent
    for a in range(added):
        all_cells[len(cells) + a] = cells_out[a + 1][0]
        all_height[len(cells) + a] = height_out[a + 1][0]
        all_extent[len(cells) + a] = extent_out[a + 1][0]
    return all_cells, all_height, all_extent


@kernel(nogil=True)
def _close(
    cells: Index,
    height: Array,
    extent: Array,
    start: npt.NDArray[np.int64],
    nx: int,
    ny: int,
    origin: Array,
    cell_size: float,
    tolerance: float,
    trim: float,
) -> tuple[Array, Array]:
    """Rectangles closed up to columns in which the surface goes on, and bounds along diagonals.

    Edges are moved in by `trim`: the outermost of many noisy points lies beyond the true edge.
    """
    rectangle = np.empty((len(cells), 4))
    diagonal = np.empty((len(cells), 4))
    goes_on = np.empty((3, 3), np.bool_)
    for s in range(len(cells)):
        goes_on[:] = False
        for i in range(max(cells[s, 0] - 1, 0), min(cells[s, 0] + 2, nx)):
            for j in range(max(cells[s, 1] - 1, 0), min(cells[s, 1] + 2, ny)):
                goes_on[i - cells[s, 0] + 1, j - cells[s, 1] + 1] = (
                    _at_height(start, height, i * ny + j, height[s], 2.0 * tolerance) >= 0
                )
        x0 = origin[0] + cells[s, 0] * cell_size
        y0 = origin[1] + cells[s, 1] * cell_size
        x1, y1 = x0 + cell_size, y0 + cell_size
        rectangle[s, 0] = min(x0, extent[s, 0]) if goes_on[0, 1] else extent[s, 0] + trim
        rectangle[s, 1] = min(y0, extent[s, 2]) if goes_on[1, 0] else extent[s, 2] + trim
        rectangle[s, 2] = max(x1, extent[s, 1]) if goes_on[2, 1] else extent[s, 1] - trim
        rectangle[s, 3] = max(y1, extent[s, 3]) if goes_on[1, 2] else extent[s, 3] - trim
        # an edge cell's points end short of the neighbour by their spacing, which is closed
        left, front = extent[s, 0] - rectangle[s, 0], extent[s, 2] - rectangle[s, 1]
        right, back = rectangle[s, 2] - extent[s, 1], rectangle[s, 3] - extent[s, 3]
        most = _MOST_CLOSED * cell_size
        left, front = min(max(left, 0.0), most), min(max(front, 0.0), most)
        right, back = min(max(right, 0.0), most), min(max(back, 0.0), most)
        slanted = math.sqrt(2.0) * trim
        diagonal[s, 0] = -np.inf if goes_on[0, 0] else extent[s, 4] - left - front + slanted
        diagonal[s, 1] = np.inf if goes_on[2, 2] else extent[s, 5] + right + back - slanted
        diagonal[s, 2] = -np.inf if goes_on[0, 2] else extent[s, 6] - left - back + slanted
        diagonal[s, 3] = np.inf if goes_on[2, 0] else extent[s, 7] + right + front - slanted
    return rectangle, diagonal
