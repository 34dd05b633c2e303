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


_UPRIGHT = 0.2
"""Boxes higher than this share of a cell are of a wall, and less than it off its other boxes."""
_STEPS = 8
"""Cells to go at most from the nearest upright box to the nearest turned one."""
_TALLEST = 0.12
"""m, more than any box is high."""
_LEVEL = 0.00125
"""m between two levels, where there is room for so many."""
_AROUND = 2
"""Levels from the middle of a voxel to its upper face."""
_BLOCK = 32
"""Grid points whose values are turned around at once."""
MAX_VALUES = 8_000_000
"""Values that a field has at most, of 4 bytes each."""


class _Levels(NamedTuple):
    """What `_interpolate` reads of a `ClearanceField`."""

    values: Field
    """(nx, ny, nz) of `_clearance_levels`."""
    origin: Array
    size: float
    rise: float
    cap: float
    lift: float


class ClearanceField:
    """d_S: distance sideways and upwards to obstacles inside V, capped.

    Nothing that ends below a point counts for it, so d_S jumps where a thing ends beside it. A
    point stands for what is around it, from half a voxel below to half a voxel above: its value is
    the mean of d_S over this height. So the clearance of a body is continuous in z too, and the
    heights at which things end count as they were measured, wherever the layers of cells lie.

    Sampled on the grid lines of the obstacle set in x and y, exact there but for less than a cell
    where several boxes that end at one height compete, and interpolated linearly between them; in
    z on levels 1.25 mm apart, with what ends between two of them counted by its share. Where V is
    so large that this would take more than `MAX_VALUES`, lines and levels are further apart.

    What a body stands on does not count, and may rise by the contact tolerance above its lowest
    point: what of the body is lower than `lift` above that point is judged at that height.

    Args:
        obstacles: those of its boxes that touch V count, up to where V ends.
        volume: V.
        cap: greatest value, metres: what an empty table has.
        contact_tolerance: by how much support may rise above a body's lowest point, metres.
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
        step, rise = _spacing(volume.upper - volume.lower, obstacles.cell_size, padding)
        size = obstacles.cell_size * step
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
        self.level = rise
        self.lift = contact_tolerance + (_AROUND + 1) * rise
        self.origin = obstacles.origin + first * size
        self.origin[2] = (math.floor(volume.lower[2] / rise) - _AROUND) * rise
        top = volume.upper[2] + obstacles.cell_size
        ends = np.minimum(_ends(obstacles.arrays, rows), volume.upper[2])
        cells = obstacles.cells[rows] // step - first
        self.values = _clearance_levels(
            obstacles.arrays._replace(
                origin=self.origin,
                cell_size=size,
                cells=cells.astype(np.int32),
                lower=obstacles.lower[rows],
                upper=obstacles.upper[rows],
            ),
            obstacles.outline[rows],
            ends,
            int(last[0] - first[0]) + 2,
            int(last[1] - first[1]) + 2,
            math.ceil((top - self.origin[2]) / rise) + 2 * _AROUND + 2,
            rise,
            self.cap,
        )
        self.values.setflags(write=False)
        self._levels = _Levels(self.values, self.origin, size, rise, self.cap, self.lift)

    def distance(self, points: Array) -> Array:
        """(n,) d_S around the (n, 3) points, whatever they may stand on, metres."""
        return np.asarray(self._evaluate(points)[:, 0])

    def gradient(self, points: Array) -> Array:
        """(n, 2) ∂d_S/∂x and ∂d_S/∂y at the (n, 3) points, of the interpolation itself."""
        return np.asarray(self._evaluate(points)[:, 1:])

    def _evaluate(self, points: Array) -> Array:
        return np.asarray(_evaluate(self._levels, _contiguous(points)))

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
        return mean_clearance(self._levels, _contiguous(T_world_object), _contiguous(points))


def _spacing(sides: Array, cell_size: float, padding: float) -> tuple[int, float]:
    """Cells between two lines of a field over a volume of these sides, m between its levels."""
    step, rise = 1, _LEVEL
    while True:
        lines = (sides[:2] + 2.0 * padding) / (cell_size * step) + 4.0
        if lines.prod() * ((sides[2] + cell_size) / rise + 7.0) <= MAX_VALUES:
            return step, rise
        if rise < cell_size * step:
            rise *= 2.0
        else:
            step *= 2


def _contiguous(values: Array) -> Array:
    """Read-only, so that a kernel compiles once, whatever it is given."""
    view = np.ascontiguousarray(values, dtype=np.float64).view()
    view.setflags(write=False)
    return view


@kernel(nogil=True)
def _ends(boxes: ObstacleArrays, rows: npt.NDArray[np.int64]) -> Array:
    """(k,) z up to which each of the boxes counts: its top, or where a wall goes on above it."""
    lower, upper = boxes.lower, boxes.upper
    ends = np.empty(len(rows))
    for n in range(len(rows)):
        p = rows[n]
        ends[n] = upper[p, 2]
        i, j, k = boxes.cells[p, 0], boxes.cells[p, 1], boxes.cells[p, 2] + 1
        if k >= boxes.first_at.shape[2] or upper[p, 2] - lower[p, 2] < _UPRIGHT * boxes.cell_size:
            continue
        q = boxes.first_at[i, j, k]
        while q >= 0:
            apart = max(
                lower[q, 0] - upper[p, 0],
                lower[p, 0] - upper[q, 0],
                lower[q, 1] - upper[p, 1],
                lower[p, 1] - upper[q, 1],
                0.0,
            )
            if (
                apart <= _UPRIGHT * boxes.cell_size
                and lower[q, 2] - upper[p, 2] <= 0.5 * boxes.cell_size
            ):
                ends[n] = max(ends[n], lower[q, 2])
            q = boxes.next[q]
    return ends


@kernel(nogil=True)
def _clearance_levels(
    boxes: ObstacleArrays,
    outline: Field,
    ends: Array,
    nx: int,
    ny: int,
    nz: int,
    rise: float,
    cap: float,
) -> Field:
    """(nx, ny, nz) mean of the capped distance over `_AROUND` slabs below and above each level.

    Per slab between two levels, of the boxes that end in it, the one nearest in x and y to each
    grid point; then, per grid point and slab, the mean over its height of the least distance to
    these boxes of it and the slabs above.
    """
    flat = nx * ny
    nearest = np.empty((nx, ny), np.int32)
    first = np.full((nx, ny), -1, np.int32)
    following = np.full(len(ends), -1, np.int32)
    slab = np.empty(len(ends), np.int64)
    for r in range(len(ends)):
        slab[r] = min(max(math.floor((ends[r] - boxes.origin[2]) / rise), -1), nz - 1)
    order = np.argsort(slab, kind="mergesort")
    start = np.searchsorted(slab[order], np.arange(nz + 1))
    filled = np.flatnonzero(start[1:] > start[:-1])
    # squared distance in x and y to the nearest box of each slab, its height, and where it ends
    aside = np.full((len(filled), flat), np.inf, np.float32)
    height = np.zeros((len(filled), flat), np.float32)
    end = np.zeros((len(filled), flat), np.float32)
    for n in range(len(filled)):
        m = filled[n]
        rows = order[start[m] : start[m + 1]]
        _nearest_boxes(boxes, rows, cap, nearest)
        _chain(boxes, rows, first, following)
        for i in range(nx):
            for j in range(ny):
                r = nearest[i, j]
                if r >= 0:
                    at = i * ny + j
                    r, squared = _nearest_outline(boxes, outline, first, following, r, i, j)
                    aside[n, at] = squared
                    height[n, at] = boxes.lower[r, 2] - boxes.origin[2]
                    end[n, at] = ends[r] - boxes.origin[2] - m * rise
        for r in rows:
            i, j = boxes.cells[r, 0], boxes.cells[r, 1]
            if 0 <= i < nx and 0 <= j < ny:
                first[i, j] = -1
    means = np.empty((nz, flat), np.float32)  # over each slab
    over = np.empty(flat, np.float32)  # from its upper level, what ends below left out
    under = np.empty(flat, np.float32)  # from its lower level
    under[:] = np.float32(cap * cap)
    above = len(filled) - 1
    for m in range(nz - 1, -1, -1):
        over[:] = under
        if above >= 0 and filled[above] == m + 1:
            _lower_by_boxes(over, aside[above], height[above], np.float32((m + 1) * rise))
            above -= 1
        _squared_above(filled, aside, height, m, m * rise, cap, rise, under)
        for at in range(flat):
            means[m, at] = np.float32(0.5) * (np.sqrt(under[at]) + np.sqrt(over[at]))
    for n in range(len(filled)):
        _add_ending(aside[n], height[n], end[n], filled[n], rise, means[filled[n]])
    values = np.empty((flat, nz), np.float32)
    _mean_over_slabs(means, values)
    return values.reshape(nx, ny, nz)


@kernel(lean=True)
def _mean_over_slabs(means: Field, values: Field) -> None:
    """Of each level (n, nz), the mean of the `_AROUND` slabs (nz, n) below and above it."""
    nz, flat = means.shape
    for begin in range(0, flat, _BLOCK):  # as one is read along n, and the other written along z
        for m in range(nz):
            for at in range(begin, min(begin + _BLOCK, flat)):
                total = np.float32(0.0)
                for n in range(m - _AROUND, m + _AROUND):
                    total += means[min(max(n, 0), nz - 1), at]
                values[at, m] = total / np.float32(2 * _AROUND)


@kernel(lean=True)
def _chain(
    boxes: ObstacleArrays, rows: npt.NDArray[np.int64], first: Index, following: Index
) -> None:
    """Enter boxes into their columns of cells; those beyond the field are left out."""
    nx, ny = first.shape
    for r in rows:
        i, j = boxes.cells[r, 0], boxes.cells[r, 1]
        if 0 <= i < nx and 0 <= j < ny:
            following[r] = first[i, j]
            first[i, j] = r


@kernel(nogil=True)
def _squared_above(
    filled: npt.NDArray[np.int64],
    aside: Field,
    height: Field,
    slab: int,
    face: float,
    cap: float,
    rise: float,
    squared: Field,
) -> None:
    """(n,) the least squared distance from height `face` to the boxes that end above a slab."""
    squared[:] = np.float32(cap * cap)
    for n in range(len(filled)):
        if filled[n] > slab and filled[n] - slab <= cap / rise + _TALLEST / rise:
            _lower_by_boxes(squared, aside[n], height[n], np.float32(face))


@kernel(lean=True)
def _lower_by_boxes(squared: Field, aside: Field, height: Field, face: np.float32) -> None:
    """Lower (n,) squared distances by those to boxes that begin `height` above the origin."""
    for i in range(len(squared)):
        rise = max(height[i] - face, np.float32(0.0))
        candidate = aside[i] + rise * rise
        squared[i] = candidate if candidate < squared[i] else squared[i]


@kernel(lean=True)
def _add_ending(
    aside: Field, height: Field, end: Field, slab: int, rise: float, means: Field
) -> None:
    """Lower the means (n,) over a slab by the boxes that end in it, up to where they do."""
    for i in range(len(means)):
        if aside[i] < np.inf:
            share = min(end[i] / rise, 1.0)
            up = max(height[i] - slab * rise - 0.5 * end[i], 0.0)
            distance = math.sqrt(aside[i] + up * up)
            if distance < means[i]:
                means[i] = np.float32(share * distance + (1.0 - share) * means[i])


@kernel(lean=True)
def _aside(boxes: ObstacleArrays, outline: Field, r: int, i: int, j: int) -> float:
    """Squared distance in x and y from a grid point to the rectangle around the points of box r."""
    c, s = outline[r, 0], outline[r, 1]
    x, y = boxes.origin[0] + i * boxes.cell_size, boxes.origin[1] + j * boxes.cell_size
    u, v = c * x + s * y, c * y - s * x
    du = max(outline[r, 2] - u, 0.0, u - outline[r, 3])
    dv = max(outline[r, 4] - v, 0.0, v - outline[r, 5])
    return du * du + dv * dv


@kernel(lean=True)
def _nearest_outline(
    boxes: ObstacleArrays,
    outline: Field,
    first: Index,
    following: Index,
    r: int,
    i: int,
    j: int,
) -> tuple[int, float]:
    """From box r on to those in the cells around, as long as they are nearer to a grid point; with
    the squared distance.

    Args:
        first: (nx, ny) the first box in each column of cells, or -1.
        following: (k,) the next one in the same column, or -1.
    """
    nx, ny = first.shape
    least = _aside(boxes, outline, r, i, j)
    for _step in range(_STEPS):
        best = r
        for a in range(max(boxes.cells[r, 0] - 1, 0), min(boxes.cells[r, 0] + 2, nx)):
            for b in range(max(boxes.cells[r, 1] - 1, 0), min(boxes.cells[r, 1] + 2, ny)):
                q = first[a, b]
                while q >= 0:
                    squared = _aside(boxes, outline, q, i, j)
                    if squared < least:
                        best, least = q, squared
                    q = following[q]
        if best == r:
            break
        r = best
    return r, least


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
def _evaluate(levels: _Levels, points: Array) -> Array:
    """(n, 3) d_S, ∂d_S/∂x, ∂d_S/∂y."""
    result = np.empty((len(points), 3))
    for p in range(len(points)):
        d, gx, gy = _interpolate(levels, points[p, 0], points[p, 1], points[p, 2])
        result[p, 0], result[p, 1], result[p, 2] = d, gx, gy
    return result


@kernel(inline=True)
def _interpolate(levels: _Levels, x: float, y: float, z: float) -> tuple[float, float, float]:
    """d_S around a point, and its change along x and y: trilinear between levels and lines."""
    values, origin, size = levels.values, levels.origin, levels.size
    nx, ny, nz = values.shape
    w = max((z - origin[2]) / levels.rise, 0.0)
    if w >= nz - 1.0:
        return levels.cap, 0.0, 0.0
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
    gx = (far - near) / size if in_x else 0.0
    gy = ((b - a) * (1.0 - u) + (d - c) * u) / size if in_y else 0.0
    return near + (far - near) * u, gx, gy


@kernel()
def mean_clearance(levels: _Levels, T_world_object: Array, points: Array) -> tuple[Array, Array]:
    """(m,) mean of d_S over the (n, 3) points at each of the (m, 4, 4) poses; (m, 3) gradients.

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
        least = lowest + levels.lift
        total, along_x, along_y, turn = 0.0, 0.0, 0.0, 0.0
        for p in range(n):
            a, b, c = points[p, 0], points[p, 1], points[p, 2]
            rx = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c
            ry = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c
            rz = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c
            up = max(rz, least) + T[2, 3]
            d, gx, gy = _interpolate(levels, rx + T[0, 3], ry + T[1, 3], up)
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
