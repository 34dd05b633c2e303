"""Level surfaces of the obstacle set: tops of boxes with free space above, closed over gaps."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.obstacle_arrays import ObstacleArrays
from placement_planner_ros.core.types import Array

Index = npt.NDArray[np.int32]

_TOP_SHARE = 0.35
"""The points at the top of a thick box must span this share of it in x and y: a slope's do not."""

_ALIKE = 0.2
"""Of the step on one side of a slope, at least so much is on the other."""
_SHEET = 0.001
_MOST_CLOSED = 0.3
"""Bounds along diagonals are moved out by at most so much of a cell where a side is closed."""


Belongs = Callable[[Index, Array], npt.NDArray[np.bool_]]


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


class _Tops(NamedTuple):
    """Tops of boxes: cells (s, 3) in the grid, height (s,) and extent (s, 8) as of the boxes."""

    cells: Index
    height: Array
    extent: Array


def level_surfaces(
    obstacles: ObstacleSet, headroom: float, max_tilt: float, belongs: Belongs | None = None
) -> LevelSurfaces:
    """The tops of boxes on which something may stand.

    Nothing else lies within `headroom` above them, they are level (their own points and the tops
    around), and they are not where the workspace ends. Where the surface goes on in the next
    column, the rectangle is closed up to it; slanted edges are bounded along both diagonals.

    Args:
        belongs: which of surfaces with these cells and heights are kept; all unless given.
    """
    boxes = obstacles.arrays
    tolerance = obstacles.surface_tolerance + 0.5 * obstacles.noise
    free, top = free_tops(boxes, headroom, tolerance)
    level = _level(boxes, free, top, max_tilt, 0.5 * obstacles.noise)
    merged = _Tops(*_merge(boxes, np.flatnonzero(level), tolerance))
    start = _column_starts(merged.cells, obstacles.shape)
    found = np.array(_holes(boxes, merged, start, headroom, tolerance), dtype=np.float64)
    filled = found.reshape(-1, 12)
    cells = np.concatenate([merged.cells, filled[:, :3].astype(np.int32)])
    order = np.lexsort(cells.T[::-1])
    tops = _Tops(
        cells[order],
        np.concatenate([merged.height, filled[:, 3]])[order],
        np.concatenate([merged.extent, filled[:, 4:]])[order],
    )
    if belongs is not None:
        kept = belongs(tops.cells, tops.height)
        tops = _Tops(tops.cells[kept], tops.height[kept], tops.extent[kept])
    start = _column_starts(tops.cells, obstacles.shape)
    rectangle, diagonal = _close(
        tops,
        start,
        obstacles.shape[0],
        obstacles.shape[1],
        obstacles.origin,
        obstacles.cell_size,
        tolerance,
        2.0 * obstacles.noise,
    )
    return LevelSurfaces(tops.cells, start, tops.height, rectangle, diagonal)


def _column_starts(cells: Index, shape: tuple[int, int, int]) -> npt.NDArray[np.int64]:
    """(nx * ny + 1,) first row of each column, cells being sorted, and their number."""
    column = cells[:, 0].astype(np.int64) * shape[1] + cells[:, 1]
    return np.searchsorted(column, np.arange(shape[0] * shape[1] + 1)).astype(np.int64)


@kernel(lean=True)
def _covers(boxes: ObstacleArrays, q: int, p: int, headroom: float, tolerance: float) -> bool:
    """Whether box q takes much of the room above the top of box p.

    A wall beside the surface takes a sliver of it, a thing on it much; a sheet counts as _SHEET
    thick, for a wall goes on in the cell above.
    """
    lower, upper, extent = boxes.lower, boxes.upper, boxes.surface_extent
    if (
        upper[q, 2] <= boxes.surface_height[p] + tolerance
        or lower[q, 2] >= boxes.surface_height[p] + headroom
    ):
        return False
    width, depth = extent[p, 1] - extent[p, 0], extent[p, 3] - extent[p, 2]
    along_x = min(extent[p, 1], upper[q, 0]) - max(extent[p, 0], lower[q, 0])
    along_y = min(extent[p, 3], upper[q, 1]) - max(extent[p, 2], lower[q, 1])
    shared = max(0.0, along_x + _SHEET) * max(0.0, along_y + _SHEET)
    return shared > 0.3 * (width + _SHEET) * (depth + _SHEET)


@kernel(nogil=True)
def free_tops(
    boxes: ObstacleArrays, headroom: float, tolerance: float
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """(m,) whether a box has free space above; whether its top is also as wide as the box."""
    cells, lower, upper = boxes.cells, boxes.lower, boxes.upper
    extent = boxes.surface_extent
    m = len(cells)
    nz = boxes.number_at.shape[2]
    free = np.zeros(m, np.bool_)
    top = np.zeros(m, np.bool_)
    layers = int(headroom / boxes.cell_size) + 1
    slack = 0.2 * boxes.cell_size  # boxes are closed up to their neighbours
    for p in range(m):
        if cells[p, 2] == nz - 1:
            continue  # what lies above was cropped away
        blocked = False
        for k in range(cells[p, 2], min(cells[p, 2] + layers + 1, nz)):
            q = boxes.number_at[cells[p, 0], cells[p, 1], k] - 1
            while q >= 0 and not blocked:
                blocked = q != p and _covers(boxes, q, p, headroom, tolerance)
                q = boxes.next[q]
            if blocked:
                break
        free[p] = not blocked
        width, depth = extent[p, 1] - extent[p, 0], extent[p, 3] - extent[p, 2]
        top[p] = not blocked and (
            upper[p, 2] - lower[p, 2] <= 2.0 * tolerance
            or (
                width + slack >= _TOP_SHARE * (upper[p, 0] - lower[p, 0])
                and depth + slack >= _TOP_SHARE * (upper[p, 1] - lower[p, 1])
            )
        )
    return free, top


@kernel(lean=True)
def _step_to(
    boxes: ObstacleArrays, free: npt.NDArray[np.bool_], p: int, i: int, j: int, reach: float
) -> float:
    """From the top of box p to the free top nearest in height in column i, j; inf beyond reach."""
    nx, ny, nz = boxes.number_at.shape
    best = np.inf
    if i < 0 or i >= nx or j < 0 or j >= ny:
        return best
    for k in range(max(boxes.cells[p, 2] - 2, 0), min(boxes.cells[p, 2] + 3, nz)):
        q = boxes.number_at[i, j, k] - 1
        while q >= 0:
            step = boxes.surface_height[q] - boxes.surface_height[p]
            if free[q] and abs(step) <= reach and abs(step) < abs(best):
                best = step
            q = boxes.next[q]
    return best


@kernel(nogil=True)
def _level(
    boxes: ObstacleArrays,
    free: npt.NDArray[np.bool_],
    top: npt.NDArray[np.bool_],
    max_tilt: float,
    scatter: float,
) -> npt.NDArray[np.bool_]:
    """Tops past which the surface does not go on up on one side and down on the other.

    By about as much: beside a low wall a floor that noise makes a little lower ahead is level.
    """
    level = top.copy()
    reach = 2.0 * boxes.cell_size
    # on a slope of max_tilt the columns two further differ by this, beyond the scatter
    rise = 2.0 * boxes.cell_size * max_tilt + scatter
    for p in range(len(top)):
        if not top[p]:
            continue
        i, j = boxes.cells[p, 0], boxes.cells[p, 1]
        for axis in range(2):
            di, dj = 1 - axis, axis
            back = _step_to(boxes, free, p, i - di, j - dj, reach)
            ahead = _step_to(boxes, free, p, i + di, j + dj, reach)
            if not (back < np.inf and ahead < np.inf and back * ahead < 0.0):
                continue
            less, more = min(abs(back), abs(ahead)), max(abs(back), abs(ahead))
            if less + more > rise and less >= _ALIKE * more:
                level[p] = False
    return level


@kernel(nogil=True)
def _merge(
    boxes: ObstacleArrays, rows: npt.NDArray[np.int64], tolerance: float
) -> tuple[Index, Array, Array]:
    """Boxes of one column at one height, split by a face between layers, as one surface each."""
    cells, height, extent = boxes.cells, boxes.surface_height, boxes.surface_extent
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


@kernel(lean=True)
def _at_height(
    start: npt.NDArray[np.int64], height: Array, column: int, z: float, tolerance: float
) -> int:
    """The surface of that column within the tolerance of z, or -1."""
    for s in range(start[column], start[column + 1]):
        if abs(height[s] - z) <= tolerance:
            return s
    return -1


@kernel(lean=True)
def _around(
    tops: _Tops, start: npt.NDArray[np.int64], ny: int, i: int, j: int, z: float, tolerance: float
) -> tuple[int, float, int]:
    """How many of four columns around i, j have a surface at height z; their sum; the first."""
    total, found, first = 0.0, 0, len(tops.cells)
    for side in range(4):
        column = (i + (1, -1, 0, 0)[side]) * ny + j + (0, 0, 1, -1)[side]
        t = _at_height(start, tops.height, column, z, tolerance)
        if t >= 0:
            total += tops.height[t]
            found += 1
            first = min(first, t)
    return found, total, first


@kernel(nogil=True)
def _holes(
    boxes: ObstacleArrays,
    tops: _Tops,
    start: npt.NDArray[np.int64],
    headroom: float,
    tolerance: float,
) -> list[tuple[float, ...]]:
    """Columns in which nothing was measured and at least three of four sides are surface.

    Only where the surface is sampled thinly: a real slot shows points further down.

    Returns:
        Per column the cell, the height and the extent of the surface that it is taken for.
    """
    nx, ny, nz = boxes.number_at.shape
    size = boxes.cell_size
    layers = int(headroom / size) + 1
    holes: list[tuple[float, ...]] = []
    for s in range(len(tops.cells)):
        layer = tops.cells[s, 2]
        for turn in range(4):
            i = tops.cells[s, 0] + (1, -1, 0, 0)[turn]
            j = tops.cells[s, 1] + (0, 0, 1, -1)[turn]
            if i < 1 or i >= nx - 1 or j < 1 or j >= ny - 1:
                continue
            found, total, first = _around(tops, start, ny, i, j, tops.height[s], 2.0 * tolerance)
            if found < 3 or first != s:  # each hole once
                continue
            empty = True
            for k in range(max(layer - layers, 0), min(layer + layers + 1, nz)):
                empty = empty and boxes.number_at[i, j, k] == 0
            if not empty:
                continue
            x0, y0 = boxes.origin[0] + i * size, boxes.origin[1] + j * size
            x1, y1 = x0 + size, y0 + size
            holes.append(
                (
                    float(i),
                    float(j),
                    float(layer),
                    total / found,
                    x0,
                    x1,
                    y0,
                    y1,
                    x0 + y0,
                    x1 + y1,
                    x0 - y1,
                    x1 - y0,
                )
            )
    return holes


@kernel(nogil=True)
def _close(
    tops: _Tops,
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
    cells, height, extent = tops.cells, tops.height, tops.extent
    rectangle = np.empty((len(cells), 4))
    diagonal = np.empty((len(cells), 4))
    goes_on = np.empty((3, 3), np.bool_)
    for s in range(len(cells)):
        # In which of the columns around, itself in the middle, the surface goes on.
        goes_on[:] = False
        for i in range(max(cells[s, 0] - 1, 0), min(cells[s, 0] + 2, nx)):
            for j in range(max(cells[s, 1] - 1, 0), min(cells[s, 1] + 2, ny)):
                goes_on[i - cells[s, 0] + 1, j - cells[s, 1] + 1] = (
                    _at_height(start, height, i * ny + j, height[s], 2.0 * tolerance) >= 0
                )
        # Sides.
        x0 = origin[0] + cells[s, 0] * cell_size
        y0 = origin[1] + cells[s, 1] * cell_size
        x1, y1 = x0 + cell_size, y0 + cell_size
        rectangle[s, 0] = min(x0, extent[s, 0]) if goes_on[0, 1] else extent[s, 0] + trim
        rectangle[s, 1] = min(y0, extent[s, 2]) if goes_on[1, 0] else extent[s, 2] + trim
        rectangle[s, 2] = max(x1, extent[s, 1]) if goes_on[2, 1] else extent[s, 1] - trim
        rectangle[s, 3] = max(y1, extent[s, 3]) if goes_on[1, 2] else extent[s, 3] - trim
        # Corners; an edge cell's points end short of the neighbour by their spacing: closed too.
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
