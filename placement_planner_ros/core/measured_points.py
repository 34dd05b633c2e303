"""Coordinates as a sensor tells them: those that are measurements, in another frame."""

from __future__ import annotations

import numpy as np
from numba import njit

from placement_planner_ros.core.types import Array


def measured_points(coordinates: tuple[Array, Array, Array], T: Array, farthest: float) -> Array:
    """(m, 3) the points that were measured, moved by T.

    What is none has a coordinate that is NaN or farther than `farthest` from zero, or three zeros,
    as some drivers send pixels without a measurement.

    Args:
        coordinates: x, y and z of all points, (n,) each.
        T: (4, 4), a turn and a shift.
    """
    points = np.empty((len(coordinates[0]), 3))
    count = _move_measured(*coordinates, np.ascontiguousarray(T), farthest, points)
    return points if count == len(points) else points[:count].copy()


@njit(cache=True, nogil=True)
def _move_measured(x: Array, y: Array, z: Array, T: Array, farthest: float, points: Array) -> int:
    """Write what was measured, moved, into the first rows of points (n, 3), and say how many."""
    count = 0
    for p in range(len(x)):
        a, b, c = x[p], y[p], z[p]
        # no comparison holds where a coordinate is NaN
        known = abs(a) <= farthest and abs(b) <= farthest and abs(c) <= farthest
        if known and (a != 0.0 or b != 0.0 or c != 0.0):
            for i in range(3):
                points[count, i] = T[i, 0] * a + T[i, 1] * b + T[i, 2] * c + T[i, 3]
            count += 1
    return count
