"""Which boxes of the obstacle set count for the clearance, and up to where."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.obstacle_arrays import ObstacleArrays
from placement_planner_ros.core.scene.runs import rows_of_runs
from placement_planner_ros.core.types import Array

Rows = npt.NDArray[np.int64]

_UPRIGHT = 0.2
"""Boxes higher than this share of a cell are of a wall, and less than it off its other boxes."""
_ROUNDING = 1e-6
"""m: points are kept in single precision."""


class CountedBoxes(NamedTuple):
    """k boxes that count for the clearance, with those of their points that do."""

    rows: Rows
    """(k,) in the obstacle set."""
    ends: Array
    """(k,) z up to which each counts."""
    points: npt.NDArray[np.float32]
    """(n, 3)."""
    first: Rows
    """(k,) of the points of each, which follow one another."""
    number: Rows
    """(k,) of these, one at least."""

    def some(self, at: Rows) -> CountedBoxes:
        """Some of the boxes."""
        return CountedBoxes(
            self.rows[at], self.ends[at], self.points, self.first[at], self.number[at]
        )


def counted_boxes(obstacles: ObstacleSet, within: Array) -> CountedBoxes:
    """Boxes that touch any of `within` (n, 2, 3), with their points that lie in it from above.

    They count up to where the last of these that they touch ends, their top, or where a wall goes
    on above. Those in which nothing was measured do not count.
    """
    around = (
        (obstacles.upper >= within[:, 0].min(axis=0))
        & (obstacles.lower <= within[:, 1].max(axis=0))
    ).all(axis=1)
    rows = np.flatnonzero(around & (np.diff(obstacles.first_point) > 0))
    lower, upper = obstacles.lower[rows], obstacles.upper[rows]
    ends = _ends(obstacles.arrays, rows)
    touching, inside = np.zeros(len(rows), np.bool_), np.zeros(len(rows), np.bool_)
    last = np.full(len(rows), -np.inf)
    for low, high in within:
        beside = (upper[:, :2] >= low[:2]) & (lower[:, :2] <= high[:2])
        reached = beside.all(axis=1) & (lower[:, 2] <= high[2])
        touching |= reached & (upper[:, 2] >= low[2])
        reached &= ends >= low[2]
        last[reached] = np.maximum(last[reached], high[2])
        inside |= ((lower[:, :2] >= low[:2]) & (upper[:, :2] <= high[:2])).all(axis=1)
    rows, ends, inside = rows[touching], np.minimum(ends, last)[touching], inside[touching]
    first, count = obstacles.first_point[rows], np.diff(obstacles.first_point)[rows]
    whole = CountedBoxes(rows, ends, obstacles.points, first, count)
    return _cut(whole, np.flatnonzero(~inside), within[:, :, :2])


def _cut(boxes: CountedBoxes, at: Rows, within: Array) -> CountedBoxes:
    """Leave out what of some of the boxes lies in none of the rectangles (n, 2, 2)."""
    if not len(at):
        return boxes
    count = boxes.number[at]
    points = boxes.points[rows_of_runs(boxes.first[at], count)]
    kept = np.zeros(len(points), np.bool_)
    for low, high in within:
        kept |= ((points[:, :2] >= low - _ROUNDING) & (points[:, :2] <= high + _ROUNDING)).all(
            axis=1
        )
    points, of = points[kept], np.repeat(at, count)[kept]
    first, ends = boxes.first.copy(), boxes.ends.copy()
    number, top = boxes.number.copy(), np.full(len(ends), -np.inf)
    number[at] = np.bincount(of, minlength=len(number))[at]
    first[at] = len(boxes.points) + number[at].cumsum() - number[at]
    np.maximum.at(top, of, points[:, 2])
    ends[at] = np.minimum(ends, top)[at]
    together = np.concatenate([boxes.points, points])
    return CountedBoxes(boxes.rows, ends, together, first, number).some(np.flatnonzero(number))


@kernel(nogil=True)
def _ends(boxes: ObstacleArrays, rows: npt.NDArray[np.int64]) -> Array:
    """(k,) z up to which each of the boxes counts: its top, or where a wall goes on above it."""
    lower, upper = boxes.lower, boxes.upper
    ends = np.empty(len(rows))
    for n in range(len(rows)):
        p = rows[n]
        ends[n] = upper[p, 2]
        i, j, k = boxes.cells[p, 0], boxes.cells[p, 1], boxes.cells[p, 2] + 1
        if k >= boxes.number_at.shape[2] or upper[p, 2] - lower[p, 2] < _UPRIGHT * boxes.cell_size:
            continue
        q = boxes.number_at[i, j, k] - 1
        while q >= 0:
            apart = max(
                lower[q, 0] - upper[p, 0],
                lower[p, 0] - upper[q, 0],
                lower[q, 1] - upper[p, 1],
                lower[p, 1] - upper[q, 1],
                0.0,
            )
            if (
                apart <= _UPRIGHT * boxes.cell_size
                and lower[q, 2] - upper[p, 2] <= 0.5 * boxes.cell_size
            ):
                ends[n] = max(ends[n], lower[q, 2])
            q = boxes.next[q]
    return ends
