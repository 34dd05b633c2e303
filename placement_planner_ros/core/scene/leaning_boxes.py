"""Boxes around what leans or is round, cut into slices as high as a clearance field's slabs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.tight_boxes import CORNER, measure_outline
from placement_planner_ros.core.types import Array

_RECEDES = 0.15
"""Where neither the upper nor the lower half of its points stays further than this share of a cell
from any side of what is around all of them, a box is upright."""
_NOISE = 3.0
"""The same in noise, by which a half of a few points recedes: this many standard deviations."""
_HIGH = 0.05
"""Boxes lower than this share of a cell are flat."""
_ALIKE = 0.1
"""Slices are one where the lower ones reach further by less than this share of a cell,"""
_SHORTER = 3.0
"""or less far by this many times as much."""
_WAYS = 8
"""Directions in which it is asked how far points reach."""
_COS, _SIN = (np.array([way(2.0 * math.pi * d / _WAYS) for d in range(_WAYS)])
              for way in (math.cos, math.sin))  # fmt: skip
_THIN = 0.02
"""Boxes whose outlines are thinner than this share of a cell are of an upright plane."""
_PLANE = 5
"""Points that tell a plane: few enough lie in a thin outline by chance."""
_LEAST = 3
"""Points of a box that tell how it leans."""

_ROUNDING = 1e-6
"""m: points are kept in single precision."""


class CountedBoxes(NamedTuple):
    """k boxes that count for the clearance."""

    lower: Array
    """(k, 3) corner."""
    upper: Array
    outline: npt.NDArray[np.float32]
    """(k, 6) `ObstacleSet.outline`."""
    cells: npt.NDArray[np.int32]
    """(k, 3) in which they lie."""
    ends: Array
    """(k,) z up to which each counts."""


def sliced(
    obstacles: ObstacleSet, rows: npt.NDArray[np.int64], ends: Array, low: float, rise: float
) -> CountedBoxes:
    """Boxes that count, those that lean in slices from `low` + n · `rise` up to the next.

    The box around a slope reaches as far at its top as at its foot. Slices hold the points measured
    at their heights, so that the clearance beside balls, cones and ramps does not depend on where
    the cells lie. The highest slice ends at its highest point, the others at the mean height of
    their points, since what they hold begins further down.

    Args:
        rows: (k,) of the boxes.
        ends: (k,) z up to which each of them counts.
        low: of the lowest level; what ends below it is left out.
    """
    lower, upper = obstacles.lower[rows], obstacles.upper[rows]
    first, count = obstacles.first_point[rows], np.diff(obstacles.first_point)[rows]
    outline = obstacles.outline[rows]
    thin = np.minimum(outline[:, 3] - outline[:, 2], outline[:, 5] - outline[:, 4])
    high = (upper[:, 2] - lower[:, 2] > _HIGH * obstacles.cell_size) & (count >= _LEAST)
    high &= (thin > _THIN * obstacles.cell_size) | (count < _PLANE)
    recedes = max(_RECEDES * obstacles.cell_size, _NOISE * obstacles.noise)
    leans = _leans(obstacles.points, first, count, high, recedes)
    whole = CountedBoxes(lower, upper, outline, obstacles.cells[rows], ends)
    if not leans.any():
        return whole
    at = np.flatnonzero(leans)
    found = _slices(
        obstacles.points,
        first[at],
        count[at],
        (low, rise, CORNER * obstacles.cell_size, _ALIKE * obstacles.cell_size),
    )
    of, bottom, top, outlines, middle = found
    of = at[of]
    highest = np.append(True, of[1:] != of[:-1])
    last = np.minimum(np.where(highest, top[:, 2], middle), ends[of])
    counts = (last >= low) & (bottom[:, 2] <= last + _ROUNDING)
    upright = ~leans
    return CountedBoxes(
        np.concatenate([lower[upright], bottom[counts]]),
        np.concatenate([upper[upright], top[counts]]),
        np.concatenate([whole.outline[upright], outlines[counts]]),
        np.concatenate([whole.cells[upright], whole.cells[of[counts]]]),
        np.concatenate([ends[upright], last[counts]]),
    )


@kernel(nogil=True)
def _leans(
    points: npt.NDArray[np.float32],
    first: npt.NDArray[np.int64],
    count: npt.NDArray[np.int64],
    asked: npt.NDArray[np.bool_],
    recedes: float,
) -> npt.NDArray[np.bool_]:
    """(k,) which of the boxes asked for, of points[first : first + count], lean or are round."""
    leans = np.zeros(len(first), np.bool_)
    lower, upper = np.empty(_WAYS), np.empty(_WAYS)
    for n in range(len(first)):
        if not asked[n]:
            continue
        lowest, highest = np.inf, -np.inf
        for p in range(first[n], first[n] + count[n]):
            lowest, highest = min(lowest, points[p, 2]), max(highest, points[p, 2])
        lower[:], upper[:] = -np.inf, -np.inf
        for p in range(first[n], first[n] + count[n]):
            half = lower if points[p, 2] < 0.5 * (lowest + highest) else upper
            _reach(points[p, 0], points[p, 1], half)
        for d in range(_WAYS):
            leans[n] = leans[n] or abs(upper[d] - lower[d]) > recedes
    return leans


@kernel(lean=True)
def _reach(x: float, y: float, reach: Array) -> None:
    """Let `reach` (8,), how far points reach in each way, include one."""
    for d in range(_WAYS):
        along = _COS[d] * x + _SIN[d] * y
        reach[d] = max(reach[d], along)


@kernel(nogil=True)
def _slices(
    points: npt.NDArray[np.float32],
    first: npt.NDArray[np.int64],
    count: npt.NDArray[np.int64],
    levels: tuple[float, float, float, float],
) -> tuple[npt.NDArray[np.int64], Array, Array, npt.NDArray[np.float32], Array]:
    """Slices of k boxes of points[first : first + count], those of a box from its highest one down.

    Slices that reach as far as the one above are one.

    Args:
        levels: a level's height, metres between two, `corner` of `measure_outline`, and by how
            much a slice may reach further than the highest that it is one with.

    Returns:
        (s,) the box that each is of; (s, 3), (s, 3) their corners; (s, 6) outlines; (s,) mean
        heights of what lies between their two uppermost levels.
    """
    low, rise, corner, alike = levels
    room, most = 0, 0
    for n in range(len(first)):
        room += count[n]
        most = max(most, count[n])
    of = np.empty(room, np.int64)
    lower, upper = np.empty((room, 3)), np.empty((room, 3))
    outline, middle = np.empty((room, 6), np.float32), np.empty(room)
    slab, rows = np.empty(most, np.int64), np.arange(most)
    taken, box = np.empty((most, 3)), np.empty((2, 3))
    highest, together, own = np.empty(_WAYS), np.empty(_WAYS), np.empty(_WAYS)
    found = 0
    for n in range(len(first)):
        least, greatest = np.int64(2**62), np.int64(-(2**62))
        for i in range(count[n]):
            slab[i] = np.int64(np.floor((points[first[n] + i, 2] - low) / rise))
            least, greatest = min(least, slab[i]), max(greatest, slab[i])
        held = 0
        for level in range(greatest, least - 1, -1):
            before, total = held, 0.0
            own[:] = -np.inf
            for i in range(count[n]):
                if slab[i] == level:
                    for a in range(3):
                        taken[held, a] = points[first[n] + i, a]
                    _reach(taken[held, 0], taken[held, 1], own)
                    total += taken[held, 2]
                    held += 1
            if held == before:
                continue
            one = before > 0
            for d in range(_WAYS):
                one = one and own[d] <= highest[d] + alike
                one = one and own[d] >= together[d] - _SHORTER * alike
            if one:
                for d in range(_WAYS):
                    together[d] = max(together[d], own[d])
                continue
            if before > 0:  # what was one ends above
                _close(taken, rows, before, box, corner, lower, upper, outline, found)
                found += 1
                for i in range(before, held):
                    for a in range(3):
                        taken[i - before, a] = taken[i, a]
                held -= before
            of[found], middle[found] = n, total / held
            highest[:], together[:] = own, own
        _close(taken, rows, held, box, corner, lower, upper, outline, found)
        found += 1
    return (
        of[:found].copy(),
        lower[:found].copy(),
        upper[:found].copy(),
        outline[:found].copy(),
        middle[:found].copy(),
    )


@kernel(nogil=True)
def _close(
    taken: Array,
    rows: npt.NDArray[np.int64],
    held: int,
    box: Array,
    corner: float,
    lower: Array,
    upper: Array,
    outline: npt.NDArray[np.float32],
    at: int,
) -> None:
    """Put corners and outline of taken[:held] at a place of those that are found."""
    for a in range(3):
        box[0, a], box[1, a] = taken[0, a], taken[0, a]
        for i in range(1, held):
            box[0, a] = min(box[0, a], taken[i, a])
            box[1, a] = max(box[1, a], taken[i, a])
        lower[at, a], upper[at, a] = box[0, a], box[1, a]
    measure_outline(taken, rows, held, box, corner, outline[at])
