"""Distances to the obstacle set: d_S of the clearance objective, and a sound bound everywhere."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import Array, TargetVolume

Field = npt.NDArray[np.float32]
Index = npt.NDArray[np.int32]


class ClearanceField:
    """d_S: distance sideways and upwards to obstacles inside V, capped.

    Sampled on the grid lines of the obstacle set in x and y and on the lower face of each layer,
    exact there but for half a cell where several boxes of one row compete. A query takes the first
    such face at or above the point, so that nothing below it counts, and interpolates linearly in
    x and y: within 1.2 cells of the exact distance at that face. Things that end between the point
    and that face are missed, which for the mean over a body concerns one layer of it.

    Args:
        obstacles: those of its boxes that touch V count.
        volume: V.
        cap: greatest value, metres: what an empty table has.
        contact_tolerance: boxes that rise by less than this above a layer are support, not
            obstacle, for points in it, metres.
        padding: how far around V, in x and y, values are kept, metres; beyond, the nearest counts.
    """

    def __init__(
        self,
        obstacles: ObstacleSet,
        volume: TargetVolume,
        cap: float = 0.5,
        contact_tolerance: float = 0.003,
        padding: float = 0.3,
    ) -> None:
        for name, value in (
            ("cap", cap),
            ("contact_tolerance", contact_tolerance),
            ("padding", padding),
        ):
            if not (math.isfinite(value) and value >= 0.0):
                raise ParameterError(name, value, "give a length of at least 0 m")
        size = obstacles.cell_size
        first = np.floor((volume.lower - obstacles.origin) / size).astype(np.int64)
        last = np.floor((volume.upper - obstacles.origin) / size).astype(np.int64)
        margin = math.ceil(padding / size)
        first[:2] -= margin
        last[:2] += margin
        touching = ((obstacles.upper >= volume.lower) & (obstacles.lower <= volume.upper)).all(1)
        rows = np.flatnonzero(touching)
        self.cap = float(cap)
        self.cell_size = size
        self.origin = obstacles.origin + first * size
        self.values = _clearance_layers(
            np.ascontiguousarray(obstacles.lower[rows]),
            np.ascontiguousarray(obstacles.upper[rows]),
            (obstacles.cells[rows] - first).astype(np.int64),
            self.origin,
            size,
            int(last[0] - first[0]) + 2,
            int(last[1] - first[1]) + 2,
            int(last[2] - first[2]) + 1,
            cap,
            contact_tolerance,
        )
        self.values.setflags(write=False)

    def distance(self, points: Array) -> Array:
        """(n,) d_S at the (n, 3) points, metres."""
        return np.asarray(self._evaluate(points)[:, 0])

    def gradient(self, points: Array) -> Array:
        """(n, 2) ∂d_S/∂x and ∂d_S/∂y at the (n, 3) points, of the interpolation itself."""
        return np.asarray(self._evaluate(points)[:, 1:])

    def _evaluate(self, points: Array) -> Array:
        return np.asarray(
            _evaluate(self.values, self.origin, self.cell_size, self.cap, _contiguous(points))
        )

    def mean_clearance(self, T_world_object: Array, points: Array) -> tuple[float, Array]:
        """C(x) of the clearance objective, and ∂C/∂(x, y, e_z) about the object's origin.

        Args:
            T_world_object: (4, 4).
            points: (n, 3), B_o in the object frame.

        Returns:
            The mean of d_S over B_o, metres; (3,) its change per metre, metre and radian.
        """
        values, gradients = self.mean_clearance_batch(np.asarray(T_world_object)[None], points)
        return float(values[0]), np.asarray(gradients[0])

    def mean_clearance_batch(self, T_world_object: Array, points: Array) -> tuple[Array, Array]:
        """(m,) and (m, 3): `mean_clearance` of the (m, 4, 4) poses."""
        values, gradients = mean_clearance(
            self.values,
            self.origin,
            self.cell_size,
            self.cap,
            _contiguous(T_world_object),
            _contiguous(points),
        )
        return values, gradients


def _contiguous(values: Array) -> Array:
    return np.ascontiguousarray(values, dtype=np.float64)


@njit(cache=True)
def _clearance_layers(
    lower: Array,
    upper: Array,
    cells: npt.NDArray[np.int64],
    origin: Array,
    size: float,
    nx: int,
    ny: int,
    nz: int,
    cap: float,
    contact_tolerance: float,
) -> Field:
    """(nz, nx, ny) capped distance from the grid points of each layer's lower face.

    Per layer, the box nearest in x and y to each grid point, over rows of cells outwards; then,
    per grid point, the least over the layers above of the distance to these boxes.
    """
    values = np.full((nz, nx, ny), cap, np.float32)
    nearest = np.full((nz, nx, ny), -1, np.int32)
    rising = np.full((nx, ny), -1, np.int32)
    order = np.argsort(cells[:, 2], kind="mergesort")
    start = np.searchsorted(cells[order, 2], np.arange(nz + 1))
    for k in range(nz):
        base = origin[2] + k * size
        rows = order[start[k] : start[k + 1]]
        _nearest_boxes(rows, lower, upper, cells, origin, size, cap, nearest[k])
        partly = False
        for r in rows:
            partly = partly or upper[r, 2] < base + contact_tolerance
        if partly:
            high = rows[upper[rows, 2] >= base + contact_tolerance]
            rising[:] = -1
            _nearest_boxes(high, lower, upper, cells, origin, size, cap, rising)
        else:
            rising[:] = nearest[k]
        for i in range(nx):
            for j in range(ny):
                r = rising[i, j]
                if r >= 0:
                    values[k, i, j] = min(cap, _distance(lower, upper, r, origin, size, i, j, base))
    for k in range(nz):
        base = origin[2] + k * size
        for above in range(k + 1, min(nz, k + int(cap / size) + 2)):
            rise = (above - k) * size
            for i in range(nx):
                for j in range(ny):
                    r = nearest[above, i, j]
                    if r >= 0 and rise < values[k, i, j]:
                        d = _distance(lower, upper, r, origin, size, i, j, base)
                        if d < values[k, i, j]:
                            values[k, i, j] = d
    return values


@njit(cache=True)
def _distance(
    lower: Array, upper: Array, r: int, origin: Array, size: float, i: int, j: int, z: float
) -> float:
    x, y = origin[0] + i * size, origin[1] + j * size
    dx = max(lower[r, 0] - x, 0.0, x - upper[r, 0])
    dy = max(lower[r, 1] - y, 0.0, y - upper[r, 1])
    dz = max(lower[r, 2] - z, 0.0)
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@njit(cache=True)
def _nearest_boxes(
    rows: npt.NDArray[np.int64],
    lower: Array,
    upper: Array,
    cells: npt.NDArray[np.int64],
    origin: Array,
    size: float,
    cap: float,
    nearest: Index,
) -> None:
    """Row of the box nearest in x and y to each grid point, -1 where none is within the cap."""
    if len(rows) == 0:
        return
    nx, ny = nearest.shape
    # boxes may lie outside the padded grid by the part of V's border cells only
    width = nx - 1
    depth = ny - 1
    # nearest box below and above each grid point within each column of cells along y
    before = np.full((width, ny), -1, np.int32)
    after = np.full((width, ny), -1, np.int32)
    used = np.zeros(width, np.bool_)
    for r in rows:
        i, j = cells[r, 0], cells[r, 1]
        if i < 0 or i >= width or j < 0 or j >= depth:
            continue
        used[i] = True
        q = before[i, j + 1]
        if q < 0 or upper[r, 1] > upper[q, 1]:
            before[i, j + 1] = r
        q = after[i, j]
        if q < 0 or lower[r, 1] < lower[q, 1]:
            after[i, j] = r
    for i in range(width):
        if used[i]:
            for j in range(1, ny):
                if before[i, j] < 0:
                    before[i, j] = before[i, j - 1]
            for j in range(ny - 2, -1, -1):
                if after[i, j] < 0:
                    after[i, j] = after[i, j + 1]
    for i in range(nx):
        x = origin[0] + i * size
        for j in range(ny):
            y = origin[1] + j * size
            best = cap * cap
            found = -1
            for step in range(width + 1):
                if (step * size) ** 2 >= best:
                    break
                # columns i - 1 - step and i + step touch or flank the grid point
                for side in range(2):
                    column = i + step if side == 0 else i - 1 - step
                    if column < 0 or column >= width or not used[column]:
                        continue
                    for direction in range(2):
                        r = before[column, j] if direction == 0 else after[column, j]
                        if r < 0:
                            continue
                        dx = max(lower[r, 0] - x, 0.0, x - upper[r, 0])
                        dy = max(lower[r, 1] - y, 0.0, y - upper[r, 1])
                        d = dx * dx + dy * dy
                        if d < best:
                            best = d
                            found = r
            nearest[i, j] = found


@njit(cache=True)
def _evaluate(values: Field, origin: Array, size: float, cap: float, points: Array) -> Array:
    """(n, 3) d_S, ∂d_S/∂x, ∂d_S/∂y."""
    result = np.empty((len(points), 3))
    for p in range(len(points)):
        d, gx, gy = _interpolate(
            values, origin, size, cap, points[p, 0], points[p, 1], points[p, 2]
        )
        result[p, 0], result[p, 1], result[p, 2] = d, gx, gy
    return result


@njit(cache=True, inline="always")
def _interpolate(
    values: Field, origin: Array, size: float, cap: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    nz, nx, ny = values.shape
    layer = math.ceil((z - origin[2]) / size - 1e-9)
    if layer >= nz:
        return cap, 0.0, 0.0
    k = max(layer, 0)
    u = (x - origin[0]) / size
    v = (y - origin[1]) / size
    in_x = 0.0 <= u <= nx - 1.0
    in_y = 0.0 <= v <= ny - 1.0
    u = min(max(u, 0.0), nx - 1.0)
    v = min(max(v, 0.0), ny - 1.0)
    i = min(int(u), nx - 2)
    j = min(int(v), ny - 2)
    u -= i
    v -= j
    a, b = values[k, i, j], values[k, i, j + 1]
    c, d = values[k, i + 1, j], values[k, i + 1, j + 1]
    near = a + (b - a) * v
    far = c + (d - c) * v
    gx = (far - near) / size if in_x else 0.0
    gy = ((b - a) * (1.0 - u) + (d - c) * u) / size if in_y else 0.0
    return near + (far - near) * u, gx, gy


@njit(cache=True)
def mean_clearance(
    values: Field, origin: Array, size: float, cap: float, T_world_object: Array, points: Array
) -> tuple[Array, Array]:
    """(m,) mean of d_S over the (n, 3) points at each of the (m, 4, 4) poses; (m, 3) gradients."""
    m, n = len(T_world_object), len(points)
    means = np.zeros(m)
    gradients = np.zeros((m, 3))
    for t in range(m):
        T = T_world_object[t]
        total, along_x, along_y, turn = 0.0, 0.0, 0.0, 0.0
        for p in range(n):
            a, b, c = points[p, 0], points[p, 1], points[p, 2]
            rx = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c
            ry = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c
            rz = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c
            d, gx, gy = _interpolate(
                values, origin, size, cap, rx + T[0, 3], ry + T[1, 3], rz + T[2, 3]
            )
            total += d
            along_x += gx
            along_y += gy
            turn += gy * rx - gx * ry
        if n > 0:
            means[t] = total / n
            gradients[t, 0] = along_x / n
            gradients[t, 1] = along_y / n
            gradients[t, 2] = turn / n
    return means, gradients


@dataclass(frozen=True, slots=True, eq=False)
class DistanceBound:
    """Lower bounds of the Euclidean distance to the obstacle set, one per cell.

    For any point p in cell c, its distance to the nearest box is at least
    values[c] - |p - centre(c)|; values are capped.

    Attributes:
        origin: (3,) lower corner of the grid, that of the obstacle set.
        cell_size: metres.
        values: (nx, ny, nz) float32, metres.
        cap: greatest value.
    """

    origin: Array
    cell_size: float
    values: Field
    cap: float


def distance_bound_field(obstacles: ObstacleSet, cap: float = 0.3) -> DistanceBound:
    """Bound the distance from the centre of every cell to the boxes of the obstacle set.

    Exact (to float32, rounded down) up to 2.5 cells. Beyond, exact in z and to the near face of
    the box's cell in x and y: too low by at most a cell in each.

    Args:
        cap: greatest value, metres; larger ones cost time.
    """
    if not (math.isfinite(cap) and cap > 0.0):
        raise ParameterError("cap", cap, "give a finite length above 0 m")
    values = _distance_bound(
        obstacles.lower,
        obstacles.upper,
        obstacles.cells,
        obstacles.origin,
        obstacles.cell_size,
        *obstacles.shape,
        cap,
    )
    values.setflags(write=False)
    return DistanceBound(obstacles.origin, obstacles.cell_size, values, float(cap))


@njit(cache=True)
def _distance_bound(
    lower: Array,
    upper: Array,
    cells: Index,
    origin: Array,
    size: float,
    nx: int,
    ny: int,
    nz: int,
    cap: float,
) -> Field:
    limit = np.float32(cap * cap)
    values = np.full((nx, ny, nz), limit, np.float32)
    column_used = np.zeros((nx, ny), np.bool_)
    # squared distance in z to the boxes of the cell's own column
    m = len(cells)
    first = 0
    while first < m:
        i, j = cells[first, 0], cells[first, 1]
        last = first
        while last < m and cells[last, 0] == i and cells[last, 1] == j:
            last += 1
        column_used[i, j] = True
        near = first
        for k in range(nz):
            z = origin[2] + (k + 0.5) * size
            while near < last and cells[near, 2] < k:
                near += 1
            best = cap
            # boxes of this layer, and those next to it below and above
            for r in range(near - 1, first - 1, -1):
                best = min(best, max(0.0, z - upper[r, 2]))
                if cells[r, 2] < cells[near - 1, 2]:
                    break
            above = cells[near, 2] if near < last else 0
            for r in range(near, last):
                if cells[r, 2] > above:
                    if above > k:
                        break
                    above = cells[r, 2]
                best = min(best, max(0.0, lower[r, 2] - z, z - upper[r, 2]))
            values[i, j, k] = best * best
        first = last
    steps = int(cap / size + 0.5) + 1
    slab = np.empty((max(nx, ny), nz), np.float32)
    plane_used = np.zeros(nx, np.bool_)
    # then along y, then along x, to the near faces of the other cells
    for i in range(nx):
        for j in range(ny):
            plane_used[i] = plane_used[i] or column_used[i, j]
        if not plane_used[i]:
            continue
        slab[:ny] = values[i]
        for j in range(ny):
            for step in range(1, steps + 1):
                gap = np.float32(((step - 0.5) * size) ** 2)
                if j - step >= 0 and column_used[i, j - step]:
                    _lower_by(values[i, j], slab[j - step], gap)
                if j + step < ny and column_used[i, j + step]:
                    _lower_by(values[i, j], slab[j + step], gap)
    for j in range(ny):
        for i in range(nx):
            slab[i] = values[i, j]
        for i in range(nx):
            for step in range(1, steps + 1):
                gap = np.float32(((step - 0.5) * size) ** 2)
                if i - step >= 0 and plane_used[i - step]:
                    _lower_by(values[i, j], slab[i - step], gap)
                if i + step < nx and plane_used[i + step]:
                    _lower_by(values[i, j], slab[i + step], gap)
    _refine_near(lower, upper, cells, origin, size, values)
    flat = values.reshape(-1)
    for c in range(len(flat)):
        flat[c] = np.float32(math.sqrt(flat[c]) * (1.0 - 4e-7))
    return values


@njit(cache=True)
def _lower_by(target: Field, source: Field, gap: np.float32) -> None:
    """target = min(target, source + gap)."""
    for k in range(len(target)):
        candidate = source[k] + gap
        target[k] = candidate if candidate < target[k] else target[k]


@njit(cache=True)
def _refine_near(
    lower: Array, upper: Array, cells: Index, origin: Array, size: float, values: Field
) -> None:
    """Raise values to the exact squared distance where all boxes that could matter are near.

    Boxes of cells more than two away are at least 2.5 cells from the centre.
    """
    nx, ny, nz = values.shape
    beyond = np.float32((2.5 * size) ** 2)
    exact = np.full((5, ny, nz), beyond, np.float32)  # planes i - 2 .. i + 2, cyclic
    row = 0
    m = len(cells)
    for plane in range(nx + 2):
        while row < m and cells[row, 0] == plane:
            _scatter(lower, upper, cells, origin, size, row, exact, nx)
            row += 1
        done = plane - 2
        if done >= 0:
            near = exact[done % 5]
            for j in range(ny):
                for k in range(nz):
                    if values[done, j, k] < near[j, k]:
                        values[done, j, k] = near[j, k]
                    near[j, k] = beyond


@njit(cache=True)
def _scatter(
    lower: Array,
    upper: Array,
    cells: Index,
    origin: Array,
    size: float,
    row: int,
    exact: Field,
    nx: int,
) -> None:
    _, ny, nz = exact.shape
    ci, cj, ck = cells[row, 0], cells[row, 1], cells[row, 2]
    for i in range(max(ci - 2, 0), min(ci + 3, nx)):
        x = origin[0] + (i + 0.5) * size
        dx = max(lower[row, 0] - x, 0.0, x - upper[row, 0])
        for j in range(max(cj - 2, 0), min(cj + 3, ny)):
            y = origin[1] + (j + 0.5) * size
            dy = max(lower[row, 1] - y, 0.0, y - upper[row, 1])
            for k in range(max(ck - 2, 0), min(ck + 3, nz)):
                z = origin[2] + (k + 0.5) * size
                dz = max(lower[row, 2] - z, 0.0, z - upper[row, 2])
                d = np.float32(dx * dx + dy * dy + dz * dz)
                if d < exact[i % 5, j, k]:
                    exact[i % 5, j, k] = d
