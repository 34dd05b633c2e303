"""What rises under an object between the corners that it stands on: ribs, coins, waves of cloth."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.types import Array

_BESIDE = 0.0025
"""m, half of what points that touch are apart: what lies so near to one is under the object."""


@kernel(nogil=True)
def rises(
    touching: Array,
    poses: Array,
    slope: tuple[float, float],
    low: Array,
    high: float,
    origin: Array,
    size: float,
    shape: tuple[int, int],
    start: npt.NDArray[np.int64],
    height: Array,
    rectangle: Array,
) -> npt.NDArray[np.bool_]:
    """(n,) whether some surface lies above the plane that an object stands on, and under it.

    Args:
        touching: (k, 3) points of the object that lie in that plane, in its own frame.
        poses: (n, 4, 4) T_world_object.
        slope: of the plane.
        low: (n,) m above the plane from which on a surface counts.
        high: m above the plane up to which it does; the object collides with what is higher.
        origin, size, shape, start, height, rectangle: of the `SupportMap` for that slope.
    """
    result = np.zeros(len(poses), np.bool_)
    for n in range(len(poses)):
        T = poses[n]
        for k in range(len(touching)):
            a, b, c = touching[k, 0], touching[k, 1], touching[k, 2]
            x = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + T[0, 3]
            y = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + T[1, 3]
            i, j = math.floor((x - origin[0]) / size), math.floor((y - origin[1]) / size)
            if not (0 <= i < shape[0] and 0 <= j < shape[1]):
                continue
            z = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + T[2, 3] - slope[0] * x - slope[1] * y
            column = i * shape[1] + j
            for s in range(start[column], start[column + 1]):
                above = height[s] - z
                if (
                    low[n] < above <= high
                    and rectangle[s, 0] - _BESIDE <= x <= rectangle[s, 2] + _BESIDE
                    and rectangle[s, 1] - _BESIDE <= y <= rectangle[s, 3] + _BESIDE
                ):
                    result[n] = True
                    break
            if result[n]:
                break
    return result
