"""s(x): what may stand where, judged by the points that were measured at the end of a surface.

Where a surface goes on in all eight columns around one, that column carries whatever stands on it.
In the others, at the end of the surface, a point is supported where measured points surround it:
where it lies in the hull of those within a short way of it (`SupportMap.radius`). So an edge is
never taken for further out than it was measured, however it runs through the cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.grid import ObstacleArrays, ObstacleSet
from placement_planner_ros.core.scene.surfaces import LevelSurfaces
from placement_planner_ros.core.types import LEVEL, Array, Slope, frozen_array

_EPSILON = 1e-7
_ON = 1e-6
"""m, how far outside of a hull a point may lie by rounding."""
_GAP = 2.5
"""Points surround what lies within so many of their spacings ..."""
_FARTHEST = 1.5
"""... and within so many cells."""
_DENSE = 0.75
"""Where points surround what lies within so many cells, every quarter of a column has its own."""
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

_END, _INNER, _DEEP = 0, 1, 2
"""A surface ends in its column or beside it; goes on in all columns around; these do so too."""


class _Surfaces(NamedTuple):
    """What kernels read of a `SupportMap`: its fields of these names."""

    origin: Array
    cell_size: float
    nx: int
    ny: int
    start: npt.NDArray[np.int64]
    height: Array
    kind: npt.NDArray[np.uint8]
    radius: Array
    first: npt.NDArray[np.int64]
    points: npt.NDArray[np.float32]
    step: float


@dataclass(frozen=True, slots=True, eq=False)
class SupportMap:
    """Every surface of one slope of the obstacle set, in V or not: what a face may rest on.

    Heights are those above a plane of that slope through the origin: `above`.

    Attributes:
        origin, cell_size, columns: of the grid; how many columns of cells along x and y.
        start: (nx * ny + 1,) first surface of each column of the grid, and their number.
        height: (s,) z of each surface.
        rectangle: (s, 4) xmin, ymin, xmax, ymax.
        kind: (s,) whether the surface ends in its column or beside it, see above.
        radius: (s,) m, how far apart the points may be that surround what they support.
        first: (s + 1,) first of each surface's points, and their number.
        points: (k, 2) x and y of what was measured on the surfaces that end.
        ends: (k,) bool, beyond which of these the surface drops, or was not seen.
        trim: m, the outermost of many noisy points lies beyond the true edge by about so much.
        step: heights of one surface differ by no more from one column to the next, m.
        obstacles: what stands around, sheared by the slope.
        slope: of the surfaces.
    """

    origin: Array
    cell_size: float
    columns: tuple[int, int]
    start: npt.NDArray[np.int64]
    height: Array
    rectangle: Array
    kind: npt.NDArray[np.uint8]
    radius: Array
    first: npt.NDArray[np.int64]
    points: npt.NDArray[np.float32]
    ends: npt.NDArray[np.bool_]
    trim: float
    step: float
    obstacles: ObstacleArrays
    slope: Slope = LEVEL

    @classmethod
    def of(
        cls, obstacles: ObstacleSet, surfaces: LevelSurfaces, slope: Slope = LEVEL
    ) -> SupportMap:
        """Of the level surfaces of an obstacle set that was sheared by a slope."""
        nx, ny, _ = obstacles.shape
        tolerance = obstacles.surface_tolerance + 0.5 * obstacles.noise
        step = 2.0 * tolerance
        cells, start, height = surfaces.cells, surfaces.start, surfaces.height
        measured = obstacles.surface_points, obstacles.surface_first
        count, filled = _counts(obstacles.arrays, *measured, cells, height, step)
        radius = _radii(cells, start, height, count, nx, ny, obstacles.cell_size, step)
        kind = _kinds(cells, start, height, filled, radius, nx, ny, obstacles.cell_size, step)
        first, points = _points_on(obstacles.arrays, *measured, cells, height, kind, step)
        view = _Surfaces(
            obstacles.origin,
            obstacles.cell_size,
            nx,
            ny,
            start,
            height,
            kind,
            radius,
            first,
            points,
            step,
        )
        return cls(
            obstacles.origin,
            obstacles.cell_size,
            (nx, ny),
            start,
            frozen_array(height),
            surfaces.rectangle,
            kind,
            radius,
            first,
            points,
            _ends(view, obstacles.arrays, step),
            2.0 * obstacles.noise,
            step,
            obstacles.arrays,
            slope,
        )

    @property
    def _view(self) -> _Surfaces:
        return _Surfaces(
            self.origin,
            self.cell_size,
            *self.columns,
            self.start,
            self.height,
            self.kind,
            self.radius,
            self.first,
            self.points,
            self.step,
        )

    def above(self, points: Array) -> Array:
        """(n, 3) points with their height above the plane through the origin as z, metres."""
        if self.slope == LEVEL:
            return points
        result = points.copy()
        result[:, 2] -= points[:, :2] @ np.array(self.slope)
        return result

    def supported(
        self, points: Array, tolerance: float, margin: float = 0.0
    ) -> npt.NDArray[np.bool_]:
        """s(x) for each point: is there surface under it, within `tolerance` of its height?

        `gaps` says how far above each point that surface is, too.

        Args:
            points: (n, 3), metres.
            tolerance: metres, above or below.
            margin: metres to be kept from where the surface drops or was not seen. Where a thing
                stands in the way there, nothing is to be kept from.

        Returns:
            (n,)
        """
        return np.isfinite(self.gaps(points, tolerance, margin))

    def gaps(self, points: Array, tolerance: float, margin: float = 0.0) -> Array:
        """(n,) m that surface is above each point; NaN where `supported` does not hold."""
        return np.asarray(
            _gaps(
                np.ascontiguousarray(self.above(points), dtype=np.float64),
                tolerance,
                margin + self.trim,
                self._view,
                self.ends,
                self.obstacles,
            )
        )

    def roomy(
        self, z: float, tolerance: float, margin: float, off: float = 0.0
    ) -> npt.NDArray[np.bool_]:
        """(s,) the surfaces on some point of which `supported` may hold at height z.

        Args:
            z: metres, above the plane through the origin.
            tolerance, margin: metres; as for `supported`.
            off: at any height that differs from z by no more, metres.
        """
        near = np.asarray(np.abs(self.height - z) <= tolerance + off)
        if margin + self.trim > self.cell_size:
            surely = np.asarray(np.abs(self.height - z) <= tolerance - off)
            _leave_out(self._view, self.ends, surely, margin + self.trim, near)
        return near


@kernel(lean=True)
def _at(
    start: npt.NDArray[np.int64], height: Array, column: int, z: float, tolerance: float
) -> int:
    """The surface of that column nearest to z, within the tolerance of it, or -1."""
    best = -1
    for s in range(start[column], start[column + 1]):
        off = abs(height[s] - z)
        if off <= tolerance and (best < 0 or off < abs(height[best] - z)):
            best = s
    return best


@kernel(nogil=True)
def _kinds(
    cells: npt.NDArray[np.int32],
    start: npt.NDArray[np.int64],
    height: Array,
    filled: npt.NDArray[np.bool_],
    radius: Array,
    nx: int,
    ny: int,
    size: float,
    step: float,
) -> npt.NDArray[np.uint8]:
    """`SupportMap.kind`."""
    kind = np.zeros(len(height), np.uint8)
    for least in range(2):  # first where the surface goes on around, then where these do
        for s in range(len(height)):
            i, j = cells[s, 0], cells[s, 1]
            if i < 1 or j < 1 or i >= nx - 1 or j >= ny - 1 or kind[s] < least:
                continue
            whole = least > 0 or filled[s] or radius[s] > _DENSE * size
            for di in range(-1, 2):
                for dj in range(-1, 2):
                    t = _at(start, height, (i + di) * ny + j + dj, height[s], step)
                    whole = whole and t >= 0 and kind[t] >= least
            if whole:
                kind[s] = least + 1
    return kind


@kernel(nogil=True)
def _counts(
    boxes: ObstacleArrays,
    measured: npt.NDArray[np.float32],
    measured_first: npt.NDArray[np.int64],
    cells: npt.NDArray[np.int32],
    height: Array,
    step: float,
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.bool_]]:
    """(s,) how many points were measured on each surface; whether in all quarters of its column."""
    nz = boxes.first_at.shape[2]
    count = np.zeros(len(height), np.int32)
    filled = np.zeros(len(height), np.bool_)
    for s in range(len(height)):
        i, j, layer = cells[s, 0], cells[s, 1], cells[s, 2]
        x = boxes.origin[0] + (i + 0.5) * boxes.cell_size
        y = boxes.origin[1] + (j + 0.5) * boxes.cell_size
        quarters = 0
        for k in range(max(layer - 1, 0), min(layer + 2, nz)):
            p = boxes.first_at[i, j, k]
            while p >= 0:
                if abs(boxes.surface_height[p] - height[s]) <= step:
                    for n in range(measured_first[p], measured_first[p + 1]):
                        count[s] += 1
                        quarters |= 1 << (2 * int(measured[n, 0] > x) + int(measured[n, 1] > y))
                p = boxes.next[p]
        filled[s] = quarters == 15
    return count, filled


@kernel(nogil=True)
def _points_on(
    boxes: ObstacleArrays,
    measured: npt.NDArray[np.float32],
    measured_first: npt.NDArray[np.int64],
    cells: npt.NDArray[np.int32],
    height: Array,
    kind: npt.NDArray[np.uint8],
    step: float,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float32]]:
    """The points (k, 2) of surfaces that end, and the first of each (s + 1,)."""
    nz = boxes.first_at.shape[2]
    first = np.zeros(len(height) + 1, np.int64)
    points = np.empty_like(measured)
    n = 0
    for s in range(len(height)):
        i, j, layer = cells[s, 0], cells[s, 1], cells[s, 2]
        for k in range(max(layer - 1, 0), min(layer + 2, nz)):
            p = boxes.first_at[i, j, k]
            while p >= 0 and kind[s] == _END:
                if abs(boxes.surface_height[p] - height[s]) <= step:
                    a, b = measured_first[p], measured_first[p + 1]
                    points[n : n + b - a] = measured[a:b]
                    n += b - a
                p = boxes.next[p]
        first[s + 1] = n
    return first, points[:n].copy()


@kernel(nogil=True)
def _radii(
    cells: npt.NDArray[np.int32],
    start: npt.NDArray[np.int64],
    height: Array,
    count: npt.NDArray[np.int32],
    nx: int,
    ny: int,
    size: float,
    step: float,
) -> Array:
    """`SupportMap.radius`: by the spacing in the fullest of the columns around."""
    radius = np.empty(len(height))
    for s in range(len(height)):
        most = 1
        for i in range(max(cells[s, 0] - 1, 0), min(cells[s, 0] + 2, nx)):
            for j in range(max(cells[s, 1] - 1, 0), min(cells[s, 1] + 2, ny)):
                t = _at(start, height, i * ny + j, height[s], step)
                if t >= 0:
                    most = max(most, count[t])
        radius[s] = min(_GAP * size / math.sqrt(most), _FARTHEST * size)
    return radius


@kernel(lean=True)
def _surrounded(view: _Surfaces, s: int, x: float, y: float) -> bool:
    """Whether a point lies in the hull of what was measured around it on surface s.

    The directions to these points are kept as the cone from u to v that holds them all, until one
    lies opposite to it. Columns in which the surface does not end count as a whole.
    """
    size, reach = view.cell_size, view.radius[s]
    ux = uy = vx = vy = 0.0
    begun = False
    i0 = max(math.floor((x - reach - view.origin[0]) / size), 0)
    i1 = min(math.floor((x + reach - view.origin[0]) / size), view.nx - 1)
    j0 = max(math.floor((y - reach - view.origin[1]) / size), 0)
    j1 = min(math.floor((y + reach - view.origin[1]) / size), view.ny - 1)
    middle_i = math.floor((x - view.origin[0]) / size)
    middle_j = math.floor((y - view.origin[1]) / size)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            away = max(abs(i - middle_i), abs(j - middle_j), 1)
            t = _at(view.start, view.height, i * view.ny + j, view.height[s], away * view.step)
            if t < 0:
                continue
            inner = view.kind[t] != _END
            left, front = view.origin[0] + i * size, view.origin[1] + j * size
            number = 5 if inner else view.first[t + 1] - view.first[t]
            for n in range(number):
                if not inner:
                    px = float(view.points[view.first[t] + n, 0])
                    py = float(view.points[view.first[t] + n, 1])
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
def _on_surface(view: _Surfaces, x: float, y: float, z: float, tolerance: float) -> int:
    """The level surface that carries a point, or -1."""
    size = view.cell_size
    # a point on the face between two columns belongs to both
    i0 = max(math.floor((x - _EPSILON - view.origin[0]) / size), 0)
    i1 = min(math.floor((x + _EPSILON - view.origin[0]) / size), view.nx - 1)
    j0 = max(math.floor((y - _EPSILON - view.origin[1]) / size), 0)
    j1 = min(math.floor((y + _EPSILON - view.origin[1]) / size), view.ny - 1)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            column = i * view.ny + j
            for s in range(view.start[column], view.start[column + 1]):
                if abs(z - view.height[s]) <= tolerance and (
                    view.kind[s] != _END or _surrounded(view, s, x, y)
                ):
                    return s
    return -1


@kernel(lean=True)
def _thing_between(
    view: _Surfaces,
    boxes: ObstacleArrays,
    x: float,
    y: float,
    z: float,
    dx: float,
    dy: float,
) -> bool:
    """Whether something rises from height z on the way from a point by dx, dy."""
    size = view.cell_size
    nz = boxes.first_at.shape[2]
    i0 = max(math.floor((min(x, x + dx) - _BESIDE - view.origin[0]) / size), 0)
    i1 = min(math.floor((max(x, x + dx) + _BESIDE - view.origin[0]) / size), view.nx - 1)
    j0 = max(math.floor((min(y, y + dy) - _BESIDE - view.origin[1]) / size), 0)
    j1 = min(math.floor((max(y, y + dy) + _BESIDE - view.origin[1]) / size), view.ny - 1)
    k0 = max(math.floor((z - view.step - view.origin[2]) / size), 0)
    k1 = min(math.floor((z + _BEGIN - view.origin[2]) / size), nz - 1)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            for k in range(k0, k1 + 1):
                p = boxes.first_at[i, j, k]
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
def _keeps(
    view: _Surfaces,
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
        if _on_surface(view, x + margin * cos, y + margin * sin, z, tolerance) >= 0:
            continue
        # it may go on unseen up to what stands beyond the last of its points
        far = margin + view.radius[s]
        if not _thing_between(view, boxes, x, y, z, far * cos, far * sin):
            return False
    return True


@kernel(nogil=True)
def _ends(view: _Surfaces, boxes: ObstacleArrays, tolerance: float) -> npt.NDArray[np.bool_]:
    """`SupportMap.ends`."""
    ends = np.zeros(len(view.points), np.bool_)
    for s in range(len(view.height)):
        for n in range(view.first[s], view.first[s + 1]):
            x, y = float(view.points[n, 0]), float(view.points[n, 1])
            ends[n] = not _keeps(view, boxes, s, x, y, view.height[s], tolerance, _OUTWARD)
    return ends


@kernel(lean=True)
def _end_within(
    view: _Surfaces,
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
    size = view.cell_size
    far = math.sqrt(margin * margin + (_FARTHEST * size) ** 2)
    i0 = max(math.floor((x - far - view.origin[0]) / size), 0)
    i1 = min(math.floor((x + far - view.origin[0]) / size), view.nx - 1)
    j0 = max(math.floor((y - far - view.origin[1]) / size), 0)
    j1 = min(math.floor((y + far - view.origin[1]) / size), view.ny - 1)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            for s in range(view.start[i * view.ny + j], view.start[i * view.ny + j + 1]):
                if abs(view.height[s] - z) > tolerance:
                    continue
                squared = margin * margin + view.radius[s] * view.radius[s]
                for n in range(view.first[s], view.first[s + 1]):
                    px, py = float(view.points[n, 0]), float(view.points[n, 1])
                    if ends[n] and (px - x) ** 2 + (py - y) ** 2 < squared:
                        return True
    return False


@kernel(nogil=True)
def _gaps(
    points: Array,
    tolerance: float,
    margin: float,
    view: _Surfaces,
    ends: npt.NDArray[np.bool_],
    boxes: ObstacleArrays,
) -> Array:
    """`SupportMap.gaps`."""
    result = np.full(len(points), np.nan)
    beside = min(margin, view.cell_size)
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        s = _on_surface(view, x, y, z, tolerance)
        if s < 0:
            continue
        if margin <= 0.0:
            result[p] = view.height[s] - z
            continue
        if view.kind[s] != _DEEP and not _keeps(view, boxes, s, x, y, z, tolerance, beside):
            continue
        if margin <= view.cell_size or not _end_within(view, ends, x, y, z, tolerance, margin):
            result[p] = view.height[s] - z
    return result


@kernel(nogil=True)
def _leave_out(
    view: _Surfaces,
    ends: npt.NDArray[np.bool_],
    ending: npt.NDArray[np.bool_],
    margin: float,
    near: npt.NDArray[np.bool_],
) -> None:
    """Clear those of `near` that have no point as far from the ends of those `ending` as asked."""
    size = view.cell_size
    for s in range(len(view.height)):
        if not ending[s]:
            continue
        reach = math.sqrt(margin * margin + view.radius[s] * view.radius[s])
        reach -= _HALF_DIAGONAL * size + _ON
        for n in range(view.first[s], view.first[s + 1]):
            if not ends[n]:
                continue
            x, y = float(view.points[n, 0]), float(view.points[n, 1])
            i0 = max(math.floor((x - reach - view.origin[0]) / size), 0)
            i1 = min(math.floor((x + reach - view.origin[0]) / size), view.nx - 1)
            j0 = max(math.floor((y - reach - view.origin[1]) / size), 0)
            j1 = min(math.floor((y + reach - view.origin[1]) / size), view.ny - 1)
            for i in range(i0, i1 + 1):
                for j in range(j0, j1 + 1):
                    across = view.origin[0] + (i + 0.5) * size - x
                    along = view.origin[1] + (j + 0.5) * size - y
                    if across * across + along * along < reach * reach:
                        column = i * view.ny + j
                        near[view.start[column] : view.start[column + 1]] = False
