"""Meshes of wires, nets and baskets: surfaces that are mostly holes with points all around.

Points of a mesh are as far apart along its wires as the holes are wide, or half of that, so what
each point has around it does not tell them from sparse points of a table (`support_spacing`). What
lies around a hole does: beside the widest empty disc in it there are points in all directions,
while in a lattice, with rows however far apart, there are gaps of a quarter turn. A single point
left out of a lattice makes such a hole, too; it is a mesh where they are a good part of the
surface.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.support_columns import Columns, surface_at
from placement_planner_ros.core.scene.support_spacing import NARROWEST, SPIRAL, TURNS, near_column
from placement_planner_ros.core.types import Array

_RIM = 1.45
"""Times the radius of a disc: so far from its centre lie the points around it; 1.42 in a square."""
_OPEN = 4
"""Directions without such points, next to each other, at most where these surround it: 67 degrees.
Rows of points that are further apart than those along each leave 80."""
_SHARE = 0.15
"""Of places on a surface in discs that are surrounded so, from which on it is a mesh: of square
holes it is 0.2 to 0.6, of points drawn at random, of a lattice or not, 0.05 at most."""
_HINT = 2
"""Of the first places of the columns around, in such discs, from which on more are looked at."""
_BESIDE = 0.3
"""Share of points that have a wide disc beside them, at least: of those of a mesh 0.6 to 1."""
_LEAST = 8
"""Places in such discs tell a mesh."""
_GAP = 0.9
"""Times the radius of such discs is a gap in a mesh ..."""
_SPACINGS = 1.1
"""... and so is what is that many times as wide as the points around them are apart."""
_STEPS, _SHORTER = 14, 0.8
"""To the widest disc around a place, each so many times as long as the one before it."""
_FIRST = 4
"""Steps after which discs that are far too small are left."""
_PLACES = 4
"""Of each column."""
_SPREAD = 0.7548776662, 0.5698402910
"""What each place is from the next, in columns: spread evenly over what is periodic."""
_FAR = 3
"""Columns from a place to the points beside the widest disc around it, at most."""


@kernel(lean=True)
def _nearest_point(columns: Columns, s: int, x: float, y: float) -> tuple[float, float, float]:
    """From the point of surface s nearest to a place: dx, dy and how far it is, metres.

    inf if none is within `_FAR` columns.
    """
    size = columns.cell_size
    nearest, from_x, from_y = np.inf, 0.0, 0.0
    ci = math.floor((x - columns.origin[0]) / size)
    cj = math.floor((y - columns.origin[1]) / size)
    for ring in range(_FAR + 1):
        if (ring - 1) * size > nearest:
            break
        for i in range(ci - ring, ci + ring + 1):
            inner = ci - ring < i < ci + ring
            for j in range(cj - ring, cj + ring + 1, 2 * ring if inner else 1):
                if not near_column(columns, i, j, x, y, nearest):
                    continue
                column, step = i * columns.ny + j, 2.0 * columns.step
                t = surface_at(columns.start, columns.height, column, columns.height[s], step)
                if t < 0:
                    continue
                for m in range(columns.first[t], columns.first[t + 1]):
                    dx, dy = x - columns.points[m, 0], y - columns.points[m, 1]
                    square = dx * dx + dy * dy
                    if square < nearest * nearest:
                        nearest, from_x, from_y = math.sqrt(square), dx, dy
    return from_x, from_y, nearest


@kernel(lean=True)
def _ways_to_rim(
    columns: Columns, s: int, x: float, y: float, radius: float, seen: npt.NDArray[np.bool_]
) -> int:
    """In how many of 32 directions points lie beside an empty disc, up to `_RIM` times its radius.

    None if they do not lie all around it.

    Args:
        seen: (32,) for the directions.
    """
    seen[:] = False
    size, far = columns.cell_size, _RIM * radius
    i0 = math.floor((x - far - columns.origin[0]) / size)
    i1 = math.floor((x + far - columns.origin[0]) / size)
    j0 = math.floor((y - far - columns.origin[1]) / size)
    j1 = math.floor((y + far - columns.origin[1]) / size)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            if not near_column(columns, i, j, x, y, far):
                continue
            column, step = i * columns.ny + j, 2.0 * columns.step
            t = surface_at(columns.start, columns.height, column, columns.height[s], step)
            if t < 0:
                continue
            for m in range(columns.first[t], columns.first[t + 1]):
                dx, dy = columns.points[m, 0] - x, columns.points[m, 1] - y
                if dx * dx + dy * dy <= far * far:
                    seen[math.floor(math.atan2(dy, dx) * (0.5 * TURNS / math.pi)) % TURNS] = True
    ways, unseen = 0, 0
    for k in range(TURNS + _OPEN + 1):
        if seen[k % TURNS]:
            unseen = 0
            ways += int(k < TURNS)
        else:
            unseen += 1
            if unseen > _OPEN:
                return 0
    return ways


@kernel(lean=True)
def _gap_around(columns: Columns, s: int, x: float, y: float, seen: npt.NDArray[np.bool_]) -> float:
    """Radius of the smallest gap by the hole that a place is in, if points surround it; or 0.

    Args:
        seen: (32,) of `_ways_to_rim`.
    """
    widest, at_x, at_y = 0.0, x, y
    cx, cy, length = x, y, 0.5
    for step in range(_STEPS):  # away from the nearest point
        dx, dy, far = _nearest_point(columns, s, cx, cy)
        if not 0.0 < far < np.inf:
            break
        if far > widest:
            widest, at_x, at_y = far, cx, cy
        if step == _FIRST and widest < 0.6 * NARROWEST:
            return 0.0
        cx += length * dx
        cy += length * dy
        length *= _SHORTER
    if widest < NARROWEST or (x - at_x) ** 2 + (y - at_y) ** 2 >= widest * widest:
        return 0.0
    ways = _ways_to_rim(columns, s, at_x, at_y, widest, seen)
    if ways == 0:
        return 0.0
    spacing = math.pi * (1.0 + _RIM) * widest / ways  # along the rim
    return max(min(_GAP * widest, _SPACINGS * spacing), NARROWEST)


@kernel(lean=True)
def _around(
    columns: Columns, cells: npt.NDArray[np.int32], s: int, gaps: Array
) -> tuple[int, int, float]:
    """Of the places in the 25 columns around surface s: how many, how many in holes, least gap.

    Args:
        gaps: (s, n) of `_gap_around`; NaN for what was not looked at.
    """
    places, holes, smallest = 0, 0, np.inf
    for turn in range(len(SPIRAL)):
        i, j = cells[s, 0] + SPIRAL[turn, 0], cells[s, 1] + SPIRAL[turn, 1]
        if i < 0 or j < 0 or i >= columns.nx or j >= columns.ny:
            continue
        column, step = i * columns.ny + j, 2.0 * columns.step
        t = surface_at(columns.start, columns.height, column, columns.height[s], step)
        if t < 0:
            continue
        for n in range(gaps.shape[1]):
            places += int(not math.isnan(gaps[t, n]))
            if gaps[t, n] > 0.0:
                holes += 1
                smallest = min(smallest, gaps[t, n])
    return places, holes, smallest


@kernel(lean=True)
def _look(
    columns: Columns,
    cells: npt.NDArray[np.int32],
    s: int,
    places: range,
    gaps: Array,
    seen: npt.NDArray[np.bool_],
) -> None:
    """Fill gaps[s] for some places in the column of surface s."""
    for n in places:
        turn = (cells[s, 0] * columns.ny + cells[s, 1]) * _PLACES + n
        x = columns.origin[0] + (cells[s, 0] + turn * _SPREAD[0] % 1.0) * columns.cell_size
        y = columns.origin[1] + (cells[s, 1] + turn * _SPREAD[1] % 1.0) * columns.cell_size
        gaps[s, n] = _gap_around(columns, s, x, y, seen)


@kernel(nogil=True)
def gaps_of_meshes(columns: Columns, cells: npt.NDArray[np.int32], beside: Array) -> Array:
    """(s,) m, radius of the smallest disc without points that is a gap; inf where no mesh is told.

    Args:
        cells: (s, 3) of the surfaces.
        beside: (s,) share of the points around that have a wide disc beside them; 0 where none is
            asked for.
    """
    gaps = np.full((len(columns.height), _PLACES), np.nan)
    seen = np.empty(TURNS, np.bool_)
    for s in range(len(columns.height)):
        if beside[s] >= _BESIDE:
            _look(columns, cells, s, range(1), gaps, seen)
    hinted = np.zeros(len(columns.height), np.bool_)
    for s in range(len(columns.height)):
        hinted[s] = beside[s] >= _BESIDE and _around(columns, cells, s, gaps)[1] >= _HINT
    for s in range(len(columns.height)):
        if hinted[s]:
            _look(columns, cells, s, range(1, _PLACES), gaps, seen)
    result = np.full(len(columns.height), np.inf)
    for s in range(len(columns.height)):
        if hinted[s]:
            places, holes, smallest = _around(columns, cells, s, gaps)
            if holes >= max(_SHARE * places, _LEAST):
                result[s] = min(smallest, columns.cell_size)
    # so it is beside those columns, where points have wide discs too
    told = result.copy()
    for s in range(len(columns.height)):
        if beside[s] < _BESIDE or told[s] < np.inf:
            continue
        for turn in range(9):
            i, j = cells[s, 0] + SPIRAL[turn, 0], cells[s, 1] + SPIRAL[turn, 1]
            if i < 0 or j < 0 or i >= columns.nx or j >= columns.ny:
                continue
            column, step = i * columns.ny + j, 2.0 * columns.step
            t = surface_at(columns.start, columns.height, column, columns.height[s], step)
            if t >= 0:
                result[s] = min(result[s], told[t])
    return result
