"""Which boxes of the obstacle set count for the clearance, and up to where."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.obstacle_arrays import ObstacleArrays
from placement_planner_ros.core.types import Array

_UPRIGHT = 0.2
"""Boxes higher than this share of a cell are of a wall, and less than it off its other boxes."""


def counted_boxes(obstacles: ObstacleSet, within: Array) -> tuple[npt.NDArray[np.int64], Array]:
    """Rows (k,) of the boxes that touch any of `within` (n, 2, 3), and (k,) z up to which they
    count: where the last of these that they touch ends, their top, or where a wall goes on above.

    Those in which nothing was measured do not count.
    """
    around = (
        (obstacles.upper >= within[:, 0].min(axis=0))
        & (obstacles.lower <= within[:, 1].max(axis=0))
    ).all(axis=1)
    rows = np.flatnonzero(around & (np.diff(obstacles.first_point) > 0))
    lower, upper = obstacles.lower[rows], obstacles.upper[rows]
    ends = _ends(obstacles.arrays, rows)
    touching = np.zeros(len(rows), np.bool_)
    last = np.full(len(rows), -np.inf)
    for low, high in within:
        beside = (upper[:, :2] >= low[:2]) & (lower[:, :2] <= high[:2])
        reached = beside.all(axis=1) & (lower[:, 2] <= high[2])
        touching |= reached & (upper[:, 2] >= low[2])
        reached &= ends >= low[2]
        last[reached] = np.maximum(last[reached], high[2])
    return rows[touching], np.minimum(ends, last)[touching]


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
