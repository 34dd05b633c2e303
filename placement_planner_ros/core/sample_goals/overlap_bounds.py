"""Cells of the pose sets Ŝ(r, f) at all of whose poses the object overlaps an obstacle."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.body.inner_balls import inner_balls
from placement_planner_ros.core.collision.against_boxes import distance_bounds
from placement_planner_ros.core.collision.boxes import box_arrays
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.objective.objective import PoseRanges
from placement_planner_ros.core.types import Array, Mask


class OverlapBound:
    """Whether a box of the obstacle set lies in the object wherever it stands in a cell.

    Of balls inside its convex pieces it is told how far they move: a box that reaches further than
    that into one is in it at every pose. Objects without convex pieces are ruled out nowhere.

    Args:
        poses: the body and the obstacle set.
    """

    def __init__(self, poses: PoseConstraints) -> None:
        obstacles = poses.problem.environment.obstacles
        self._boxes = box_arrays(obstacles)
        # Boxes that end about the contact plane are support.
        self._above = poses.footing.contact_tolerance + obstacles.cell_size
        self._balls = inner_balls(poses.problem.body, obstacles.cell_size)

    def overlapping(self, ranges: PoseRanges) -> Mask:
        """(n,) where that is so."""
        result = np.zeros(len(ranges.T), np.bool_)
        if self._boxes.number:
            grid, field = self._boxes.field_grid, self._boxes.field
            moves = np.column_stack(
                [ranges.pivot, ranges.axis, np.hypot(ranges.shift, ranges.rise), ranges.chord]
            )
            _mark_overlaps(self._balls, grid, field, ranges.T, moves, self._above, result)
        return result


@njit(cache=True, nogil=True)
def _mark_overlaps(
    balls: Array,
    grid: Array,
    field: npt.NDArray[np.uint8],
    T: Array,
    moves: Array,
    above: float,
    result: Mask,
) -> None:
    """Mark where a ball (n, 4) of the object at (m, 4, 4) stays on boxes.

    Args:
        moves: (m, 8) point and direction of the axis; how far the point moves, and the chord of the
            turn about it.
        above: m above the plane that the axis stands on, up to which boxes do not count.
    """
    for n in range(len(T)):
        for b in range(len(balls)):
            # it and all smaller ones move further than they reach
            if moves[n, 6] >= balls[b, 3]:
                break
            # the ball's centre, and where that is from the pivot
            u, v, w = balls[b, 0], balls[b, 1], balls[b, 2]
            x = T[n, 0, 0] * u + T[n, 0, 1] * v + T[n, 0, 2] * w + T[n, 0, 3]
            y = T[n, 1, 0] * u + T[n, 1, 1] * v + T[n, 1, 2] * w + T[n, 1, 3]
            z = T[n, 2, 0] * u + T[n, 2, 1] * v + T[n, 2, 2] * w + T[n, 2, 3]
            qx, qy, qz = x - moves[n, 0], y - moves[n, 1], z - moves[n, 2]
            up = moves[n, 3] * qx + moves[n, 4] * qy + moves[n, 5] * qz
            # how far it moves: with the point, and turning about it
            aside = np.sqrt(max(qx * qx + qy * qy + qz * qz - up * up, 0.0))
            moved = moves[n, 6] + moves[n, 7] * aside
            if moved >= balls[b, 3]:
                continue
            # a box that stays in it, and is above the support
            _, near = distance_bounds(grid, field, x, y, z)
            if near + moved < balls[b, 3] and near < up - above:
                result[n] = True
                break
