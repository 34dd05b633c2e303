"""How far apart the points of a surface lie, judged by how their neighbours surround them.

A disc that touches a point, with its centre in direction u from there, and grows until it meets
another point q has the radius |q - p|² / (2 u · (q - p)). The points of a surface seal off the
directions of at least a half circle around each of them, those at the edge of a bar too; the widest
disc of the half circle that is sealed best (`_half_sealed`) tells the spacing where the mean
density does not: on a square lattice it is 0.65 to 0.71 of that, of rows half of what they are
apart, whether beside the bar there is a gap or none.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.support_columns import Columns, surface_at
from placement_planner_ros.core.types import Array

TURNS = 32
_ANGLES = 2.0 * math.pi * np.arange(TURNS) / TURNS
COSINES, SINES = np.cos(_ANGLES).astype(np.float32), np.sin(_ANGLES).astype(np.float32)
COSINES.setflags(write=False)
SINES.setflags(write=False)
"""Of directions, an array each: so all of them are compared at once."""
SPIRAL = np.array(
    sorted(((i, j) for i in range(-2, 3) for j in range(-2, 3)), key=lambda at: max(map(abs, at)))
)
SPIRAL.setflags(write=False)
"""Columns (25, 2) within two of one, the nearest first."""
_ROOM = 48
SAMPLED = 3
"""Points of each column that are looked at."""
_FEW = 3
"""Where columns hold fewer points on average, columns two further are looked at too."""
_WIDER = 1.4
"""Times the spacing's discs is no gap even where points are ordered: 1.9 spacings of a lattice."""
_SCATTERED = 8.0
"""... and by so much more where discs differ: drawn at random, points leave holes 4 times as wide
as a lattice of the same density, one in 10,000 that wide."""
_LOW, _MIDDLE = 0.1, 0.4
"""Quantiles of the discs around that tell the spacing, and how much they differ. Beside a bar that
shows a single row of points discs are wide, so they are no higher."""
NARROWEST = 0.0025
"""m, radius of the smallest discs that are gaps without a line of sight through them."""
_WIDE = 0.85
"""Times what a point is from the nearest one is a wide disc; those of a lattice have 0.7 of it."""


@kernel(lean=True)
def least(values: npt.NDArray[np.float32]) -> float:
    """Of (32,) values."""
    found = values[0]
    for k in range(1, TURNS):
        found = min(found, values[k])
    return found


@kernel(lean=True)
def near_column(columns: Columns, i: int, j: int, x: float, y: float, far: float) -> bool:
    """Whether column i, j is on the map and nearer to x, y than that."""
    if i < 0 or j < 0 or i >= columns.nx or j >= columns.ny:
        return False
    left = columns.origin[0] + i * columns.cell_size - x
    front = columns.origin[1] + j * columns.cell_size - y
    dx = max(left, 0.0, -left - columns.cell_size)
    dy = max(front, 0.0, -front - columns.cell_size)
    return dx * dx + dy * dy < far * far


@kernel(lean=True)
def bends_around(
    columns: Columns, s: int, n: int, rings: int, bends: npt.NDArray[np.float32]
) -> None:
    """Fill `bends` (32,): one over the diameter of the widest disc that touches point n.

    In each direction; their radius is at most half of `rings` cells.
    """
    size = columns.cell_size
    x, y = columns.points[n, 0], columns.points[n, 1]
    bends[:] = np.float32(1.0 / (rings * size))
    far = rings * size
    ci = math.floor((x - columns.origin[0]) / size)
    cj = math.floor((y - columns.origin[1]) / size)
    for turn in range((2 * rings + 1) ** 2):
        # the middle first, so that what is further seldom needs a look
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
            if square >= far * far or square <= 1e-12:
                continue
            ex, ey = np.float32(dx / square), np.float32(dy / square)
            for k in range(TURNS):
                bend = ex * COSINES[k] + ey * SINES[k]
                bends[k] = bend if bend > bends[k] else bends[k]
        far = 1.0 / least(bends)


@kernel(lean=True)
def _half_sealed(bends: npt.NDArray[np.float32], room: npt.NDArray[np.float32]) -> float:
    """Radius of the widest disc in the half circle, of 15 directions, that is sealed best.

    Args:
        room: (`_ROOM`,) for the least of 2, 4 and 8 directions that follow each.
    """
    for k in range(len(room)):
        room[k] = bends[k % TURNS]
    for width in (1, 2, 4):
        for k in range(len(room) - width):
            room[k] = min(room[k], room[k + width])
    best = np.float32(0.0)
    for k in range(TURNS):
        best = max(best, min(room[k], room[k + 7]))
    return float(0.5 / best)


@kernel(inline=True)
def put_in_order(values: Array, count: int, value: float) -> None:
    """One more into values[:count], smallest first."""
    place = count
    while place > 0 and values[place - 1] > value:
        values[place] = values[place - 1]
        place -= 1
    values[place] = value


@kernel(nogil=True)
def narrowest_gaps(
    columns: Columns, cells: npt.NDArray[np.int32], asked: npt.NDArray[np.bool_]
) -> tuple[Array, Array]:
    """How wide discs without points are gaps, judged by the spacing of the points around.

    Args:
        cells: (s, 3) of the surfaces.
        asked: (s,) whether it is asked for.

    Returns:
        (s,) m, radius of the smallest disc that is a gap; inf where none can be told. (s,) share
        of the points around that have a wide disc beside them.
    """
    first = columns.first
    discs = np.full((len(columns.height), SAMPLED), np.inf)
    wide = np.zeros((len(columns.height), SAMPLED))
    bends, room = np.empty(TURNS, np.float32), np.empty(_ROOM, np.float32)
    # some points of each surface, evenly
    for s in range(len(columns.height)):
        if not asked[s]:
            continue
        around = 0
        for i in range(max(cells[s, 0] - 1, 0), min(cells[s, 0] + 2, columns.nx)):
            for j in range(max(cells[s, 1] - 1, 0), min(cells[s, 1] + 2, columns.ny)):
                column = i * columns.ny + j
                t = surface_at(
                    columns.start, columns.height, column, columns.height[s], columns.step
                )
                if t >= 0:
                    around += first[t + 1] - first[t]
        rings = 1 if around >= 9 * _FEW else 2
        held = first[s + 1] - first[s]
        for n in range(min(held, SAMPLED)):
            row = first[s] + n * held // min(held, SAMPLED)
            bends_around(columns, s, row, rings, bends)
            discs[s, n] = _half_sealed(bends, room)
            if 0.5 / least(bends) >= max(_WIDE / float(np.max(bends)), NARROWEST):
                wide[s, n] = 1.0
    # quantiles over the columns around
    result = np.full(len(columns.height), np.inf)
    beside = np.zeros(len(columns.height))
    near = np.empty(9 * SAMPLED)  # smallest first
    for s in range(len(columns.height)):
        if not asked[s]:
            continue
        count = 0
        for i in range(max(cells[s, 0] - 1, 0), min(cells[s, 0] + 2, columns.nx)):
            for j in range(max(cells[s, 1] - 1, 0), min(cells[s, 1] + 2, columns.ny)):
                column = i * columns.ny + j
                t = surface_at(
                    columns.start, columns.height, column, columns.height[s], columns.step
                )
                for n in range(SAMPLED):
                    if t >= 0 and discs[t, n] < np.inf:
                        put_in_order(near, count, discs[t, n])
                        count += 1
                        beside[s] += wide[t, n]
        if count == 0:
            continue
        beside[s] /= count
        low, middle = near[int(_LOW * count)], near[int(_MIDDLE * count)]
        result[s] = max(middle * (_WIDER + _SCATTERED * (1.0 - low / middle)), NARROWEST)
    # where density changes, the sparser side tells
    widest = result.copy()
    for s in range(len(columns.height)):
        if not asked[s]:
            continue
        for i in range(max(cells[s, 0] - 1, 0), min(cells[s, 0] + 2, columns.nx)):
            for j in range(max(cells[s, 1] - 1, 0), min(cells[s, 1] + 2, columns.ny)):
                column = i * columns.ny + j
                t = surface_at(
                    columns.start, columns.height, column, columns.height[s], columns.step
                )
                if t >= 0 and result[t] < np.inf:
                    widest[s] = max(widest[s], result[t])
    return widest, beside
