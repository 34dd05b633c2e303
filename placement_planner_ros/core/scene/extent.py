"""How much of a workspace points lie in."""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.types import Array


def cropped(lower: Array, upper: Array, points: Array, rim: float) -> tuple[Array, Array] | None:
    """The part of the box from `lower` to `upper` (3,) that points (n, 3) lie in; None if none do.

    Args:
        rim: m around the points that are part of it, too.
    """
    low, high = _extent(np.ascontiguousarray(points, dtype=np.float64), lower, upper)
    if low[0] > high[0]:
        return None
    return np.maximum(lower, low - rim), np.minimum(upper, high + rim)


def finite_extent(points: Array) -> tuple[int, Array]:
    """How many of the points (n, 3) are finite; their corners (2, 3), NaN where there are none."""
    finite = points if np.isfinite(points.sum()) else points[np.isfinite(points).all(axis=1)]
    if len(finite) == 0:
        return 0, np.full((2, 3), np.nan)
    # Column by column, which takes numpy a tenth of the time.
    columns = [finite[:, axis] for axis in range(3)]
    return len(finite), np.array([[c.min() for c in columns], [c.max() for c in columns]])


@kernel(nogil=True)
def _extent(points: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Corners (3,) of the box around those of (n, 3) points that lie within other corners; the
    lower one is above the upper one where none does."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for row in range(len(points)):
        x, y, z = points[row, 0], points[row, 1], points[row, 2]
        # also false where a coordinate is NaN
        if lower[0] <= x <= upper[0] and lower[1] <= y <= upper[1] and lower[2] <= z <= upper[2]:
            for axis, value in ((0, x), (1, y), (2, z)):
                low[axis] = min(low[axis], value)
                high[axis] = max(high[axis], value)
    return low, high
