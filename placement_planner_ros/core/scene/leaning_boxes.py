"""Boxes around what leans or is round, cut into slices as high as a clearance field's slabs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.outlines import Outlines, find_outlines
from placement_planner_ros.core.types import Array

Rows = npt.NDArray[np.int64]
Points = npt.NDArray[np.float32]

_RECEDES = 0.15
"""Where neither the upper nor the lower half of its points stays further than this share of a cell
from any side of what is around all of them, a box is upright."""
_NOISE = 3.0
"""The same in noise, by which a half of a few points recedes: this many standard deviations."""
_HIGH = 0.05
"""Boxes lower than this share of a cell are flat."""
_ALIKE = 0.1
"""Slices are one where they reach as far as the highest of them within this share of a cell."""
_WAYS = 8
"""Directions in which it is asked how far points reach."""
_COS, _SIN = (np.array([way(2.0 * math.pi * d / _WAYS) for d in range(_WAYS)])
              for way in (math.cos, math.sin))  # fmt: skip
_ROUNDING = 1e-6
"""m: points are kept in single precision."""


class CountedBoxes(NamedTuple):
    """k boxes that count for the clearance."""

    outlines: Outlines
    cells: npt.NDArray[np.int32]
    """(k, 3) in which they lie."""
    bottoms: Array
    """(k,) z of their lower faces."""
    ends: Array
    """(k,) z up to which each counts."""


def sliced(
    obstacles: ObstacleSet, rows: Rows, ends: Array, low: float, rise: float
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
    bottoms, cells = obstacles.lower[rows, 2], obstacles.cells[rows]
    first, count = obstacles.first_point[rows], np.diff(obstacles.first_point)[rows]
    size, noise = obstacles.cell_size, obstacles.noise
    high = (obstacles.upper[rows, 2] - bottoms > _HIGH * size) & (count > 1)
    recedes = max(_RECEDES * size, _NOISE * noise)
    leans = _leans(obstacles.points, first, count, high, recedes)
    upright = np.flatnonzero(~leans)
    outlines = find_outlines(obstacles.points, first[upright], count[upright], size, noise)
    whole = CountedBoxes(outlines, cells[upright], bottoms[upright], ends[upright])
    if not leans.any():
        return whole
    of, outlines, bottoms, tops, middle = _slices(obstacles, rows[leans], low, rise)
    of = np.flatnonzero(leans)[of]
    highest = np.append(True, of[1:] != of[:-1])
    last = np.minimum(np.where(highest, tops, middle), ends[of])
    counts = np.flatnonzero((last >= low) & (bottoms <= last + _ROUNDING))
    return CountedBoxes(
        whole.outlines.followed_by(outlines.of_rows(counts)),
        np.concatenate([whole.cells, cells[of[counts]]]),
        np.concatenate([whole.bottoms, bottoms[counts]]),
        np.concatenate([whole.ends, last[counts]]),
    )


def _slices(
    obstacles: ObstacleSet, rows: Rows, low: float, rise: float
) -> tuple[Rows, Outlines, Array, Array, Array]:
    """Slices of boxes (k,), those of a box from its highest one down.

    Slices that reach as far as the one above are one.

    Returns:
        (s,) the box that each is of; outlines; (s,), (s,) z from where to where they go, and (s,)
        mean heights of what lies between their two uppermost levels.
    """
    first, count = obstacles.first_point[rows], np.diff(obstacles.first_point)[rows]
    box = np.repeat(np.arange(len(rows)), count)
    start = np.append(0, count.cumsum())
    points = obstacles.points[np.arange(start[-1]) + np.repeat(first - start[:-1], count)]
    # by box and level, highest first
    level = np.floor((points[:, 2] - low) / rise).astype(np.int64)
    key = box * (level.max() - level.min() + 1) + level.max() - level
    order = np.argsort(key, kind="stable")
    points, key, box = points[order], key[order], box[order]
    begin = np.flatnonzero(np.append(True, key[1:] != key[:-1]))
    means = np.add.reduceat(points[:, 2], begin, dtype=np.float64)
    means /= np.diff(np.append(begin, len(points)))
    # those that are one
    reach = np.maximum.reduceat(points[:, :2] @ np.array([_COS, _SIN], np.float32), begin)
    apart = _apart(box[begin], reach, _ALIKE * obstacles.cell_size)
    begin, means = begin[apart], means[apart]
    lengths = np.diff(np.append(begin, len(points)))
    outlines = find_outlines(points, begin, lengths, obstacles.cell_size, obstacles.noise)
    z = points[:, 2].astype(np.float64)
    bottoms, tops = (reach.reduceat(z, begin) for reach in (np.minimum, np.maximum))
    return box[begin], outlines, bottoms, tops, means


@kernel(nogil=True)
def _leans(
    points: Points, first: Rows, count: Rows, asked: npt.NDArray[np.bool_], recedes: float
) -> npt.NDArray[np.bool_]:
    """(k,) which of the boxes asked for, of points[first : first + count], lean or are round."""
    leans = np.zeros(len(first), np.bool_)
    reach = np.empty((2, _WAYS))  # of the lower and the upper half of the points
    for n in range(len(first)):
        if not asked[n]:
            continue
        lowest, highest = np.inf, -np.inf
        for p in range(first[n], first[n] + count[n]):
            lowest, highest = min(lowest, points[p, 2]), max(highest, points[p, 2])
        reach[:] = -np.inf
        for p in range(first[n], first[n] + count[n]):
            half = 0 if points[p, 2] < 0.5 * (lowest + highest) else 1
            for d in range(_WAYS):
                along = _COS[d] * points[p, 0] + _SIN[d] * points[p, 1]
                reach[half, d] = max(reach[half, d], along)
        for d in range(_WAYS):
            leans[n] = leans[n] or abs(reach[1, d] - reach[0, d]) > recedes
    return leans


@kernel(nogil=True)
def _apart(of: Rows, reach: Points, alike: float) -> npt.NDArray[np.bool_]:
    """(s,) which slices are not one with those above.

    Args:
        of: (s,) the box of each; those of one follow each other from the highest down.
        reach: (s, _WAYS) how far each reaches.
        alike: m by which those that are one may reach further, or less far, than the highest.
    """
    apart = np.ones(len(of), np.bool_)
    highest = 0
    for n in range(1, len(of)):
        if of[n] == of[n - 1]:
            apart[n] = False
            for d in range(_WAYS):
                apart[n] = apart[n] or abs(reach[n, d] - reach[highest, d]) > alike
        if apart[n]:
            highest = n
    return apart
