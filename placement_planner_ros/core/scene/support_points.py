"""Whether a surface carries a point: the points measured around it surround it."""

from __future__ import annotations

import math

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.support_columns import END, Columns, surface_at

_EPSILON = 1e-7
_ON = 1e-6
"""m, how far outside of a hull a point may lie by rounding."""
WITHIN = 1e-4
"""m that a place must be within a gap: the points at its edge still carry."""


@kernel(lean=True)
def _surrounded(columns: Columns, s: int, x: float, y: float) -> bool:
    """Whether a point lies in the hull of what was measured around it on surface s.

    The directions to these points are kept as the cone from u to v that holds them all, until one
    lies opposite to it. Columns in which the surface does not end count as a whole.
    """
    size, reach = columns.cell_size, columns.radius[s]
    ux = uy = vx = vy = 0.0
    begun = False
    i0 = max(math.floor((x - reach - columns.origin[0]) / size), 0)
    i1 = min(math.floor((x + reach - columns.origin[0]) / size), columns.nx - 1)
    j0 = max(math.floor((y - reach - columns.origin[1]) / size), 0)
    j1 = min(math.floor((y + reach - columns.origin[1]) / size), columns.ny - 1)
    middle_i = math.floor((x - columns.origin[0]) / size)
    middle_j = math.floor((y - columns.origin[1]) / size)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            away = max(abs(i - middle_i), abs(j - middle_j), 1)
            t = surface_at(
                columns.start,
                columns.height,
                i * columns.ny + j,
                columns.height[s],
                away * columns.step,
            )
            if t < 0:
                continue
            inner = columns.kind[t] != END
            left, front = columns.origin[0] + i * size, columns.origin[1] + j * size
            number = 5 if inner else columns.first[t + 1] - columns.first[t]
            for n in range(number):
                if not inner:
                    px = float(columns.points[columns.first[t] + n, 0])
                    py = float(columns.points[columns.first[t] + n, 1])
                elif n < 4:
                    px, py = left + (n & 1) * size, front + (n >> 1) * size
                else:
                    px, py = min(max(x, left), left + size), min(max(y, front), front + size)
                wx, wy = px - x, py - y
                if wx * wx + wy * wy > reach * reach:
                    continue
                if wx * wx + wy * wy <= _ON * _ON:
                    return True
                if not begun:
                    begun = True
                    ux = vx = wx
                    uy = vy = wy
                    continue
                from_u, from_v = ux * wy - uy * wx, vx * wy - vy * wx
                if from_u >= 0.0 and from_v <= 0.0 and ux * wx + uy * wy > 0.0:
                    continue
                if from_u >= 0.0 and from_v <= 0.0 and vx * wx + vy * wy > 0.0:
                    continue
                to_u = _ON * math.sqrt((wx - ux) ** 2 + (wy - uy) ** 2)
                to_v = _ON * math.sqrt((wx - vx) ** 2 + (wy - vy) ** 2)
                behind_u = ux * wx + uy * wy < 0.0 and abs(from_u) <= to_u
                behind_v = vx * wx + vy * wy < 0.0 and abs(from_v) <= to_v
                if behind_u or behind_v or (from_u < 0.0 and from_v > 0.0):
                    return True
                if from_u >= 0.0 and from_v >= 0.0:
                    vx, vy = wx, wy
                elif from_u <= 0.0 and from_v <= 0.0:
                    ux, uy = wx, wy
    return False


@kernel(lean=True)
def _is_alone(columns: Columns, s: int, x: float, y: float) -> bool:
    """Whether a place is further from all points of surface s than what is no gap."""
    far, size = columns.alone[s], columns.cell_size
    if far > size:
        return False
    for i in range(
        max(math.floor((x - far - columns.origin[0]) / size), 0),
        min(math.floor((x + far - columns.origin[0]) / size), columns.nx - 1) + 1,
    ):
        for j in range(
            max(math.floor((y - far - columns.origin[1]) / size), 0),
            min(math.floor((y + far - columns.origin[1]) / size), columns.ny - 1) + 1,
        ):
            column = i * columns.ny + j
            step = 2.0 * columns.step
            t = surface_at(columns.start, columns.height, column, columns.height[s], step)
            if t < 0:
                continue
            for n in range(columns.first[t], columns.first[t + 1]):
                dx, dy = columns.points[n, 0] - x, columns.points[n, 1] - y
                if dx * dx + dy * dy <= far * far:
                    return False
    return True


@kernel(lean=True)
def _in_hole(columns: Columns, s: int, x: float, y: float) -> bool:
    """Whether a place in the column of surface s lies in a gap of it."""
    if _is_alone(columns, s, x, y):
        return True
    for n in range(columns.first_hole[s], columns.first_hole[s + 1]):
        dx, dy = x - columns.holes[n, 0], y - columns.holes[n, 1]
        radius = columns.holes[n, 2] - WITHIN
        if dx * dx + dy * dy < radius * radius:
            return True
    return False


@kernel(lean=True)
def on_surface(columns: Columns, x: float, y: float, z: float, tolerance: float) -> int:
    """The level surface that carries a point, or -1."""
    size = columns.cell_size
    # a point on the face between two columns belongs to both
    i0 = max(math.floor((x - _EPSILON - columns.origin[0]) / size), 0)
    i1 = min(math.floor((x + _EPSILON - columns.origin[0]) / size), columns.nx - 1)
    j0 = max(math.floor((y - _EPSILON - columns.origin[1]) / size), 0)
    j1 = min(math.floor((y + _EPSILON - columns.origin[1]) / size), columns.ny - 1)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            column = i * columns.ny + j
            for s in range(columns.start[column], columns.start[column + 1]):
                if abs(z - columns.height[s]) <= tolerance and (
                    columns.kind[s] != END
                    or (_surrounded(columns, s, x, y) and not _in_hole(columns, s, x, y))
                ):
                    return s
    return -1
