"""A sound lower bound of the distance to the obstacle set, at every cell of the grid."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.obstacle_arrays import ObstacleArrays
from placement_planner_ros.core.types import SINGLE_ROUNDING, Array, Mask
from placement_planner_ros.core.uncounted import Uncounted

Field = npt.NDArray[np.float32]
Levels = npt.NDArray[np.uint8]

_LEVELS = int(np.iinfo(np.uint8).max)
"""Steps to the cap."""
_EXACT = 2.5
"""Cells up to which distances are exact."""
_TILE = 4
"""Cells along each side of a tile."""
_SCATTERED = 2 * _TILE
"""Cells of a column that are looked at around a box, all at once: five, and three for nothing."""
_ROUNDED = float(np.finfo(np.float32).eps)
"""Share of the greatest squared distance by which differences of two are wrong at most."""


@dataclass(frozen=True, slots=True, eq=False)
class DistanceBound:
    """Bounds of the Euclidean distance to the obstacle set at the centre of each cell, in steps.

    With l the level of a cell and c its centre, the distance of any point p to the nearest box is

        at least l step - |p - c|, and where l < exact at most (l + 1) step + |p - c|.

    Cells lie in tiles of 4 x 4 x 4, each a cache line, since what is looked up in turn is close.

    Attributes:
        origin: (3,) lower corner of the grid, that of the obstacle set.
        cell_size: metres.
        shape: (nx, ny, nz) cells.
        step: metres.
        exact: the level from which on there is no upper bound.
        levels: (tx, ty, tz, 64) uint8; of cell (i, j, k) at
            (i // 4, j // 4, k // 4, 16 (i % 4) + 4 (j % 4) + k % 4), 0 outside of the shape.
    """

    origin: Array
    cell_size: float
    shape: tuple[int, int, int]
    step: float
    exact: int
    levels: Levels


def distance_bound_field(obstacles: ObstacleSet, cap: float = 0.3) -> DistanceBound:
    """Bound the distance from the centre of every cell to the boxes of the obstacle set.

    Exact up to 2.5 cells. Beyond, exact in z and to the near face of the box's cell in x and y:
    too low by at most a cell in each. All rounded down to a step.

    Args:
        cap: greatest value, metres; larger ones cost time.
    """
    if not (math.isfinite(cap) and cap > 0.0):
        raise ParameterError("cap", cap, "give a finite length above 0 m")
    step = cap / _LEVELS
    tiles = [-(-cells // _TILE) for cells in obstacles.shape]
    steps = int(cap / obstacles.cell_size + 0.5) + 1
    first_cell, reached = _reached_cells(obstacles, steps)
    # memory of numpy's takes less time to get than that of kernels
    levels, values = np.empty((*tiles, _TILE**3), np.uint8), np.empty(reached, np.float32)
    per_metre = (1.0 - SINGLE_ROUNDING) / step
    # further than the cap from all boxes; outside of the shape nothing is known
    levels[:] = int(cap * per_metre)
    by_axis = levels.reshape(*tiles, _TILE, _TILE, _TILE)
    for axis, cells in enumerate(obstacles.shape):
        np.moveaxis(by_axis, (axis, 3 + axis), (0, 1))[-1, _TILE - -cells % _TILE :] = 0
    _distance_bound(obstacles.arrays, cap, per_metre, steps, first_cell, values, levels)
    levels.setflags(write=False)
    exact = int(
        min(_EXACT * obstacles.cell_size / step * (1.0 - 10.0 * SINGLE_ROUNDING), _LEVELS - 1)
    )
    return DistanceBound(
        obstacles.origin, obstacles.cell_size, obstacles.shape, step, exact, levels
    )


def _reached_cells(
    obstacles: ObstacleSet, steps: int
) -> tuple[tuple[int, int, int], tuple[int, int, int]]:
    """First cell, of whole tiles, and number of the cells no more than `steps` from any box."""
    if not len(obstacles):
        return (0, 0, 0), (0, 0, 0)
    along = obstacles.cells.T
    first = [max(int(line.min()) - steps, 0) // _TILE * _TILE for line in along]
    last = [
        min(int(line.max()) + steps + 1, n) for line, n in zip(along, obstacles.shape, strict=True)
    ]
    size = [b - a for a, b in zip(first, last, strict=True)]
    return (first[0], first[1], first[2]), (size[0], size[1], size[2])


@njit(cache=True, nogil=True)
def _distance_bound(
    boxes: ObstacleArrays,
    cap: float,
    per_metre: float,
    steps: int,
    first_cell: tuple[int, int, int],
    values: Field,
    levels: Levels,
) -> None:
    """Fill the levels of the field: in z, then along y, then along x, then exact near the boxes.

    Made around the boxes only, for the cells from the first on that `values` (nx, ny, nz) are room
    for; further than the cap, `steps` cells, from all of them everything is at the cap.
    """
    cells, size = boxes.cells, boxes.cell_size
    nx, ny, nz = values.shape
    values[:] = np.float32(cap * cap)
    column_used = np.zeros((nx, ny), np.bool_)
    plane_used = np.zeros(nx, np.bool_)
    # boxes of one column follow each other
    m = len(cells)
    first = 0
    while first < m:
        last = first
        while last < m and cells[last, 0] == cells[first, 0] and cells[last, 1] == cells[first, 1]:
            last += 1
        i, j = cells[first, 0] - first_cell[0], cells[first, 1] - first_cell[1]
        column_used[i, j] = plane_used[i] = True
        # the least square in z from the middle of each of its cells to any of them: upwards to the
        # highest of the cells below and those of the cell itself, and downwards
        column, z = values[i, j], boxes.origin[2] + (first_cell[2] + 0.5) * size
        for side in range(-1, 2, 2):
            r, nearest = first if side < 0 else last - 1, -math.inf
            for n in range(nz):
                k = n if side < 0 else nz - 1 - n
                middle, away = z + k * size, -nearest - side * (z + k * size)
                while first <= r < last and boxes.cells[r, 2] - first_cell[2] == k:
                    low, high = boxes.lower[r, 2], boxes.upper[r, 2]
                    away = min(away, max(low - middle, middle - high))
                    nearest = max(nearest, high if side < 0 else -low)
                    r -= side
                gap = np.float32(max(away, 0.0))
                column[k] = min(column[k], gap * gap)
        first = last
    # counted is up to the near face of a line's cells
    gaps = (((np.arange(steps + 1) - 0.5) * size) ** 2).astype(np.float32)
    gaps[0] = 0.0
    # along y within each plane that holds boxes, from a copy of it
    for i in range(nx):
        if plane_used[i]:
            _lower_lines(values[i], values[i].copy(), column_used[i], gaps, cap * cap)
    # and along x, across all planes
    for j in range(ny):
        _lower_lines(values[:, j], values[:, j].copy(), plane_used, gaps, cap * cap)
    _put_levels(boxes, values, first_cell, np.float32(cap * cap), per_metre, levels)


@njit(cache=True, nogil=True, pipeline_class=Uncounted, fastmath={"nnan", "nsz", "reassoc"})
def _lower_lines(targets: Field, slab: Field, used: Mask, gaps: Field, greatest: float) -> None:
    """Lower the squared distances (l, nz) of lines beside each other by those of the others.

    A line counts for those beyond its neighbour only where it is lower than that by more than the
    neighbour is nearer. On surfaces that go on, which most lines are in, it never is.

    Args:
        slab: (l, nz) the same before, none above `greatest`; `used` (l,) says which hold anything.
        gaps: (steps + 1,) squared distance to the line so many lines away, 0 first.
    """
    steps, lines = len(gaps) - 1, len(used)
    for source in range(lines):
        if not used[source]:
            continue
        for side in range(-1, 2, 2):
            # no further than where it is lower than its neighbour by enough
            reach = min(steps, lines - 1 - source if side > 0 else source)
            if reach > 0:
                most, line, other = np.float32(0.0), slab[source], slab[source + side]
                for k in range(len(line)):  # many at once
                    above = other[k] - line[k]
                    most = above if above > most else most
                for step in range(1, reach + 1):
                    nearer = float(gaps[step]) - float(gaps[step - 1])
                    if nearer >= float(most) + _ROUNDED * greatest:
                        reach = step - 1
                        break
            # lower the lines within that reach
            for step in range(1, reach + 1):
                target, line, gap = targets[source + side * step], slab[source], gaps[step]
                for k in range(len(target)):
                    candidate = line[k] + gap
                    target[k] = candidate if candidate < target[k] else target[k]


@njit(cache=True, nogil=True)
def _put_levels(
    boxes: ObstacleArrays,
    squared: Field,
    first_cell: tuple[int, int, int],
    farthest: np.float32,
    per_metre: float,
    levels: Levels,
) -> None:
    """The root of each squared distance in tiled levels, exact where all near boxes are known.

    Boxes of cells more than two away are at least 2.5 cells from the centre.

    Args:
        squared: (nx, ny, nz) of the cells from `first_cell` on; `farthest` of all others.
    """
    nx, ny, nz = squared.shape
    i, j, k = first_cell
    beyond = np.float32((_EXACT * boxes.cell_size) ** 2)
    # planes i - 2 .. i + 2, cyclic, with two cells before each column and room for `_SCATTERED`
    exact = np.full((5, ny, nz + 2 + _SCATTERED), beyond, np.float32)
    tile_i, tile_j, tile_k = i // _TILE, j // _TILE, k // _TILE
    tiles = (nz + _TILE - 1) // _TILE
    scale, greatest = np.float32(per_metre), np.float32(_LEVELS)
    far = np.uint8(min(math.sqrt(farthest) * scale, greatest))
    line = np.full(_TILE * tiles, far, np.uint8)
    line[boxes.number_at.shape[2] - k :] = 0  # outside of the grid
    fours, line_fours = levels.view(np.uint32), line.view(np.uint32)
    apart = np.full((3, _SCATTERED), np.inf, np.float32)
    row = 0
    m = len(boxes.cells)
    for plane in range(nx + 2):
        # the boxes of this plane, which count up to two planes away
        while row < m and boxes.cells[row, 0] - i == plane:
            _scatter_box(boxes, row, first_cell, apart, exact, nx)
            row += 1
        # a plane is finished once that two further on has been scattered
        done = plane - 2
        if done >= 0:
            near = exact[done % 5]
            for y in range(ny):
                # the root of each, no less than what is exact nearby, rounded down
                for z in range(nz):
                    value = max(squared[done, y, z], near[y, 2 + z])
                    line[z] = np.uint8(min(math.sqrt(value) * scale, greatest))
                # its line of levels goes into the tiles, four cells at a time
                column = fours[tile_i + done // _TILE, tile_j + y // _TILE]
                for tile in range(tiles):
                    column[tile_k + tile, 4 * (done % 4) + y % 4] = line_fours[tile]
            # emptied for the plane that takes its place
            near[:] = beyond


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _scatter_box(
    boxes: ObstacleArrays,
    row: int,
    first_cell: tuple[int, int, int],
    apart: Field,
    exact: Field,
    nx: int,
) -> None:
    """Lower the exact squared distances of the cells up to two away from the box's.

    Args:
        apart: (3, `_SCATTERED`) room for squared distances along each axis, infinite in the end.
    """
    ny = exact.shape[1]
    size = boxes.cell_size
    # how far the five cells along each axis are from the box along it
    for axis in range(3):
        low, high, cell = boxes.lower[row, axis], boxes.upper[row, axis], boxes.cells[row, axis]
        for n in range(5):
            middle = boxes.origin[axis] + (cell - 2 + n + 0.5) * size
            gap = max(low - middle, 0.0, middle - high)
            apart[axis, n] = gap * gap
    # the least of what was known and this box, for all of them
    ci = boxes.cells[row, 0] - first_cell[0] - 2
    cj = boxes.cells[row, 1] - first_cell[1] - 2
    ck = boxes.cells[row, 2] - first_cell[2]
    along = apart[2]
    for i in range(max(ci, 0), min(ci + 5, nx)):
        for j in range(max(cj, 0), min(cj + 5, ny)):
            beside = apart[0, i - ci] + apart[1, j - cj]
            near = exact[i % 5, j, ck : ck + _SCATTERED]
            for k in range(_SCATTERED):
                d = beside + along[k]
                near[k] = d if d < near[k] else near[k]
