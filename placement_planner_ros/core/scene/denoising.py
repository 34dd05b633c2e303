"""The noise of a cloud, lone points, and noisy points projected onto their surfaces.

The plane of a neighbourhood comes from the first and second moments of the points in its 3×3×3
cells, summed cell by cell: the mean, and the eigenvector of the covariance's smallest eigenvalue.
Where surfaces meet and no single plane fits, points go to the nearest plane found beside them.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from placement_planner_ros.core import stopping
from placement_planner_ros.core.boxes import within
from placement_planner_ros.core.scene.cells import Bins
from placement_planner_ros.core.scene.cloud import SAMPLES
from placement_planner_ros.core.types import Array, Index, Mask
from placement_planner_ros.core.uncounted import Uncounted

Moments = tuple[float, float, float, float, float, float, float, float, float, float]

PLANE_POINTS, SURFACE_POINTS = 8, 20
"""Points that a plane needs; that a neighbourhood needs to show noise: sparse is not noisy, ..."""
SURFACE_SHARE = 0.2
"""... and at least this share of all must be such surfaces."""
UNEVEN_NOISES, UNEVEN = 1.2, 1.4
"""Standard deviations, and times what others nearby scatter by, from which on a neighbourhood is
not all of one plane."""
OUTLIER_NOISES = 2.5
"""Standard deviations beyond which a point is perhaps of another plane, and twice that surely."""
OUTLIER_SHARE, OUTLIERS_AGREE = 0.1, 0.8
"""Share of a cell's points that are outliers by chance, and of their moves that then is common."""


def lone_cells(bins: Bins, counts: Index, min_points: int) -> Mask:
    """(m,) cells that hold some, but with the 26 around fewer than `min_points`, of the points
    counted (m,)."""
    rows = np.flatnonzero((counts > 0) & (counts < min_points))
    total, of_number = np.zeros(len(rows), np.int64), np.append(0, counts)
    for step in np.ndindex(3, 3, 3):
        # where there is a cell that way, what it holds
        cells = bins.cells[rows] + np.array(step) - 1
        there = within(cells, (0, 0, 0), np.subtract(bins.number_at.shape, 1))
        total[there] += of_number[bins.number_at[tuple(cells[there].T)]]
        rows, total = (each[total < min_points] for each in (rows, total))
    lone = np.zeros(len(counts), np.bool_)
    lone[rows] = True
    return lone


@njit(cache=True, nogil=True)
def _cell_moments(bins: Bins, middle: Array) -> Array:
    """(m, 10) number, sum and second moments (xx, yy, zz, xy, xz, yz) of each cell's points, all
    about one point (3,): that they need not be moved weighs more than what rounding takes."""
    points, start = bins.points, bins.start
    moments = np.zeros((len(bins.cells), 10))
    for r in range(len(moments)):
        for p in range(start[r], start[r + 1]):
            x, y, z = points[p, 0] - middle[0], points[p, 1] - middle[1], points[p, 2] - middle[2]
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


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _moments_around(moments: Array, bins: Bins, r: int, reach: int) -> Moments:
    """Number, sum and second moments of the cells within `reach` of cell r."""
    cells, number_at = bins.cells, bins.number_at
    nx, ny, nz = number_at.shape
    n = sx = sy = sz = xx = yy = zz = xy = xz = yz = 0.0
    for i in range(max(cells[r, 0] - reach, 0), min(cells[r, 0] + reach + 1, nx)):
        for j in range(max(cells[r, 1] - reach, 0), min(cells[r, 1] + reach + 1, ny)):
            for k in range(max(cells[r, 2] - reach, 0), min(cells[r, 2] + reach + 1, nz)):
                q = number_at[i, j, k] - 1
                if q < 0:
                    continue
                n += moments[q, 0]
                sx += moments[q, 1]
                sy += moments[q, 2]
                sz += moments[q, 3]
                xx += moments[q, 4]
                yy += moments[q, 5]
                zz += moments[q, 6]
                xy += moments[q, 7]
                xz += moments[q, 8]
                yz += moments[q, 9]
    return n, sx, sy, sz, xx, yy, zz, xy, xz, yz


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _moments_near_plane(bins: Bins, r: int, middle: Array, reach: float, plane: Array) -> Moments:
    """`_moments_around` of those points only that are within `reach` of a plane, about the same
    point (3,)."""
    points, start, cells, number_at = bins.points, bins.start, bins.cells, bins.number_at
    nx, ny, nz = number_at.shape
    n = sx = sy = sz = xx = yy = zz = xy = xz = yz = 0.0
    for i in range(max(cells[r, 0] - 1, 0), min(cells[r, 0] + 2, nx)):
        for j in range(max(cells[r, 1] - 1, 0), min(cells[r, 1] + 2, ny)):
            for k in range(max(cells[r, 2] - 1, 0), min(cells[r, 2] + 2, nz)):
                q = number_at[i, j, k] - 1
                if q < 0:
                    continue
                # of each cell those points that are near the plane
                for p in range(start[q], start[q + 1]):
                    x, y, z = points[p, 0] - middle[0], points[p, 1] - middle[1], points[p, 2]
                    z -= middle[2]
                    if abs(plane[0] * x + plane[1] * y + plane[2] * z - plane[3]) > reach:
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
    return n, sx, sy, sz, xx, yy, zz, xy, xz, yz


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _fit_plane(moments: Moments, plane: Array) -> float:
    """The plane of points of that number, sum and second moments; returns the number.

    `plane` (6,) receives the unit normal, how far it is along this, and the standard deviations
    along the normal and along the next axis. The normal is the eigenvector of the covariance's
    smallest eigenvalue; the eigenvalues of a symmetric C are in closed form
    mean + 2 s cos(φ + 2kπ/3) with mean = tr C / 3, s² = |C - mean I|² / 6 and
    cos 3φ = det((C - mean I) / s) / 2.
    """
    n, sx, sy, sz, xx, yy, zz, xy, xz, yz = moments
    sx, sy, sz = sx / n, sy / n, sz / n
    plane[:] = 0.0
    # the covariance C = [[a, d, e], [d, b, f], [e, f, c]]
    a, b, c = xx / n - sx * sx, yy / n - sy * sy, zz / n - sz * sz
    d, e, f = xy / n - sx * sy, xz / n - sx * sz, yz / n - sy * sz
    mean = (a + b + c) / 3.0
    spread = math.sqrt(
        ((a - mean) ** 2 + (b - mean) ** 2 + (c - mean) ** 2 + 2.0 * (d * d + e * e + f * f)) / 6.0
    )
    if spread <= 0.0:
        return n
    # its eigenvalues in closed form
    p, q, s = (a - mean) / spread, (b - mean) / spread, (c - mean) / spread
    d2, e2, f2 = d / spread, e / spread, f / spread
    half = 0.5 * (p * (q * s - f2 * f2) - d2 * (d2 * s - f2 * e2) + e2 * (d2 * f2 - q * e2))
    angle = math.acos(min(1.0, max(-1.0, half))) / 3.0
    largest = mean + 2.0 * spread * math.cos(angle)
    smallest = mean + 2.0 * spread * math.cos(angle + 2.0 * math.pi / 3.0)
    middle = 3.0 * mean - largest - smallest
    # the normal is orthogonal to every row of C less its smallest eigenvalue: the longest of the
    # rows' cross products
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
        plane[0], plane[1], plane[2] = ux / u, uy / u, uz / u
        plane[3] = (ux * sx + uy * sy + uz * sz) / u
    plane[4] = math.sqrt(max(smallest, 0.0))
    plane[5] = math.sqrt(max(middle, 0.0))
    return n


@njit(cache=True, nogil=True)
def _plane_scatter(
    moments: Array, bins: Bins, size: float, reach: int, stride: int, min_points: int
) -> Array:
    """Standard deviations about the planes of those sampled neighbourhoods that are surfaces."""
    found = np.empty(len(bins.cells) // stride + 1)
    plane = np.empty(6)
    n = 0
    for r in range(0, len(bins.cells), stride):
        if _fit_plane(_moments_around(moments, bins, r, reach), plane) < min_points:
            continue
        # wide along two axes, and thin along the third
        if plane[5] > 0.15 * (1 + reach) * size and plane[4] < 0.6 * plane[5]:
            found[n] = plane[4]
            n += 1
    return found[:n]


def without_noise(
    bins: Bins,
    origin: Array,
    size: float,
    floor: float,
    min_points: int,
    bounds: tuple[Array, Array],
) -> tuple[Array | None, float]:
    """Points without lone ones, those of a noisy cloud projected onto their surfaces.

    Args:
        floor: m, the noise up to which points stay as they are.
        min_points: where a cell and the 26 around it hold fewer, these are lone; no point counts as
            lone in a sparse cloud.
        bounds: corners within which points stay.

    Returns:
        (n, 3), NaN for what goes; None where all stay as they are. And the noise, metres; 0 where
        there is no more than the floor.
    """
    counts = np.diff(bins.start)
    fewest = min_points if np.median(counts) >= 4 else 0
    middle = origin + 0.5 * size * np.array(bins.number_at.shape)
    moments = _cell_moments(bins, middle)
    noise = _estimate_noise(bins, moments, size)
    if noise > floor:
        stopping.step("laying points on their surfaces")
        planes = _fit_planes(moments, bins, size, middle, noise)
        bins = bins._replace(points=_on_surfaces(bins, planes, noise, 0, bounds))
        stopping.step("laying points on surfaces that are sharper now")
        planes = _fit_planes(_cell_moments(bins, middle), bins, size, middle, noise)
        return _on_surfaces(bins, planes, noise, fewest, bounds), noise
    lone = lone_cells(bins, counts, fewest)
    return (bins.points[np.repeat(~lone, counts)] if lone.any() else None), 0.0


def _estimate_noise(bins: Bins, moments: Array, size: float) -> float:
    """Standard deviation of the points about their surfaces, metres; 0 where they are too few.

    The median over neighbourhoods that look like surfaces. Two checks keep curved and thin things
    from passing for noise: where a quarter of the single cells with enough points are flat, or a
    quarter of the neighbourhoods (to a tenth of the median), it is that quarter that counts.
    """
    stride = max(1, len(bins.cells) // (2 * SAMPLES))
    around = _plane_scatter(moments, bins, size, 1, stride, SURFACE_POINTS)
    if not len(around) or len(around) < SURFACE_SHARE * len(bins.cells) / stride:
        return 0.0
    quartile, median = np.quantile(around, (0.25, 0.5))
    alone = _plane_scatter(moments, bins, size, 0, stride, PLANE_POINTS)
    if len(alone) >= 0.25 * len(around):
        within = float(np.quantile(alone, 0.25))
        if within < 0.1 * median:
            return within
    return float(quartile if quartile < 0.1 * median else median)


def _on_surfaces(
    bins: Bins,
    planes: tuple[Array, Mask],
    noise: float,
    min_points: int,
    bounds: tuple[Array, Array],
) -> Array:
    """Points of a noisy cloud, projected onto their surfaces and kept within the bounds.

    Args:
        planes: `_fit_planes` of the cells.

    Returns:
        (n, 3), NaN for lone points off every surface. Points of no plane (thin or strongly curved
        things) stay where they are.
    """
    moved, off = _project_points(bins, *planes, noise, *bounds)
    # points off every plane, and cells with too few of them around
    unexplained = np.isnan(off)
    counts = np.add.reduceat(unexplained, bins.start[:-1], dtype=np.int64)
    lone = np.repeat(lone_cells(bins, counts, min_points), np.diff(bins.start))
    moved[lone & unexplained] = np.nan
    return np.asarray(moved)


@njit(cache=True, nogil=True)
def _fit_planes(
    moments: Array, bins: Bins, size: float, middle: Array, noise: float
) -> tuple[Array, Mask]:
    """(m, 4) normal of each cell's neighbourhood and how far along it that is; (m,) whether it is a
    plane.

    It is not where the points scatter more than they do two cells further: across a corner too, a
    plane fits to within a few times the noise. Where they scatter more than noise does, some are of
    another surface, as at the foot of a wall, and would turn the plane towards it: it is fitted
    anew without the farthest.
    """
    cells, number_at = bins.cells, bins.number_at
    m = len(cells)
    nx, ny, nz = number_at.shape
    planes = np.empty((m, 4))
    scatter = np.full(m, np.inf)
    plane = np.empty(6)
    for r in range(m):
        n = _fit_plane(_moments_around(moments, bins, r, 1), plane)
        # points of one plane scatter by twice the noise at most
        fits = n >= PLANE_POINTS and plane[4] <= 2.0 * noise
        # three times anew without outliers, as long as enough are left
        for _ in range(3):
            if fits and plane[4] > UNEVEN_NOISES * noise:
                own = _moments_near_plane(bins, r, middle, OUTLIER_NOISES * noise, plane)
                if own[0] >= PLANE_POINTS:
                    _fit_plane(own, plane)
        # told from the world's origin
        for a in range(4):
            planes[r, a] = plane[a]
        for a in range(3):
            planes[r, 3] += plane[a] * middle[a]
        # its scatter counts where it is wide and thin
        if fits and plane[5] > 0.3 * size and plane[4] < 0.6 * plane[5]:
            scatter[r] = plane[4]
    # compare with what lies two cells further
    flat = np.zeros(m, np.bool_)
    for r in range(m):
        least = scatter[r]
        if least == np.inf:
            continue
        for i in range(cells[r, 0] - 2, cells[r, 0] + 3, 2):
            for j in range(cells[r, 1] - 2, cells[r, 1] + 3, 2):
                for k in range(cells[r, 2] - 2, cells[r, 2] + 3, 2):
                    if 0 <= i < nx and 0 <= j < ny and 0 <= k < nz and number_at[i, j, k] > 0:
                        least = min(least, scatter[number_at[i, j, k] - 1])
        flat[r] = scatter[r] <= max(UNEVEN * least, 0.5 * noise)
    return planes, flat


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _gather_planes(bins: Bins, flat: Mask, r: int, ring: int, candidates: Index, count: int) -> int:
    """Append the plane cells at Chebyshev distance `ring` of cell r; returns the new count."""
    cells, number_at = bins.cells, bins.number_at
    nx, ny, nz = number_at.shape
    for i in range(-ring, ring + 1):
        for j in range(-ring, ring + 1):
            # of inner columns only both ends are on the ring
            step = 1 if max(abs(i), abs(j)) == ring else 2 * ring
            for k in range(-ring, ring + 1, step):
                x, y, z = cells[r, 0] + i, cells[r, 1] + j, cells[r, 2] + k
                if 0 <= x < nx and 0 <= y < ny and 0 <= z < nz:
                    q = number_at[x, y, z] - 1
                    if q >= 0 and flat[q]:
                        candidates[count] = q
                        count += 1
    return count


@njit(cache=True, nogil=True)
def _project_points(
    bins: Bins, planes: Array, flat: Mask, noise: float, lower: Array, upper: Array
) -> tuple[Array, Array]:
    """Project each point onto its cell's plane, else the nearest plane within two cells.

    Points are kept within lower..upper. Those of a cell that are many, far off and go the same way
    stay: they are of something that stands out of the plane.

    Returns:
        (n, 3), and (n,) how far each was off its plane, metres; NaN where there is none.
    """
    points, start = bins.points, bins.start
    moved, off = points.copy(), np.full(len(points), np.nan)
    candidates, ends = np.empty(125, np.int64), np.empty(4, np.int64)
    far = OUTLIER_NOISES * noise
    for r in range(len(bins.cells)):
        gathered = ends[0] = 0  # rings of planes, when the first point asks for them
        outliers, x, y, z = 0, 0.0, 0.0, 0.0
        for p in range(start[r], start[r + 1]):
            best, distance = -1, 2.0 * far
            # its own cell's plane, or one beside it, or else one cell further
            for ring in range(3):
                if best >= 0 and abs(distance) <= 0.8 * far:
                    break
                if gathered == ring:
                    ends[ring + 1] = _gather_planes(bins, flat, r, ring, candidates, ends[ring])
                    gathered += 1
                # the nearest plane of this ring
                for c in range(ends[ring], ends[ring + 1]):
                    q = candidates[c]
                    d = -planes[q, 3]
                    for a in range(3):
                        d += planes[q, a] * points[p, a]
                    if abs(d) < abs(distance):
                        best, distance = q, d
            if best < 0:
                continue
            off[p] = distance
            # onto that plane, within the bounds
            for a in range(3):
                value = moved[p, a] - distance * planes[best, a]
                moved[p, a] = min(max(value, lower[a]), upper[a])
            # how many move far, and where to all together
            if abs(distance) > far:
                outliers += 1
                x -= distance * planes[best, 0]
                y -= distance * planes[best, 1]
                z -= distance * planes[best, 2]
        # what noise cannot have moved goes back
        common = math.sqrt(x * x + y * y + z * z) >= OUTLIERS_AGREE * far * outliers
        many = outliers >= max(3.0, OUTLIER_SHARE * (start[r + 1] - start[r]))
        if common and many:
            for p in range(start[r], start[r + 1]):
                if abs(off[p]) > far:
                    for a in range(3):
                        moved[p, a] = points[p, a]
    return moved, off
