"""Boxes around what leans or is round, cut into slices as high as a clearance field's slabs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.tight_boxes import measure_outline
from placement_planner_ros.core.types import Array

_RECEDES = 0.15
"""Where neither the upper nor the lower half of its points stays further than this share of a cell
from any side of what is around all of them, a box is upright."""
_NOISE = 2.0
"""The same in noise, by which a half of a few points recedes: this many standard deviations."""
_HIGH = 0.05
"""Boxes lower than this share of a cell are flat."""
_CORNER = 0.1
"""Slices whose points stay further than so many cells from a corner are turned: x + y."""
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
    high = (upper[:, 2] - lower[:, 2] > _HIGH * obstacles.cell_size) & (count >= _LEAST)
    recedes = max(_RECEDES * obstacles.cell_size, _NOISE * obstacles.noise)
    leans = _leans(obstacles.points, first, count, high, recedes)
    whole = CountedBoxes(lower, upper, obstacles.outline[rows], obstacles.cells[rows], ends)
    if not leans.any():
        return whole
    at = np.flatnonzero(leans)
    found = _slices(
        obstacles.points,
        first[at],
        count[at],
        (low, rise, _CORNER * obstacles.cell_size),
    )
    of, bottom, top, outlines, middle = found
    of = at[of]
    highest = np.append(of[1:] != of[:-1], True)
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
    reach, directions = np.empty((3, 8)), np.empty((8, 2))
    for d in range(8):
        angle = 0.25 * math.pi * d
        directions[d, 0], directions[d, 1] = math.cos(angle), math.sin(angle)
    for n in range(len(first)):
        if not asked[n]:
            continue
        lowest, highest = np.inf, -np.inf
        for p in range(first[n], first[n] + count[n]):
            lowest, highest = min(lowest, points[p, 2]), max(highest, points[p, 2])
        reach[:] = -np.inf  # of all, of the lower and of the upper half, in eight directions
        for p in range(first[n], first[n] + count[n]):
            half = 1 if points[p, 2] < 0.5 * (lowest + highest) else 2
            x, y = points[p, 0], points[p, 1]
            for d in range(8):
                along = x * directions[d, 0] + y * directions[d, 1]
                reach[0, d] = max(reach[0, d], along)
                reach[half, d] = max(reach[half, d], along)
        for d in range(8):
            if min(reach[1, d], reach[2, d]) < reach[0, d] - recedes:
                leans[n] = True
    return leans


@kernel(nogil=True)
def _slices(
    points: npt.NDArray[np.float32],
    first: npt.NDArray[np.int64],
    count: npt.NDArray[np.int64],
    levels: tuple[float, float, float],
) -> tuple[npt.NDArray[np.int64], Array, Array, npt.NDArray[np.float32], Array]:
    """Slices of k boxes of points[first : first + count], those of a box from its lowest one up.

    Args:
        levels: a level's height, metres between two, and `corner` of `measure_outline`.

    Returns:
        (s,) the box that each is of; (s, 3), (s, 3) their corners; (s, 6) outlines; (s,) mean
        heights.
    """
    low, rise, corner = levels
    room = 0
    most = 0
    for n in range(len(first)):
        room += count[n]
        most = max(most, count[n])
    of = np.empty(room, np.int64)
    lower, upper = np.empty((room, 3)), np.empty((room, 3))
    outline, middle = np.empty((room, 6), np.float32), np.empty(room)
    slab, rows = np.empty(most, np.int64), np.empty(most, np.int64)
    taken, box = np.empty((most, 3)), np.empty((2, 3))
    found = 0
    for n in range(len(first)):
        lowest, highest = np.int64(2**62), np.int64(-(2**62))
        for i in range(count[n]):
            slab[i] = np.int64(np.floor((points[first[n] + i, 2] - low) / rise))
            lowest, highest = min(lowest, slab[i]), max(highest, slab[i])
        for level in range(lowest, highest + 1):
            held, total = 0, 0.0
            for i in range(count[n]):
                if slab[i] == level:
                    for a in range(3):
                        taken[held, a] = points[first[n] + i, a]
                    rows[held] = held
                    total += taken[held, 2]
                    held += 1
            if held == 0:
                continue
            for a in range(3):
                box[0, a], box[1, a] = taken[0, a], taken[0, a]
                for i in range(1, held):
                    box[0, a] = min(box[0, a], taken[i, a])
                    box[1, a] = max(box[1, a], taken[i, a])
                lower[found, a], upper[found, a] = box[0, a], box[1, a]
            measure_outline(taken, rows, held, box, corner, outline[found])
            of[found], middle[found] = n, total / held
            found += 1
    return (
        of[:found].copy(),
        lower[:found].copy(),
        upper[:found].copy(),
        outline[:found].copy(),
        middle[:found].copy(),
    )
