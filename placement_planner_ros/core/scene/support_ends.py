"""Where surfaces end, and what is kept from there."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.obstacle_arrays import ObstacleArrays
from placement_planner_ros.core.scene.support_columns import END, FARTHEST, Columns
from placement_planner_ros.core.scene.support_points import on_surface

_EPSILON = 1e-7
_ROUNDING = 1e-6
"""m."""
_RISE = 0.005
"""m, what rises higher than that above a surface is a thing that stands there ..."""
_BEGIN = 0.02
"""m, ... if it begins no higher than that above it."""
_BESIDE = 1e-3
"""m, how near a box must be passed to meet it."""
_OUTWARD = 1e-3
"""m beyond an end point there is no support any more."""
_HALF_DIAGONAL = math.sqrt(0.5)
_CIRCLE = np.array([(math.cos(a), math.sin(a)) for a in np.arange(8) * 0.25 * math.pi])
_CIRCLE /= math.cos(0.125 * math.pi)
_CIRCLE.setflags(write=False)
"""Corners (8, 2) of an octagon around the unit circle."""


@kernel(lean=True)
def thing_between(
    columns: Columns,
    boxes: ObstacleArrays,
    x: float,
    y: float,
    z: float,
    dx: float,
    dy: float,
) -> bool:
    """Whether something rises from height z on the way from a point by dx, dy."""
    size = columns.cell_size
    nz = boxes.number_at.shape[2]
    i0 = max(math.floor((min(x, x + dx) - _BESIDE - columns.origin[0]) / size), 0)
    i1 = min(math.floor((max(x, x + dx) + _BESIDE - columns.origin[0]) / size), columns.nx - 1)
    j0 = max(math.floor((min(y, y + dy) - _BESIDE - columns.origin[1]) / size), 0)
    j1 = min(math.floor((max(y, y + dy) + _BESIDE - columns.origin[1]) / size), columns.ny - 1)
    k0 = max(math.floor((z - columns.step - columns.origin[2]) / size), 0)
    k1 = min(math.floor((z + _BEGIN - columns.origin[2]) / size), nz - 1)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            for k in range(k0, k1 + 1):
                p = boxes.number_at[i, j, k] - 1
                while p >= 0:
                    if boxes.upper[p, 2] > z + _RISE and boxes.lower[p, 2] < z + _BEGIN:
                        low, high = 0.0, 1.0
                        for axis in range(2):
                            at, along = (x, dx) if axis == 0 else (y, dy)
                            first = boxes.lower[p, axis] - _BESIDE - at
                            last = boxes.upper[p, axis] + _BESIDE - at
                            if abs(along) < _EPSILON:
                                if first > 0.0 or last < 0.0:
                                    high = -1.0
                                continue
                            a, b = first / along, last / along
                            low, high = max(low, min(a, b)), min(high, max(a, b))
                        if low <= high:
                            return True
                    p = boxes.next[p]
    return False


@kernel(lean=True)
def keeps(
    columns: Columns,
    boxes: ObstacleArrays,
    s: int,
    x: float,
    y: float,
    z: float,
    tolerance: float,
    margin: float,
) -> bool:
    """Whether a point on surface s keeps a margin of at most a cell from where it ends."""
    for corner in range(8):
        cos, sin = _CIRCLE[corner, 0], _CIRCLE[corner, 1]
        if on_surface(columns, x + margin * cos, y + margin * sin, z, tolerance) >= 0:
            continue
        # it may go on unseen up to what stands beyond the last of its points
        far = margin + columns.radius[s]
        if not thing_between(columns, boxes, x, y, z, far * cos, far * sin):
            return False
    return True


@kernel(nogil=True)
def find_ends(columns: Columns, boxes: ObstacleArrays, tolerance: float) -> npt.NDArray[np.bool_]:
    """`SupportMap.ends`."""
    ends = np.zeros(len(columns.points), np.bool_)
    for s in range(len(columns.height)):
        if columns.kind[s] != END:
            continue
        for n in range(columns.first[s], columns.first[s + 1]):
            x, y = float(columns.points[n, 0]), float(columns.points[n, 1])
            ends[n] = not keeps(columns, boxes, s, x, y, columns.height[s], tolerance, _OUTWARD)
    return ends


@kernel(lean=True)
def end_within(
    columns: Columns,
    ends: npt.NDArray[np.bool_],
    x: float,
    y: float,
    z: float,
    tolerance: float,
    margin: float,
) -> bool:
    """Whether a surface at height z ends within the margin of a point.

    Of an end, which runs on between two of its points, one is within the surface's radius.
    """
    size = columns.cell_size
    far = math.sqrt(margin * margin + (FARTHEST * size) ** 2)
    i0 = max(math.floor((x - far - columns.origin[0]) / size), 0)
    i1 = min(math.floor((x + far - columns.origin[0]) / size), columns.nx - 1)
    j0 = max(math.floor((y - far - columns.origin[1]) / size), 0)
    j1 = min(math.floor((y + far - columns.origin[1]) / size), columns.ny - 1)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            for s in range(
                columns.start[i * columns.ny + j], columns.start[i * columns.ny + j + 1]
            ):
                if columns.kind[s] != END or abs(columns.height[s] - z) > tolerance:
                    continue
                squared = margin * margin + columns.radius[s] * columns.radius[s]
                for n in range(columns.first[s], columns.first[s + 1]):
                    px, py = float(columns.points[n, 0]), float(columns.points[n, 1])
                    if ends[n] and (px - x) ** 2 + (py - y) ** 2 < squared:
                        return True
    return False


@kernel(nogil=True)
def leave_out(
    columns: Columns,
    ends: npt.NDArray[np.bool_],
    ending: npt.NDArray[np.bool_],
    margin: float,
    near: npt.NDArray[np.bool_],
) -> None:
    """Clear those of `near` that have no point as far from the ends of those `ending` as asked."""
    size = columns.cell_size
    for s in range(len(columns.height)):
        if columns.kind[s] != END or not ending[s]:
            continue
        reach = math.sqrt(margin * margin + columns.radius[s] * columns.radius[s])
        reach -= _HALF_DIAGONAL * size + _ROUNDING
        for n in range(columns.first[s], columns.first[s + 1]):
            if not ends[n]:
                continue
            x, y = float(columns.points[n, 0]), float(columns.points[n, 1])
            i0 = max(math.floor((x - reach - columns.origin[0]) / size), 0)
            i1 = min(math.floor((x + reach - columns.origin[0]) / size), columns.nx - 1)
            j0 = max(math.floor((y - reach - columns.origin[1]) / size), 0)
            j1 = min(math.floor((y + reach - columns.origin[1]) / size), columns.ny - 1)
            for i in range(i0, i1 + 1):
                for j in range(j0, j1 + 1):
                    across = columns.origin[0] + (i + 0.5) * size - x
                    along = columns.origin[1] + (j + 0.5) * size - y
                    if across * across + along * along < reach * reach:
                        column = i * columns.ny + j
                        near[columns.start[column] : columns.start[column + 1]] = False
