"""d_S, the distance to the obstacle set that the clearance objective averages."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.grid import ObstacleArrays, ObstacleSet
from placement_planner_ros.core.types import Array, TargetVolume

Field = npt.NDArray[np.float32]
Index = npt.NDArray[np.int32]


class _Layers(NamedTuple):
    """What `_interpolate` reads of a `ClearanceField`."""

    values: Field
    """(2, nz, nx, ny) of `_clearance_layers`."""
    origin: Array
    size: float
    cap: float
    tolerance: float


class ClearanceField:
    """d_S: distance sideways and upwards to obstacles inside V, capped.

    Sampled on the grid lines of the obstacle set in x and y and on the lower face of each layer,
    exact there but for less than a cell where several boxes of one layer compete. A query takes
    the first such face at or above the point, so that nothing below it counts, and interpolates
    linearly in x and y: within 1.2 cells of the exact distance at that face. Things that end
    between the point and that face are missed, which for the mean over a body concerns one layer.

    Support may rise a little above a point that rests on it. Boxes of the face's layer that rise by
    less than the contact tolerance above the face are therefore left out for points within the
    tolerance below it, and only for those: further down they are something overhead.

    Args:
        obstacles: those of its boxes that touch V count.
        volume: V.
        cap: greatest value, metres: what an empty table has.
        contact_tolerance: boxes that rise by less than this above a point may be its support,
            metres.
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
        self.contact_tolerance = contact_tolerance
        self.cell_size = size
        self.origin = obstacles.origin + first * size
        self.values = _clearance_layers(
            obstacles.arrays._replace(
                origin=self.origin,
                cells=(obstacles.cells[rows] - first).astype(np.int32),
                lower=obstacles.lower[rows],
                upper=obstacles.upper[rows],
            ),
            int(last[0] - first[0]) + 2,
            int(last[1] - first[1]) + 2,
            int(last[2] - first[2]) + 1,
            self.cap,
            contact_tolerance,
        )
        self.values.setflags(write=False)
        self._layers = _Layers(self.values, self.origin, size, self.cap, contact_tolerance)

    def distance(self, points: Array) -> Array:
        """(n,) d_S at the (n, 3) points, metres."""
        return np.asarray(self._evaluate(points)[:, 0])

    def gradient(self, points: Array) -> Array:
        """(n, 2) ∂d_S/∂x and ∂d_S/∂y at the (n, 3) points, of the interpolation itself."""
        return np.asarray(self._evaluate(points)[:, 1:])

    def _evaluate(self, points: Array) -> Array:
        return np.asarray(_evaluate(self._layers, _contiguous(points)))

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
        return mean_clearance(self._layers, _contiguous(T_world_object), _contiguous(points))


def _contiguous(values: Array) -> Array:
    """Read-only, so that a kernel compiles once, whatever it is given."""
    view = np.ascontiguousarray(values, dtype=np.float64).view()
    view.setflags(write=False)
    return view


@kernel(nogil=True)
def _clearance_layers(
    boxes: ObstacleArrays, nx: int, ny: int, nz: int, cap: float, contact_tolerance: float
) -> Field:
    """(2, nz, nx, ny) capped distance from the grid points of each layer's lower face.

    Per layer, the box nearest in x and y to each grid point; then, per grid point, the least over
    this layer and those above of the distance to these boxes. [0] leaves out the boxes of the
    layer itself that rise by less than the tolerance above its face, [1] leaves out none.
    """
    limit = np.float32(cap * cap)
    values = np.full((2, nz, nx, ny), limit, np.float32)
    # squared distance in x and y to the nearest box of each layer, and its height above the origin
    aside = np.full((nz, nx, ny), np.inf, np.float32)
    height = np.zeros((nz, nx, ny), np.float32)
    nearest = np.empty((nx, ny), np.int32)
    rising = np.empty((nx, ny), np.int32)
    order = np.argsort(boxes.cells[:, 2], kind="mergesort")
    start = np.searchsorted(boxes.cells[order, 2], np.arange(nz + 1))
    for k in range(nz):
        rows = order[start[k] : start[k + 1]]
        if len(rows) == 0:
            continue
        top = boxes.origin[2] + k * boxes.cell_size + contact_tolerance
        _nearest_boxes(boxes, rows, cap, nearest)
        high = rows[boxes.upper[rows, 2] >= top]
        if len(high) < len(rows):
            _nearest_boxes(boxes, high, cap, rising)
        _add_own_layer(boxes, k, cap, top, nearest, rising, aside, height, values)
    _add_layers_above(aside, height, values, boxes.cell_size, cap)
    return values


@kernel(lean=True)
def _add_own_layer(
    boxes: ObstacleArrays,
    k: int,
    cap: float,
    top: float,
    nearest: Index,
    rising: Index,
    aside: Field,
    height: Field,
    values: Field,
) -> None:
    """Fill layer k, squared, from its nearest boxes (nx, ny), and those of them above `top`.

    The latter where the nearest of all ends below `top`.
    """
    _, _, nx, ny = values.shape
    limit = np.float32(cap * cap)
    for i in range(nx):
        for j in range(ny):
            r = nearest[i, j]
            if r < 0:
                continue
            aside[k, i, j] = _aside(boxes, r, i, j)
            height[k, i, j] = boxes.lower[r, 2] - boxes.origin[2]
            rise = max(boxes.lower[r, 2] - boxes.origin[2] - k * boxes.cell_size, 0.0)
            values[1, k, i, j] = min(limit, np.float32(aside[k, i, j] + rise * rise))
            if boxes.upper[r, 2] >= top:
                values[0, k, i, j] = values[1, k, i, j]
            elif rising[i, j] >= 0:
                r = rising[i, j]
                rise = max(boxes.lower[r, 2] - boxes.origin[2] - k * boxes.cell_size, 0.0)
                distance = _aside(boxes, r, i, j) + rise * rise
                values[0, k, i, j] = min(limit, np.float32(distance))


@kernel(nogil=True)
def _add_layers_above(aside: Field, height: Field, values: Field, size: float, cap: float) -> None:
    """Lower all squared distances by those to the boxes of the layers above; take the root."""
    _, nz, nx, ny = values.shape
    flat = (nx * ny,)
    for k in range(nz):
        face = np.float32(k * size)
        over = np.full(nx * ny, np.float32(cap * cap), np.float32)
        for above in range(k + 1, min(nz, k + int(cap / size) + 2)):
            _lower_by_boxes(over, aside[above].reshape(flat), height[above].reshape(flat), face)
        for s in range(2):
            layer = values[s, k].reshape(flat)
            for i in range(nx * ny):
                layer[i] = np.sqrt(min(layer[i], over[i]))


@kernel(lean=True)
def _lower_by_boxes(squared: Field, aside: Field, height: Field, face: np.float32) -> None:
    """Lower (n,) squared distances by those to boxes that begin `height` above the origin."""
    for i in range(len(squared)):
        rise = height[i] - face
        candidate = aside[i] + rise * rise
        squared[i] = candidate if candidate < squared[i] else squared[i]


@kernel(inline=True)
def _aside(boxes: ObstacleArrays, r: int, i: int, j: int) -> float:
    """Squared distance in x and y from a grid point to box r."""
    x, y = boxes.origin[0] + i * boxes.cell_size, boxes.origin[1] + j * boxes.cell_size
    dx = max(boxes.lower[r, 0] - x, 0.0, x - boxes.upper[r, 0])
    dy = max(boxes.lower[r, 1] - y, 0.0, y - boxes.upper[r, 1])
    return dx * dx + dy * dy


@kernel(nogil=True)
def _columns_of_boxes(
    boxes: ObstacleArrays, rows: npt.NDArray[np.int64], width: int, depth: int
) -> tuple[Index, Index]:
    """Row of the last box before and the first after each grid point along y, per column of cells.

    (depth + 1, width), -1 where there is none.
    """
    lower, upper = boxes.lower, boxes.upper
    before = np.full((depth + 1, width), -1, np.int32)
    after = np.full((depth + 1, width), -1, np.int32)
    # The boxes of each cell count at the grid points at its ends, ...
    for r in rows:
        i, j = boxes.cells[r, 0], boxes.cells[r, 1]
        if i < 0 or i >= width or j < 0 or j >= depth:
            continue  # of the cells around V that boxes touching V may lie in
        q = before[j + 1, i]
        if q < 0 or upper[r, 1] > upper[q, 1]:
            before[j + 1, i] = r
        q = after[j, i]
        if q < 0 or lower[r, 1] < lower[q, 1]:
            after[j, i] = r
    # ... and on from there up to the next ones.
    for j in range(1, depth + 1):
        for i in range(width):
            if before[j, i] < 0:
                before[j, i] = before[j - 1, i]
    for j in range(depth - 1, -1, -1):
        for i in range(width):
            if after[j, i] < 0:
                after[j, i] = after[j + 1, i]
    return before, after


@kernel(nogil=True)
def _nearest_boxes(
    boxes: ObstacleArrays, rows: npt.NDArray[np.int64], cap: float, nearest: Index
) -> None:
    """Row of the box nearest in x and y to each grid point, -1 where none is within the cap.

    Per column of cells along y, the nearest box before and after each grid point; then, per line
    along x, the lower envelope of the squared distances to these boxes (P. Felzenszwalb and
    D. Huttenlocher, Distance transforms of sampled functions, 2012).
    """
    nearest[:] = -1
    if len(rows) == 0:
        return
    lower, upper, origin = boxes.lower, boxes.upper, boxes.origin
    nx, ny = nearest.shape
    width = nx - 1
    before, after = _columns_of_boxes(boxes, rows, width, ny - 1)
    # a box is two parabolas along the line, with their feet at its ends
    box = np.empty(4 * width, np.int32)
    foot = np.empty(4 * width)
    base = np.empty(4 * width)
    ends = np.empty(4 * width)  # from where on each is the least
    for j in range(ny):
        y = origin[1] + j * boxes.cell_size
        n = 0
        for i in range(width):
            first = n
            for side in range(2):
                r = before[j, i] if side == 0 else after[j, i]
                if r < 0:
                    continue
                gap = max(lower[r, 1] - y, 0.0, y - upper[r, 1])
                if gap < cap:
                    for a in range(2):
                        foot[n] = lower[r, 0] if a == 0 else upper[r, 0]
                        base[n] = gap * gap
                        box[n] = r
                        n += 1
            _sort_feet(foot, base, box, first, n)
        n = _lower_envelope(foot, base, box, ends, n)
        at = 0
        for i in range(nx):
            x = origin[0] + i * boxes.cell_size
            while at + 1 < n and ends[at + 1] <= x:
                at += 1
            if n > 0 and (x - foot[at]) ** 2 + base[at] < cap * cap:
                nearest[i, j] = box[at]


@kernel(lean=True)
def _sort_feet(foot: Array, base: Array, box: Index, first: int, last: int) -> None:
    """Sort the few parabolas first..last of one column by their feet."""
    for t in range(first + 1, last):
        x, a, r = foot[t], base[t], box[t]
        s = t - 1
        while s >= first and foot[s] > x:
            foot[s + 1], base[s + 1], box[s + 1] = foot[s], base[s], box[s]
            s -= 1
        foot[s + 1], base[s + 1], box[s + 1] = x, a, r


@kernel(lean=True)
def _lower_envelope(foot: Array, base: Array, box: Index, ends: Array, count: int) -> int:
    """Keep of the parabolas (x - foot)² + base, sorted by foot, those least somewhere.

    Returns:
        Their number n; from ends[i] to ends[i + 1] the least is i.
    """
    n = 0
    for t in range(count):
        x, a = foot[t], base[t]
        begin = -np.inf
        keep = True
        while n > 0:
            width = x - foot[n - 1]
            if width <= 0.0:
                keep = a < base[n - 1]
                if not keep:
                    break
            else:
                # where the new one crosses the last
                begin = 0.5 * ((a - base[n - 1]) / width + x + foot[n - 1])
                if begin > ends[n - 1]:
                    break
            n -= 1
            begin = -np.inf
        if keep:
            foot[n], base[n], box[n], ends[n] = x, a, box[t], begin
            n += 1
    return n


@kernel(nogil=True)
def _evaluate(layers: _Layers, points: Array) -> Array:
    """(n, 3) d_S, ∂d_S/∂x, ∂d_S/∂y."""
    result = np.empty((len(points), 3))
    for p in range(len(points)):
        d, gx, gy = _interpolate(layers, points[p, 0], points[p, 1], points[p, 2])
        result[p, 0], result[p, 1], result[p, 2] = d, gx, gy
    return result


@kernel(inline=True)
def _interpolate(layers: _Layers, x: float, y: float, z: float) -> tuple[float, float, float]:
    """d_S at a point, and its change along x and y: bilinear on the first face at or above it."""
    values, origin, size = layers.values, layers.origin, layers.size
    _, nz, nx, ny = values.shape
    layer = math.ceil((z - origin[2]) / size - 1e-9)
    if layer >= nz:
        return layers.cap, 0.0, 0.0
    k = max(layer, 0)
    s = 1 if origin[2] + k * size - z > layers.tolerance else 0
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
    a, b = values[s, k, i, j], values[s, k, i, j + 1]
    c, d = values[s, k, i + 1, j], values[s, k, i + 1, j + 1]
    near = a + (b - a) * v
    far = c + (d - c) * v
    gx = (far - near) / size if in_x else 0.0
    gy = ((b - a) * (1.0 - u) + (d - c) * u) / size if in_y else 0.0
    return near + (far - near) * u, gx, gy


@kernel()
def mean_clearance(layers: _Layers, T_world_object: Array, points: Array) -> tuple[Array, Array]:
    """(m,) mean of d_S over the (n, 3) points at each of the (m, 4, 4) poses; (m, 3) gradients.

    A turn by e_z about the object's origin moves a point at (rx, ry) from it along (-ry, rx).
    """
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
            d, gx, gy = _interpolate(layers, rx + T[0, 3], ry + T[1, 3], rz + T[2, 3])
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
