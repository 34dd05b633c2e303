"""Flying pixels, the noise of a cloud, and projecting noisy points onto their surfaces.

The plane of a neighbourhood comes from the first and second moments of the points in its 3×3×3
cells, summed cell by cell: the mean, and the eigenvector of the covariance's smallest eigenvalue.
Where surfaces meet and no single plane fits, points go to the nearest plane found beside them.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.binning import Bins
from placement_planner_ros.core.types import Array

Index = npt.NDArray[np.int32]

_SAMPLED_CELLS = 4000
"""Neighbourhoods looked at to estimate the noise."""
_MIN_PLANE_POINTS = 8
_MIN_SURFACE_POINTS = 20
"""Neighbourhoods with fewer points say nothing about the noise: sparse is not noisy, ..."""
_MIN_SURFACES = 0.2
"""... and at least this share of all must be such surfaces."""
_PLANE_SCATTER = 2.0
"""A neighbourhood is a plane if its points scatter by less than this times the noise."""
_MORE_SCATTER = 1.4
"""... nor by more than this times what points nearby do."""
_TRIMMED = 1.2
"""Points that scatter about their plane by more than this times the noise are not all of it: ..."""
_TRIMS = 3
"""... it is fitted anew so many times ..."""
_OTHER = 2.5
"""... without those further from it than this times the noise."""
_REACH = 5.0
"""Points further from every plane than this times the noise are not of it."""
_ASIDE = 2.25
"""Points of a cell that noise alone moves by more than this times the noise are few, ..."""
_MANY, _SHARE = 5, 0.1
"""... fewer than so many or than this share of the cell's, ..."""
_AGREE = 0.8
"""... or go different ways: their mean move is less than this share of `_ASIDE`."""


@kernel(nogil=True)
def connected_cells(
    bins: Bins, counts: npt.NDArray[np.int64], min_points: int
) -> npt.NDArray[np.bool_]:
    """(m,) False for cells in pieces of at most two cells with fewer than `min_points` points.

    A cell is in such a piece where it has no neighbour, or one that has no other.
    """
    cells, number_at = bins.cells, bins.number_at
    m = len(cells)
    nx, ny, nz = number_at.shape
    keep = np.ones(m, np.bool_)
    for r in range(m):
        if counts[r] >= min_points:
            continue
        neighbour = -1
        neighbours = 0
        for _pass in range(2):
            # first around the cell, then around its only neighbour
            center = r if _pass == 0 else neighbour
            for i in range(max(cells[center, 0] - 1, 0), min(cells[center, 0] + 2, nx)):
                for j in range(max(cells[center, 1] - 1, 0), min(cells[center, 1] + 2, ny)):
                    for k in range(max(cells[center, 2] - 1, 0), min(cells[center, 2] + 2, nz)):
                        other = number_at[i, j, k] - 1
                        if other >= 0 and other != r and other != neighbour:
                            neighbour = other if _pass == 0 else neighbour
                            neighbours += 1
            if neighbours != 1:
                break
        total = counts[r] + (counts[neighbour] if neighbour >= 0 else 0)
        keep[r] = neighbours > 1 or total >= min_points
    return keep


@kernel(nogil=True)
def cell_moments(bins: Bins, origin: Array, size: float) -> Array:
    """(m, 10) number, sum and second moments (xx, yy, zz, xy, xz, yz) about each cell's centre."""
    points, start, cells = bins.points, bins.start, bins.cells
    m = len(cells)
    moments = np.zeros((m, 10))
    for r in range(m):
        cx = origin[0] + (cells[r, 0] + 0.5) * size
        cy = origin[1] + (cells[r, 1] + 0.5) * size
        cz = origin[2] + (cells[r, 2] + 0.5) * size
        for p in range(start[r], start[r + 1]):
            x, y, z = points[p, 0] - cx, points[p, 1] - cy, points[p, 2] - cz
            moments[r, 0] += 1.0
            moments[r, 1] += x
            moments[r, 2] += y
            moments[r, 3] += z
            moments[r, 4] += x * x
            moments[r, 5] += y * y
            moments[r, 6] += z * z
            moments[r, 7] += x * y
            moments[r, 8] += x * z
            moments[r, 9] += y * z
    return moments


@kernel(lean=True)
def _moments_around(
    moments: Array, bins: Bins, size: float, r: int, reach: int
) -> tuple[float, float, float, float, float, float, float, float, float, float]:
    """Number, sum and second moments about the centre of cell r of the cells within `reach` of it.

    Moved by o, a cell's n points with sum s have the sum s + n o and the second moments
    Σ (x + o)(x + o)ᵀ = Σ x xᵀ + s oᵀ + o sᵀ + n o oᵀ.
    """
    cells, number_at = bins.cells, bins.number_at
    nx, ny, nz = number_at.shape
    n = sx = sy = sz = xx = yy = zz = xy = xz = yz = 0.0
    for i in range(max(cells[r, 0] - reach, 0), min(cells[r, 0] + reach + 1, nx)):
        ox = (i - cells[r, 0]) * size
        for j in range(max(cells[r, 1] - reach, 0), min(cells[r, 1] + reach + 1, ny)):
            oy = (j - cells[r, 1]) * size
            for k in range(max(cells[r, 2] - reach, 0), min(cells[r, 2] + reach + 1, nz)):
                q = number_at[i, j, k] - 1
                if q < 0:
                    continue
                oz = (k - cells[r, 2]) * size
                c, x, y, z = moments[q, 0], moments[q, 1], moments[q, 2], moments[q, 3]
                n += c
                sx += x + c * ox
                sy += y + c * oy
                sz += z + c * oz
                xx += moments[q, 4] + 2.0 * x * ox + c * ox * ox
                yy += moments[q, 5] + 2.0 * y * oy + c * oy * oy
                zz += moments[q, 6] + 2.0 * z * oz + c * oz * oz
                xy += moments[q, 7] + x * oy + y * ox + c * ox * oy
                xz += moments[q, 8] + x * oz + z * ox + c * ox * oz
                yz += moments[q, 9] + y * oz + z * oy + c * oy * oz
    return n, sx, sy, sz, xx, yy, zz, xy, xz, yz


@kernel(lean=True)
def plane_around(
    moments: Array, bins: Bins, size: float, r: int, reach: int, plane: Array
) -> float:
    """Fit cell r and those within `reach` cells of it; returns the number of points.

    `plane` (8,) is filled as by `_fit`, about the cell's centre.
    """
    return _fit_moments(_moments_around(moments, bins, size, r, reach), plane)


@kernel(lean=True)
def _fit_moments(
    moments: tuple[float, float, float, float, float, float, float, float, float, float],
    plane: Array,
) -> float:
    """The plane of points of that number, sum and second moments; returns the number.

    `plane` (8,) receives the mean, the unit normal, and the standard deviations along the normal
    and along the next axis. The normal is the eigenvector of the covariance's smallest eigenvalue;
    the eigenvalues of a symmetric C are in closed form mean + 2 s cos(φ + 2kπ/3) with
    mean = tr C / 3, s² = |C - mean I|² / 6 and cos 3φ = det((C - mean I) / s) / 2.
    """
    n, sx, sy, sz, xx, yy, zz, xy, xz, yz = moments
    sx, sy, sz = sx / n, sy / n, sz / n
    plane[0], plane[1], plane[2] = sx, sy, sz
    plane[3], plane[4], plane[5] = 0.0, 0.0, 0.0
    plane[6], plane[7] = 0.0, 0.0
    # C = [[a, d, e], [d, b, f], [e, f, c]]
    a, b, c = xx / n - sx * sx, yy / n - sy * sy, zz / n - sz * sz
    d, e, f = xy / n - sx * sy, xz / n - sx * sz, yz / n - sy * sz
    mean = (a + b + c) / 3.0
    spread = math.sqrt(
        ((a - mean) ** 2 + (b - mean) ** 2 + (c - mean) ** 2 + 2.0 * (d * d + e * e + f * f)) / 6.0
    )
    if spread <= 0.0:
        return n
    p, q, s = (a - mean) / spread, (b - mean) / spread, (c - mean) / spread
    d2, e2, f2 = d / spread, e / spread, f / spread
    half = 0.5 * (p * (q * s - f2 * f2) - d2 * (d2 * s - f2 * e2) + e2 * (d2 * f2 - q * e2))
    angle = math.acos(min(1.0, max(-1.0, half))) / 3.0
    largest = mean + 2.0 * spread * math.cos(angle)
    smallest = mean + 2.0 * spread * math.cos(angle + 2.0 * math.pi / 3.0)
    middle = 3.0 * mean - largest - smallest
    # The normal is orthogonal to every row of C less its smallest eigenvalue: the longest of the
    # rows' cross products.
    a, b, c = a - smallest, b - smallest, c - smallest
    ux, uy, uz = d * f - e * b, e * d - a * f, a * b - d * d
    vx, vy, vz = d * c - e * f, e * e - a * c, a * f - d * e
    wx, wy, wz = b * c - f * f, f * e - d * c, d * f - b * e
    u, v, w = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz
    if v > u and v >= w:
        ux, uy, uz, u = vx, vy, vz, v
    elif w > u:
        ux, uy, uz, u = wx, wy, wz, w
    if u > 0.0:
        u = math.sqrt(u)
        plane[3], plane[4], plane[5] = ux / u, uy / u, uz / u
    plane[6] = math.sqrt(max(smallest, 0.0))
    plane[7] = math.sqrt(max(middle, 0.0))
    return n


@kernel(nogil=True)
def _plane_scatter(
    moments: Array,
    bins: Bins,
    size: float,
    reach: int,
    stride: int,
    min_points: int,
) -> Array:
    """Standard deviations about the planes of those sampled neighbourhoods that are surfaces."""
    found = np.empty(len(bins.cells) // stride + 1)
    plane = np.empty(8)
    n = 0
    for r in range(0, len(bins.cells), stride):
        if plane_around(moments, bins, size, r, reach, plane) < min_points:
            continue
        if plane[7] > 0.15 * (1 + reach) * size and plane[6] < 0.6 * plane[7]:
            found[n] = plane[6]
            n += 1
    return found[:n]


def estimate_noise(bins: Bins, origin: Array, size: float) -> float:
    """Standard deviation of the points about their surfaces, metres; 0 where they are too few.

    The median over neighbourhoods that look like surfaces. Two checks keep curved and thin things
    from passing for noise: where a quarter of the single cells with enough points are flat, or a
    quarter of the neighbourhoods (to a tenth of the median), it is that quarter that counts.
    """
    stride = max(1, len(bins.cells) // _SAMPLED_CELLS)
    moments = cell_moments(bins, origin, size)
    around = _plane_scatter(moments, bins, size, 1, stride, _MIN_SURFACE_POINTS)
    if len(around) < _MIN_SURFACES * len(bins.cells) / stride:
        return 0.0
    noise = _typical_scatter(around)
    alone = _plane_scatter(moments, bins, size, 0, stride, _MIN_PLANE_POINTS)
    if len(alone) >= 0.25 * len(around):
        within = float(np.quantile(alone, 0.25))
        if within < 0.1 * float(np.median(around)):
            noise = within
    return noise


def _typical_scatter(scatter: Array) -> float:
    """Median, or the first quartile where that is less than a tenth of it; 0 of nothing."""
    if len(scatter) == 0:
        return 0.0
    quartile, median = np.quantile(scatter, (0.25, 0.5))
    return float(quartile if quartile < 0.1 * median else median)


@kernel(lean=True)
def _trim_plane(bins: Bins, r: int, center: Array, reach: float, plane: Array) -> float:
    """Fit `plane` (8,) anew to those points around cell r that are within `reach` of it.

    Args:
        center: (3,) of cell r, about which the plane is.

    Returns:
        Their number; the plane stays as it is where they are few.
    """
    points, start, cells, number_at = bins.points, bins.start, bins.cells, bins.number_at
    nx, ny, nz = number_at.shape
    n = sx = sy = sz = xx = yy = zz = xy = xz = yz = 0.0
    for i in range(max(cells[r, 0] - 1, 0), min(cells[r, 0] + 2, nx)):
        for j in range(max(cells[r, 1] - 1, 0), min(cells[r, 1] + 2, ny)):
            for k in range(max(cells[r, 2] - 1, 0), min(cells[r, 2] + 2, nz)):
                q = number_at[i, j, k] - 1
                if q < 0:
                    continue
                for p in range(start[q], start[q + 1]):
                    x, y, z = points[p, 0] - center[0], points[p, 1] - center[1], points[p, 2]
                    z -= center[2]
                    off = (
                        plane[3] * (x - plane[0])
                        + plane[4] * (y - plane[1])
                        + plane[5] * (z - plane[2])
                    )
                    if abs(off) > reach:
                        continue
                    n += 1.0
                    sx += x
                    sy += y
                    sz += z
                    xx += x * x
                    yy += y * y
                    zz += z * z
                    xy += x * y
                    xz += x * z
                    yz += y * z
    if n < _MIN_PLANE_POINTS:
        return n
    return _fit_moments((n, sx, sy, sz, xx, yy, zz, xy, xz, yz), plane)


@kernel(nogil=True)
def _fit_planes(
    moments: Array, bins: Bins, size: float, origin: Array, noise: float
) -> tuple[Array, npt.NDArray[np.bool_]]:
    """(m, 6) mean and normal of each cell's neighbourhood; (m,) whether it is a plane.

    It is not where the points scatter more than they do two cells further: across a corner too, a
    plane fits to within a few times the noise. Where they scatter more than noise does, some are of
    another surface, as at the foot of a wall, and would turn the plane towards it: it is fitted
    anew without the farthest.
    """
    cells, number_at = bins.cells, bins.number_at
    m = len(cells)
    nx, ny, nz = number_at.shape
    planes = np.empty((m, 6))
    scatter = np.full(m, np.inf)
    plane, center = np.empty(8), np.empty(3)
    for r in range(m):
        n = plane_around(moments, bins, size, r, 1, plane)
        for a in range(3):
            center[a] = origin[a] + (cells[r, a] + 0.5) * size
        if n >= _MIN_PLANE_POINTS and _TRIMMED * noise < plane[6] <= _PLANE_SCATTER * noise:
            for _ in range(_TRIMS):
                _trim_plane(bins, r, center, _OTHER * noise, plane)
        for a in range(3):
            planes[r, a] = plane[a] + center[a]
            planes[r, 3 + a] = plane[3 + a]
        if (
            n >= _MIN_PLANE_POINTS
            and plane[6] <= _PLANE_SCATTER * noise
            and plane[7] > 0.3 * size
            and plane[6] < 0.6 * plane[7]
        ):
            scatter[r] = plane[6]
    # Compare with what lies two cells further.
    flat = np.zeros(m, np.bool_)
    for r in range(m):
        if scatter[r] == np.inf:
            continue
        least = scatter[r]
        for i in range(cells[r, 0] - 2, cells[r, 0] + 3, 2):
            for j in range(cells[r, 1] - 2, cells[r, 1] + 3, 2):
                for k in range(cells[r, 2] - 2, cells[r, 2] + 3, 2):
                    if 0 <= i < nx and 0 <= j < ny and 0 <= k < nz and number_at[i, j, k] > 0:
                        least = min(least, scatter[number_at[i, j, k] - 1])
        flat[r] = scatter[r] <= max(_MORE_SCATTER * least, 0.5 * noise)
    return planes, flat


@kernel(lean=True)
def plane_residual(planes: Array, q: int, x: float, y: float, z: float) -> float:
    """Distance of a point beyond plane q, metres."""
    return (
        planes[q, 3] * (x - planes[q, 0])
        + planes[q, 4] * (y - planes[q, 1])
        + planes[q, 5] * (z - planes[q, 2])
    )


@kernel(lean=True)
def _nearer_plane(
    planes: Array,
    candidates: npt.NDArray[np.int64],
    first: int,
    last: int,
    x: float,
    y: float,
    z: float,
    best: int,
    distance: float,
) -> tuple[int, float]:
    """The nearest plane among candidates[first:last] where nearer than `best`, and its distance."""
    for c in range(first, last):
        d = plane_residual(planes, candidates[c], x, y, z)
        if abs(d) < abs(distance):
            best = candidates[c]
            distance = d
    return best, distance


@kernel(lean=True)
def gather_planes(
    bins: Bins,
    flat: npt.NDArray[np.bool_],
    r: int,
    ring: int,
    candidates: npt.NDArray[np.int64],
    count: int,
) -> int:
    """Append the plane cells at Chebyshev distance `ring` of cell r; returns the new count."""
    cells, number_at = bins.cells, bins.number_at
    nx, ny, nz = number_at.shape
    for i in range(-ring, ring + 1):
        for j in range(-ring, ring + 1):
            step = 1 if abs(i) == ring or abs(j) == ring else 2 * ring
            for k in range(-ring, ring + 1, step):
                x, y, z = cells[r, 0] + i, cells[r, 1] + j, cells[r, 2] + k
                if 0 <= x < nx and 0 <= y < ny and 0 <= z < nz:
                    q = number_at[x, y, z] - 1
                    if q >= 0 and flat[q]:
                        candidates[count] = q
                        count += 1
    return count


@kernel(nogil=True)
def _project_points(
    bins: Bins,
    planes: Array,
    flat: npt.NDArray[np.bool_],
    reach: float,
    lower: Array,
    upper: Array,
) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Project each point onto its cell's plane, else the nearest plane within two cells.

    Points are kept within lower..upper; (n,) says which lie on a plane. Those of a cell that
    are many, far off and go the same way stay: they are of something that stands out of the plane.
    """
    points, start = bins.points, bins.start
    moved = points.copy()
    explained = np.zeros(len(points), np.bool_)
    candidates = np.empty(125, np.int64)
    for r in range(len(bins.cells)):
        near = far = -1  # candidates are gathered when the first point asks for them
        for p in range(start[r], start[r + 1]):
            x, y, z = points[p, 0], points[p, 1], points[p, 2]
            # its own cell's plane, ...
            best = -1
            distance = reach
            if flat[r]:
                d = plane_residual(planes, r, x, y, z)
                if abs(d) <= reach:
                    best = r
                    distance = d
            # ... or the nearest beside it, ...
            if near < 0 and (best < 0 or abs(distance) > 0.4 * reach):
                near = gather_planes(bins, flat, r, 1, candidates, 0)
            if best < 0:
                best, distance = _nearer_plane(planes, candidates, 0, near, x, y, z, best, distance)
            # ... or, where none is close, one cell further
            if best < 0 or abs(distance) > 0.4 * reach:
                if far < 0:
                    far = gather_planes(bins, flat, r, 2, candidates, near)
                best, distance = _nearer_plane(
                    planes, candidates, near, far, x, y, z, best, distance
                )
            if best >= 0:
                explained[p] = True
                for a in range(3):
                    value = moved[p, a] - distance * planes[best, 3 + a]
                    moved[p, a] = min(max(value, lower[a]), upper[a])
        _put_back(points, moved, start[r], start[r + 1], reach / _REACH)
    return moved, explained


@kernel(lean=True)
def _far_move(points: Array, moved: Array, p: int, far: float) -> bool:
    """Whether a point was moved by more than √far, metres."""
    squared = 0.0
    for a in range(3):
        squared += (moved[p, a] - points[p, a]) ** 2
    return squared > far


@kernel(lean=True)
def _put_back(points: Array, moved: Array, first: int, last: int, noise: float) -> None:
    """Undo the far moves of points[first:last] where noise cannot be the reason for them."""
    far = (_ASIDE * noise) ** 2
    n = 0
    x = y = z = 0.0
    for p in range(first, last):
        if _far_move(points, moved, p, far):
            n += 1
            x += moved[p, 0] - points[p, 0]
            y += moved[p, 1] - points[p, 1]
            z += moved[p, 2] - points[p, 2]
    agree = x * x + y * y + z * z >= far * (_AGREE * n) ** 2
    if n < _MANY or n < _SHARE * (last - first) or not agree:
        return
    for p in range(first, last):
        if _far_move(points, moved, p, far):
            for a in range(3):
                moved[p, a] = points[p, a]


@kernel(nogil=True)
def stray_points(
    bins: Bins,
    explained: npt.NDArray[np.bool_],
    min_points: int,
) -> npt.NDArray[np.bool_]:
    """Points of no plane, with fewer than `min_points` such points in the cells around."""
    start, cells, number_at = bins.start, bins.cells, bins.number_at
    m = len(cells)
    nx, ny, nz = number_at.shape
    left = np.zeros(m, np.int64)
    for r in range(m):
        for p in range(start[r], start[r + 1]):
            if not explained[p]:
                left[r] += 1
    stray = np.zeros(len(explained), np.bool_)
    for r in range(m):
        if left[r] == 0 or left[r] >= min_points:
            continue
        total = 0
        for i in range(max(cells[r, 0] - 1, 0), min(cells[r, 0] + 2, nx)):
            for j in range(max(cells[r, 1] - 1, 0), min(cells[r, 1] + 2, ny)):
                for k in range(max(cells[r, 2] - 1, 0), min(cells[r, 2] + 2, nz)):
                    q = number_at[i, j, k] - 1
                    if q >= 0:
                        total += left[q]
        if total < min_points:
            for p in range(start[r], start[r + 1]):
                stray[p] = not explained[p]
    return stray


def project_points(
    bins: Bins,
    origin: Array,
    size: float,
    noise: float,
    min_points: int,
    lower: Array,
    upper: Array,
) -> Array:
    """Points of a noisy cloud, projected onto their surfaces and kept within lower..upper.

    Returns:
        (n, 3), NaN for lone points off every surface. Points of no plane (thin or strongly curved
        things) stay where they are.
    """
    moments = cell_moments(bins, origin, size)
    planes, flat = _fit_planes(moments, bins, size, origin, noise)
    moved, explained = _project_points(bins, planes, flat, _REACH * noise, lower, upper)
    moved[stray_points(bins, explained, min_points)] = np.nan
    return moved
