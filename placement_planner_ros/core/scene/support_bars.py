"""Thin bars and rods: around what is on top of them there are points closely below.

A rod shows a row of points or two on top. Rods some way apart then look from above like a table of
which a line scanner saw rows; but below such a table nothing was measured, and beside the rows of
rods there are their flanks. Points along a bar then tell how wide a gap is, and one that is a gap
shows nothing closely below it either: a sheet shows its underside there, and bars on a table that.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.obstacle_arrays import ObstacleArrays
from placement_planner_ros.core.scene.support_columns import Columns, surface_at
from placement_planner_ros.core.scene.support_spacing import (
    NARROWEST,
    SAMPLED,
    SPIRAL,
    TURNS,
    near_column,
    put_in_order,
)
from placement_planner_ros.core.types import Array

_BESIDE = 0.008
"""m from a point on top of a bar to its flanks, at most."""
_DEPTH, _BELOW = 0.001, 0.012
"""m below a surface, at least and at most, are flanks and undersides."""
_INNER = 0.5
"""Share of a disc's radius within which nothing lies closely below a gap."""
_OPEN = 14
"""Directions without flanks, of 32, next to each other, at most: at an edge there are 16."""
_BARS = 0.25
"""Share of the points around that are on bars, from which on gaps are judged by these."""
_LOW, _HIGH = 0.1, 0.8
"""Quantiles of how far the next point on a bar is."""
_EVEN = 0.6
"""Times the higher is the lower one, at least: of points drawn at random, on sheets, it is 0.25."""
_GAP = 1.05
"""Times as far is the radius of a gap: little more than two such distances across."""


class Below(NamedTuple):
    """What lies closely below surfaces.

    Attributes:
        first: (nx * ny + 1,) the first of each column, and their number.
        points: (k, 3) metres.
    """

    first: npt.NDArray[np.int64]
    points: npt.NDArray[np.float32]


@kernel(nogil=True)
def points_below(
    columns: Columns,
    asked: npt.NDArray[np.bool_],
    boxes: ObstacleArrays,
    measured: npt.NDArray[np.float32],
    measured_first: npt.NDArray[np.int64],
) -> Below:
    """`Below` of those surfaces that are asked for, in their columns and around.

    Args:
        asked: (s,) whether it is asked for.
        boxes: of the obstacle set.
        measured, measured_first: (n, 3) all its points, (m + 1,) the first of each box.
    """
    first = np.zeros(columns.nx * columns.ny + 1, np.int64)
    points = np.empty((1024, 3), np.float32)
    n = 0
    size, floor = columns.cell_size, boxes.origin[2]
    for i in range(columns.nx):
        for j in range(columns.ny):
            lowest, highest = np.inf, -np.inf  # surface in the columns around
            for u in range(max(i - 1, 0), min(i + 2, columns.nx)):
                for v in range(max(j - 1, 0), min(j + 2, columns.ny)):
                    column = u * columns.ny + v
                    for s in range(columns.start[column], columns.start[column + 1]):
                        if asked[s]:
                            lowest = min(lowest, columns.height[s])
                            highest = max(highest, columns.height[s])
            if lowest < np.inf:
                begin = max(math.floor((lowest - _BELOW - floor) / size), 0)
                end = min(math.floor((highest - floor) / size) + 1, boxes.number_at.shape[2])
                for k in range(begin, end):
                    p = boxes.number_at[i, j, k] - 1
                    while p >= 0:
                        while n + measured_first[p + 1] - measured_first[p] > len(points):
                            points = np.concatenate((points, points))
                        for m in range(measured_first[p], measured_first[p + 1]):
                            if lowest - _BELOW < measured[m, 2] < highest - _DEPTH:
                                points[n] = measured[m]
                                n += 1
                        p = boxes.next[p]
            first[i * columns.ny + j + 1] = n
    return Below(first, points[:n].copy())


@kernel(lean=True)
def _has_flanks(
    columns: Columns,
    cells: npt.NDArray[np.int32],
    s: int,
    n: int,
    below: Below,
    seen: npt.NDArray[np.bool_],
) -> bool:
    """Whether flanks lie on both sides of point n of surface s, ahead and behind.

    Args:
        seen: (32,) for the directions.
    """
    seen[:] = False
    x, y = columns.points[n, 0], columns.points[n, 1]
    for turn in range(9):
        i, j = cells[s, 0] + SPIRAL[turn, 0], cells[s, 1] + SPIRAL[turn, 1]
        if not near_column(columns, i, j, x, y, _BESIDE):
            continue
        column = i * columns.ny + j
        for m in range(below.first[column], below.first[column + 1]):
            dx, dy = below.points[m, 0] - x, below.points[m, 1] - y
            lower = columns.height[s] - below.points[m, 2]
            beside = 0.0 < dx * dx + dy * dy < _BESIDE * _BESIDE
            if beside and _DEPTH < lower < _BELOW:
                seen[math.floor(math.atan2(dy, dx) * (0.5 * TURNS / math.pi)) % TURNS] = True
    unseen = 0
    for k in range(TURNS + _OPEN + 1):
        unseen = 0 if seen[k % TURNS] else unseen + 1
        if unseen > _OPEN:
            return False
    return True


@kernel(lean=True)
def _to_next(columns: Columns, cells: npt.NDArray[np.int32], s: int, n: int) -> float:
    """How far the next point of a surface is, m; 1.5 cells where none is so near."""
    far = 1.5 * columns.cell_size
    x, y = columns.points[n, 0], columns.points[n, 1]
    for turn in range(len(SPIRAL)):
        i, j = cells[s, 0] + SPIRAL[turn, 0], cells[s, 1] + SPIRAL[turn, 1]
        if not near_column(columns, i, j, x, y, far):
            continue
        column = i * columns.ny + j
        t = surface_at(columns.start, columns.height, column, columns.height[s], columns.step)
        if t < 0:
            continue
        for m in range(columns.first[t], columns.first[t + 1]):
            dx, dy = columns.points[m, 0] - x, columns.points[m, 1] - y
            square = dx * dx + dy * dy
            if 1e-12 < square < far * far:
                far = math.sqrt(square)
    return far


@kernel(nogil=True)
def gaps_of_bars(
    columns: Columns,
    cells: npt.NDArray[np.int32],
    asked: npt.NDArray[np.bool_],
    below: Below,
) -> Array:
    """(s,) m, radius of the smallest disc without points that is a gap; inf where no bars are told.

    Args:
        cells: (s, 3) of the surfaces.
        asked: (s,) whether it is asked for.
    """
    result = np.full(len(columns.height), np.inf)
    if len(below.points) == 0:
        return result
    apart = np.full((len(columns.height), SAMPLED), np.nan)
    seen = np.empty(TURNS, np.bool_)
    for s in range(len(columns.height)):
        held = columns.first[s + 1] - columns.first[s]
        for n in range(min(held, SAMPLED) if asked[s] else 0):
            row = columns.first[s] + n * held // min(held, SAMPLED)
            on_bar = _has_flanks(columns, cells, s, row, below, seen)
            apart[s, n] = _to_next(columns, cells, s, row) if on_bar else 0.0
    near = np.empty(9 * SAMPLED)  # smallest first
    for s in range(len(columns.height)):
        if not asked[s]:
            continue
        points, bars = 0, 0
        for turn in range(9):
            i, j = cells[s, 0] + SPIRAL[turn, 0], cells[s, 1] + SPIRAL[turn, 1]
            if i < 0 or j < 0 or i >= columns.nx or j >= columns.ny:
                continue
            column = i * columns.ny + j
            t = surface_at(columns.start, columns.height, column, columns.height[s], columns.step)
            for n in range(SAMPLED if t >= 0 else 0):
                points += int(not math.isnan(apart[t, n]))
                if apart[t, n] > 0.0:
                    put_in_order(near, bars, apart[t, n])
                    bars += 1
        if bars == 0 or bars < _BARS * points:
            continue
        low, high = near[int(_LOW * bars)], near[int(_HIGH * bars)]
        if low >= _EVEN * high:
            result[s] = max(_GAP * high, NARROWEST)
    return result


@kernel(nogil=True)
def nothing_below(columns: Columns, below: Below, discs: Array) -> npt.NDArray[np.bool_]:
    """(k,) whether nothing lies closely below the inner part of discs (k, 4) x, y, radius, z."""
    result = np.ones(len(discs), np.bool_)
    size = columns.cell_size
    for n in range(len(discs)):
        x, y, far = discs[n, 0], discs[n, 1], _INNER * discs[n, 2]
        for i in range(
            math.floor((x - far - columns.origin[0]) / size),
            math.floor((x + far - columns.origin[0]) / size) + 1,
        ):
            for j in range(
                math.floor((y - far - columns.origin[1]) / size),
                math.floor((y + far - columns.origin[1]) / size) + 1,
            ):
                if not near_column(columns, i, j, x, y, far):
                    continue
                column = i * columns.ny + j
                for m in range(below.first[column], below.first[column + 1]):
                    dx, dy = below.points[m, 0] - x, below.points[m, 1] - y
                    lower = discs[n, 3] - below.points[m, 2]
                    if dx * dx + dy * dy < far * far and _DEPTH < lower < _BELOW:
                        result[n] = False
    return result
