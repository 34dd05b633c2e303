"""Gaps in surfaces: discs without points that are wider than what the points leave anyway."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.obstacle_arrays import ObstacleArrays
from placement_planner_ros.core.scene.support_columns import Columns, surface_at
from placement_planner_ros.core.scene.support_ends import thing_between
from placement_planner_ros.core.scene.support_points import WITHIN, on_surface
from placement_planner_ros.core.scene.support_spacing import (
    COSINES,
    SINES,
    SPIRAL,
    TURNS,
    bends_around,
    least,
    near_column,
)
from placement_planner_ros.core.types import Array

_SQUARES = 6
"""Along each edge of a column, in which discs' centres may lie."""
PARTS = 8
"""Along each edge of a column, of which is known whether they lie in gaps as a whole."""


@kernel(lean=True)
def _is_sealed(
    columns: Columns, s: int, n: int, radius: float, into: npt.NDArray[np.float32]
) -> bool:
    """Whether no disc of that radius without points touches point n.

    Args:
        into: (32,), filled: above 0 where points lie in the disc of that direction.
    """
    size = columns.cell_size
    x, y = columns.points[n, 0], columns.points[n, 1]
    into[:] = np.float32(0.0)
    far = 2.0 * radius
    twice = np.float32(far)
    ci = math.floor((x - columns.origin[0]) / size)
    cj = math.floor((y - columns.origin[1]) / size)
    for turn in range(len(SPIRAL)):
        i, j = ci + SPIRAL[turn, 0], cj + SPIRAL[turn, 1]
        if not near_column(columns, i, j, x, y, far):
            continue
        away = max(abs(i - ci), abs(j - cj), 1)
        t = surface_at(
            columns.start,
            columns.height,
            i * columns.ny + j,
            columns.height[s],
            away * columns.step,
        )
        if t < 0:
            continue
        for m in range(columns.first[t], columns.first[t + 1]):
            dx, dy = columns.points[m, 0] - x, columns.points[m, 1] - y
            square = dx * dx + dy * dy
            if square >= far * far:
                continue
            ex, ey = np.float32(twice * dx), np.float32(twice * dy)
            for k in range(TURNS):
                inside = ex * COSINES[k] + ey * SINES[k] - square
                into[k] = inside if inside > into[k] else into[k]
        if least(into) > 0.0:
            return True
    return False


@kernel(lean=True)
def _point_within(columns: Columns, s: int, x: float, y: float, far: float) -> bool:
    """Whether a point of surface s lies nearer to x, y than that, at most a cell."""
    ci = math.floor((x - columns.origin[0]) / columns.cell_size)
    cj = math.floor((y - columns.origin[1]) / columns.cell_size)
    for turn in range(9):
        i, j = ci + SPIRAL[turn, 0], cj + SPIRAL[turn, 1]
        if not near_column(columns, i, j, x, y, far):
            continue
        step = columns.step if turn == 0 else 2.0 * columns.step
        t = surface_at(columns.start, columns.height, i * columns.ny + j, columns.height[s], step)
        if t < 0:
            continue
        for m in range(columns.first[t], columns.first[t + 1]):
            dx, dy = columns.points[m, 0] - x, columns.points[m, 1] - y
            if dx * dx + dy * dy < far * far:
                return True
    return False


@kernel(nogil=True)
def _loose(
    columns: Columns, cells: npt.NDArray[np.int32], narrowest: Array
) -> npt.NDArray[np.bool_]:
    """(s,) surfaces in whose columns the centre of a disc without points may lie.

    None lies in a square whose middle is nearer to a point than the disc's radius less half of the
    square's diagonal.
    """
    loose = np.zeros(len(columns.height), np.bool_)
    edge = columns.cell_size / _SQUARES
    for s in range(len(columns.height)):
        if narrowest[s] > columns.cell_size:
            continue
        far = narrowest[s] - math.sqrt(0.5) * edge
        left = columns.origin[0] + cells[s, 0] * columns.cell_size
        front = columns.origin[1] + cells[s, 1] * columns.cell_size
        for square in range(_SQUARES * _SQUARES):
            x = left + (square // _SQUARES + 0.5) * edge
            y = front + (square % _SQUARES + 0.5) * edge
            if far <= 0.0 or not _point_within(columns, s, x, y, far):
                loose[s] = True
                break
    return loose


@kernel(lean=True)
def _is_beside(
    columns: Columns,
    cells: npt.NDArray[np.int32],
    marked: npt.NDArray[np.bool_],
    s: int,
) -> bool:
    """Whether a column around that of surface s holds no such surface, or a marked one."""
    for turn in range(9):
        i, j = cells[s, 0] + SPIRAL[turn, 0], cells[s, 1] + SPIRAL[turn, 1]
        if i < 0 or j < 0 or i >= columns.nx or j >= columns.ny:
            return True
        column = i * columns.ny + j
        t = surface_at(columns.start, columns.height, column, columns.height[s], columns.step)
        if t < 0 or marked[t]:
            return True
    return False


@kernel(nogil=True)
def empty_discs(
    columns: Columns, boxes: ObstacleArrays, cells: npt.NDArray[np.int32], narrowest: Array
) -> Array:
    """(k, 4) x, y, radius and height of discs without points, as wide as a gap, that touch points.

    What a thing that stands on a surface covers is no gap in it.

    Args:
        boxes: what stands around.
        cells: (s, 3) of the surfaces.
        narrowest: (s,) m, radius of the smallest disc that is a gap.
    """
    loose = _loose(columns, cells, narrowest)
    found = np.empty((1024, 4))
    edge = columns.cell_size / _SQUARES
    into = np.empty(TURNS, np.float32)
    bends = np.empty(TURNS, np.float32)
    count = 0
    for s in range(len(columns.height)):
        radius, z = narrowest[s], columns.height[s]
        if radius > columns.cell_size or not _is_beside(columns, cells, loose, s):
            continue
        # that touch a point of the surface
        for n in range(columns.first[s], columns.first[s + 1]):
            if _is_sealed(columns, s, n, radius, into):
                continue
            bends_around(columns, s, n, 2, bends)
            for k in range(TURNS):
                widest = 0.5 / bends[k]
                if widest < radius:
                    continue
                x, y = float(columns.points[n, 0]), float(columns.points[n, 1])
                dx, dy = radius * COSINES[k], radius * SINES[k]
                # what is not surrounded here, nor halfway to the other side, is no gap but an end
                ahead = min(widest, columns.cell_size) / radius
                if (
                    on_surface(columns, x + dx, y + dy, z, columns.step) < 0
                    and on_surface(columns, x + ahead * dx, y + ahead * dy, z, columns.step) < 0
                ):
                    continue
                if not thing_between(columns, boxes, x, y, z, dx, dy):
                    count, found = _add(found, count, x + dx, y + dy, radius, z)
        # that are further from all of them
        for square in range(_SQUARES * _SQUARES if loose[s] else 0):
            x = columns.origin[0] + cells[s, 0] * columns.cell_size
            y = columns.origin[1] + cells[s, 1] * columns.cell_size
            x += (square // _SQUARES + 0.5) * edge
            y += (square % _SQUARES + 0.5) * edge
            if _point_within(columns, s, x, y, radius):
                continue
            if on_surface(columns, x, y, z, columns.step) >= 0:
                count, found = _add(found, count, x, y, radius, z)
    return found[:count].copy()


@kernel(nogil=True)
def _add(
    found: Array, count: int, x: float, y: float, radius: float, z: float
) -> tuple[int, Array]:
    """One disc more, and room for the next."""
    if count == len(found):
        found = np.concatenate((found, np.empty_like(found)))
    found[count, 0], found[count, 1], found[count, 2], found[count, 3] = x, y, radius, z
    return count + 1, found


@kernel(nogil=True)
def by_surface(columns: Columns, discs: Array) -> tuple[npt.NDArray[np.int64], Array]:
    """`Columns.first_hole` and `holes` of discs (k, 4)."""
    first = np.zeros(len(columns.height) + 1, np.int64)
    size = columns.cell_size
    holes = np.empty((0, 3))
    for _pass in range(2):  # count, then put into their places
        fill = first[:-1].copy()
        for n in range(len(discs)):
            x, y, radius = discs[n, 0], discs[n, 1], discs[n, 2]
            i0 = math.floor((x - radius - columns.origin[0]) / size)
            i1 = math.floor((x + radius - columns.origin[0]) / size)
            j0 = math.floor((y - radius - columns.origin[1]) / size)
            j1 = math.floor((y + radius - columns.origin[1]) / size)
            for i in range(i0, i1 + 1):
                for j in range(j0, j1 + 1):
                    if not near_column(columns, i, j, x, y, radius):
                        continue
                    column = i * columns.ny + j
                    for s in range(columns.start[column], columns.start[column + 1]):
                        if abs(columns.height[s] - discs[n, 3]) > 2.0 * columns.step:
                            continue
                        if _pass == 0:
                            first[s + 1] += 1
                        else:
                            holes[fill[s], 0], holes[fill[s], 1] = x, y
                            holes[fill[s], 2] = radius
                            fill[s] += 1
        if _pass == 0:
            for s in range(len(columns.height)):
                first[s + 1] += first[s]
            holes = np.empty((first[-1], 3))
    return first, holes


@kernel(nogil=True)
def parts_in_holes(
    columns: Columns, cells: npt.NDArray[np.int32], rows: npt.NDArray[np.int64]
) -> npt.NDArray[np.bool_]:
    """(k, 8, 8) which parts of the columns of surfaces `rows` lie in one gap as a whole each."""
    inside = np.zeros((len(rows), PARTS, PARTS), np.bool_)
    edge = columns.cell_size / PARTS
    for r in range(len(rows)):
        s = rows[r]
        for n in range(columns.first_hole[s], columns.first_hole[s + 1]):
            far = columns.holes[n, 2] - WITHIN - math.sqrt(0.5) * edge
            for a in range(PARTS):
                for b in range(PARTS):
                    x = columns.origin[0] + cells[s, 0] * columns.cell_size + (a + 0.5) * edge
                    y = columns.origin[1] + cells[s, 1] * columns.cell_size + (b + 0.5) * edge
                    dx, dy = x - columns.holes[n, 0], y - columns.holes[n, 1]
                    if far > 0.0 and dx * dx + dy * dy < far * far:
                        inside[r, a, b] = True
    return inside


@kernel(nogil=True)
def around_holes(
    rectangles: Array, lower: Array, edge: float, inside: npt.NDArray[np.bool_]
) -> tuple[Array, npt.NDArray[np.int64]]:
    """What of rectangles (k, 4) is not in gaps, as (n, 4) disjoint ones; (n,) of which each is.

    Args:
        lower: (k, 2) corner of the column of each.
        edge: of the parts of columns, metres.
        inside: (k, 8, 8) `parts_in_holes`.
    """
    found = np.empty((len(rectangles) * PARTS * PARTS // 2, 4))
    of = np.empty(len(found), np.int64)
    count = 0
    for r in range(len(rectangles)):
        begun = 0  # of the strips alike
        for a in range(PARTS):
            alike = a + 1 < PARTS
            for b in range(PARTS):
                alike = alike and inside[r, a, b] == inside[r, a + 1, b]
            if alike:
                continue
            x0 = rectangles[r, 0] if begun == 0 else lower[r, 0] + begun * edge
            x1 = rectangles[r, 2] if a + 1 == PARTS else lower[r, 0] + (a + 1) * edge
            x0, x1 = max(x0, rectangles[r, 0]), min(x1, rectangles[r, 2])
            begun = a + 1
            b = 0
            while b < PARTS:
                if inside[r, a, b]:
                    b += 1
                    continue
                low = b
                while b < PARTS and not inside[r, a, b]:
                    b += 1
                y0 = rectangles[r, 1] if low == 0 else lower[r, 1] + low * edge
                y1 = rectangles[r, 3] if b == PARTS else lower[r, 1] + b * edge
                y0, y1 = max(y0, rectangles[r, 1]), min(y1, rectangles[r, 3])
                if x1 > x0 and y1 > y0:
                    found[count, 0], found[count, 1] = x0, y0
                    found[count, 2], found[count, 3] = x1, y1
                    of[count] = r
                    count += 1
    return found[:count].copy(), of[:count].copy()
