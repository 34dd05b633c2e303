"""Boxes around what leans or is round, cut into slices as high as a clearance field's slabs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.counted_boxes import CountedBoxes
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.outlines import Outlines, find_outlines
from placement_planner_ros.core.scene.runs import rows_of_runs
from placement_planner_ros.core.types import Array

Rows = npt.NDArray[np.int64]
Points = npt.NDArray[np.float32]

_RECEDES = 0.05
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


class SlicedBoxes(NamedTuple):
    """k boxes that count for the clearance, or slices of them."""

    outlines: Outlines
    cells: npt.NDArray[np.int32]
    """(k, 3) in which they lie."""
    bottoms: Array
    """(k,) z of their lowest points."""
    ends: Array
    """(k,) z up to which each counts."""


def sliced(boxes: CountedBoxes, obstacles: ObstacleSet, low: float, rise: float) -> SlicedBoxes:
    """Boxes that count, those that lean in slices from `low` + n · `rise` up to the next.

    The box around a slope reaches as far at its top as at its foot. Slices hold the points measured
    at their heights, so that the clearance beside balls, cones and ramps does not depend on where
    the cells lie. The highest slice ends at its highest point, the others at the mean height of
    their points, since what they hold begins further down.

    Args:
        low: z of the lowest level, metres; slices that end below it are left out.
        rise: m between two levels.
    """
    size, noise = obstacles.cell_size, obstacles.noise
    recedes = max(_RECEDES * size, _NOISE * noise)
    bottoms, leans = _leans(boxes.points, boxes.first, boxes.number, _HIGH * size, recedes)
    cells, at = obstacles.cells[boxes.rows], np.flatnonzero(~leans)
    outlines = find_outlines(boxes.points, boxes.first[at], boxes.number[at], size, noise)
    upright = SlicedBoxes(outlines, cells[at], bottoms[at], boxes.ends[at])
    at = np.flatnonzero(leans)
    if not len(at):
        return upright
    of, outlines, bottoms, tops, middle = _slices(boxes.some(at), size, noise, low, rise)
    of = at[of]
    highest = np.append(True, of[1:] != of[:-1])
    last = np.minimum(np.where(highest, tops, middle), boxes.ends[of])
    counts = np.flatnonzero((last >= low) & (bottoms <= last + _ROUNDING))
    return SlicedBoxes(
        upright.outlines.followed_by(outlines.of_rows(counts)),
        np.concatenate([upright.cells, cells[of[counts]]]),
        np.concatenate([upright.bottoms, bottoms[counts]]),
        np.concatenate([upright.ends, last[counts]]),
    )


def _slices(
    boxes: CountedBoxes, cell_size: float, noise: float, low: float, rise: float
) -> tuple[Rows, Outlines, Array, Array, Array]:
    """Slices of boxes (k,), those of a box from its highest one down.

    Slices that reach as far as the one above are one.

    Returns:
        (s,) the box that each is of; outlines; (s,), (s,) z from where to where they go, and (s,)
        mean heights of what lies between their two uppermost levels.
    """
    box = np.repeat(np.arange(len(boxes.rows)), boxes.number)
    points = boxes.points[rows_of_runs(boxes.first, boxes.number)]
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
    apart = _apart(box[begin], reach, _ALIKE * cell_size)
    begin, means = begin[apart], means[apart]
    lengths = np.diff(np.append(begin, len(points)))
    outlines = find_outlines(points, begin, lengths, cell_size, noise)
    z = points[:, 2].astype(np.float64)
    bottoms, tops = (reach.reduceat(z, begin) for reach in (np.minimum, np.maximum))
    return box[begin], outlines, bottoms, tops, means


@kernel(nogil=True)
def _leans(
    points: Points, first: Rows, count: Rows, flat: float, recedes: float
) -> tuple[Array, npt.NDArray[np.bool_]]:
    """(k,) z of the lowest of points[first : first + count], and (k,) which lean or are round.

    Args:
        flat: height up to which none does.
        recedes: m by which the upper or the lower half stays further from a side.
    """
    bottoms, leans = np.empty(len(first)), np.zeros(len(first), np.bool_)
    reach = np.empty((2, _WAYS))  # of the lower and the upper half of the points
    for n in range(len(first)):
        lowest, highest = np.inf, -np.inf
        for p in range(first[n], first[n] + count[n]):
            z = np.float64(points[p, 2])
            lowest, highest = min(lowest, z), max(highest, z)
        bottoms[n] = lowest
        if highest - lowest <= flat:
            continue
        reach[:] = -np.inf
        for p in range(first[n], first[n] + count[n]):
            half = 0 if points[p, 2] < 0.5 * (lowest + highest) else 1
            for d in range(_WAYS):
                along = _COS[d] * points[p, 0] + _SIN[d] * points[p, 1]
                reach[half, d] = max(reach[half, d], along)
        for d in range(_WAYS):
            leans[n] = leans[n] or abs(reach[1, d] - reach[0, d]) > recedes
    return bottoms, leans


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
