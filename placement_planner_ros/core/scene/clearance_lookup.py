"""What a clearance field's values say around points, and on average over a body."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.types import Array

Field = npt.NDArray[np.float32]


class Table(NamedTuple):
    """Values of d_S around one part of V."""

    values: Field
    """(nx, ny, nz) on lines and levels."""
    origin: Array
    """(3,) of the first."""
    size: float
    """m between two lines."""
    rise: float
    """m between two levels."""
    cap: float
    """m, the greatest value, which holds above the last level."""
    lift: float
    """m above a body's lowest point at which what is lower is judged."""


@kernel(nogil=True)
def distances(table: Table, points: Array) -> Array:
    """(n, 3) d_S, ∂d_S/∂x, ∂d_S/∂y."""
    result = np.empty((len(points), 3))
    for p in range(len(points)):
        d, gx, gy = _interpolate(table, points[p, 0], points[p, 1], points[p, 2], True)
        result[p, 0], result[p, 1], result[p, 2] = d, gx, gy
    return result


@kernel(inline=True)
def _interpolate(
    table: Table, x: float, y: float, z: float, slopes: bool
) -> tuple[float, float, float]:
    """d_S around a point, and its change along x and y, 0 unless `slopes`: trilinear between levels
    and lines."""
    values, origin, size = table.values, table.origin, table.size
    nx, ny, nz = values.shape
    w = max((z - origin[2]) / table.rise, 0.0)
    if w >= nz - 1.0:
        return table.cap, 0.0, 0.0
    u = (x - origin[0]) / size
    v = (y - origin[1]) / size
    in_x = 0.0 <= u <= nx - 1.0
    in_y = 0.0 <= v <= ny - 1.0
    u = min(max(u, 0.0), nx - 1.0)
    v = min(max(v, 0.0), ny - 1.0)
    i = min(int(u), nx - 2)
    j = min(int(v), ny - 2)
    k = int(w)
    u -= i
    v -= j
    w -= k
    a = values[i, j, k] + (values[i, j, k + 1] - values[i, j, k]) * w
    b = values[i, j + 1, k] + (values[i, j + 1, k + 1] - values[i, j + 1, k]) * w
    c = values[i + 1, j, k] + (values[i + 1, j, k + 1] - values[i + 1, j, k]) * w
    d = values[i + 1, j + 1, k] + (values[i + 1, j + 1, k + 1] - values[i + 1, j + 1, k]) * w
    near = a + (b - a) * v
    far = c + (d - c) * v
    gx = (far - near) / size if slopes and in_x else 0.0
    gy = ((b - a) * (1.0 - u) + (d - c) * u) / size if slopes and in_y else 0.0
    return near + (far - near) * u, gx, gy


@kernel()
def mean_clearance(
    table: Table, T_world_object: Array, points: Array, slopes: bool
) -> tuple[Array, Array]:
    """(m,) mean of d_S over the (n, 3) points at each of the (m, 4, 4) poses; (m, 3) gradients, 0
    unless `slopes`.

    A turn by e_z about the object's origin moves a point at (rx, ry) from it along (-ry, rx).
    """
    m, n = len(T_world_object), len(points)
    means = np.zeros(m)
    gradients = np.zeros((m, 3))
    for t in range(m):
        T = T_world_object[t]
        lowest = np.inf
        for p in range(n):
            up = T[2, 0] * points[p, 0] + T[2, 1] * points[p, 1] + T[2, 2] * points[p, 2]
            lowest = min(lowest, up)
        least = lowest + table.lift
        total, along_x, along_y, turn = 0.0, 0.0, 0.0, 0.0
        for p in range(n):
            a, b, c = points[p, 0], points[p, 1], points[p, 2]
            rx = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c
            ry = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c
            rz = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c
            up = max(rz, least) + T[2, 3]
            d, gx, gy = _interpolate(table, rx + T[0, 3], ry + T[1, 3], up, slopes)
            total += d
            if slopes:
                along_x += gx
                along_y += gy
                turn += gy * rx - gx * ry
        if n > 0:
            means[t] = total / n
            gradients[t, 0] = along_x / n
            gradients[t, 1] = along_y / n
            gradients[t, 2] = turn / n
    return means, gradients
