"""Noisy clouds of which 27 cells hold few points: thinned by a voxel filter, or drawn at random.

Their planes take the points of 125 cells, over which noise and low relief look alike: what is left
of ribs of 3 mm about a plane is as much as 1 mm of noise leaves. So a neighbourhood counts as a
plane only where what is left is noise in every respect that can be told: no more than around, no
more alike between neighbours, in one direction or in all, no more on top than below, and nowhere
heaped. Nothing stands where that is not so, nor where what is low could hide in the noise.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.binning import Bins
from placement_planner_ros.core.scene.curved import scatter_about_curved
from placement_planner_ros.core.scene.denoising import (
    cell_moments,
    gather,
    plane_around,
    residual,
    strays,
)
from placement_planner_ros.core.types import Array

Cells = npt.NDArray[np.int32]
Mask = npt.NDArray[np.bool_]

_REACH = 2
"""Cells to each side of one, whose points tell its plane."""
_FEWEST, _MOST = 16, 256
"""Points of the smallest neighbourhood, and how many of the largest are looked at."""
_WIDE = 0.3
"""Cells, the standard deviation of a surface's points across its narrower side, at least ..."""
_FLAT = 0.6
"""... and times that, along its normal, at most."""
_SURFACES = 0.2
"""Share of the neighbourhoods that must be surfaces, to say anything."""
_PLANES = 0.1
"""... and of planes among them."""
_LEAST = 0.0002
"""m: less noise costs fewer poses as it is than what is in doubt around things would."""
_CURVED = 0.5
"""What curved surfaces leave less of than so many times the noise is curved, not noisy."""
_NEIGHBOUR = 1.5
"""Points no further apart than so many of their spacings are neighbours, ..."""
_TURNS = 4
"""... in one of so many directions over half a turn."""
_AROUND, _LAYERS = 5, 2
"""Cells around one, beside and above, whose neighbourhoods are held against its own, ..."""
_PARALLEL = 0.95
"""... if the cosine between their normals is at least this, ..."""
_ENOUGH, _PAIRS = 9, 40.0
"""... and there are so many of them, and pairs in a direction."""
_QUIET, _QUIET_BY = 0.2, 0.84
"""The noise is that quantile of what is left around, which lies so many standard deviations below
the middle."""
_MORE = 2.2
"""Standard deviations by which more may be left, ..."""
_ALIKE, _ALIKE_ALONG = 0.3, 0.22
"""... correlation of neighbours in one neighbourhood, and in one direction of all around, ..."""
_SKEWED = 0.5
"""... mean skewness of these, upwards, ..."""
_HEAPED = 3.2
"""... and times the noise that three points or more within a disc are off by, over their root."""
_DISC = 1.2
"""Cells, the radius of that disc: a coin's."""
_LOW = 0.0017
"""m: what rises by that over such a disc must show, or nothing is smoothed."""
_OWN, _BESIDE = 4.0, 2.2
"""Times the noise that points are off their cell's plane, or else off one beside, and of it."""
_RELIEF = 0.01
"""m: what rises no more than that above a plane beside it leaves all around in doubt."""
_LEVEL = 0.9
"""z of such a plane's normal, at least."""


@kernel(nogil=True)
def _look(bins: Bins, moments: Array, origin: Array, size: float) -> tuple[Array, Array, Array]:
    """What is left of the points of each cell's neighbourhood about their plane.

    Returns:
        (m, 6) mean and normal of the plane. (m, 5) number of points; standard deviation about it,
        infinite where it is no surface; correlation of neighbours; skewness; the largest sum over
        a disc, over the root of how many. (m, turns, 2) sum of the correlations of each cell's own
        points with their neighbours, by direction, and how many.
    """
    points, start, cells, number_at = bins.points, bins.start, bins.cells, bins.number_at
    m = len(cells)
    nx, ny, nz = number_at.shape
    planes, told, sums = np.zeros((m, 6)), np.full((m, 5), np.inf), np.zeros((m, _TURNS, 2))
    plane, center = np.empty(8), np.empty(3)
    x, y, z, own = np.empty(_MOST), np.empty(_MOST), np.empty(_MOST), np.empty(_MOST, np.bool_)
    heap, many = np.empty(_MOST), np.empty(_MOST)
    disc = (_DISC * size) ** 2
    for r in range(m):
        told[r, 0] = plane_around(moments, bins, size, r, _REACH, plane)
        for a in range(3):
            center[a] = origin[a] + (cells[r, a] + 0.5) * size + plane[a]
            planes[r, a], planes[r, 3 + a] = center[a], plane[3 + a]
        narrow = plane[7] <= _WIDE * size or plane[6] >= _FLAT * plane[7]
        if told[r, 0] < _FEWEST or narrow:
            continue
        # axes across, the same for all surfaces that lie alike
        a_, b_, c_ = plane[3], plane[4], plane[5]
        if abs(a_) <= abs(b_) and abs(a_) <= abs(c_):
            ux, uy, uz = 1.0 - a_ * a_, -a_ * b_, -a_ * c_
        elif abs(b_) <= abs(c_):
            ux, uy, uz = -b_ * a_, 1.0 - b_ * b_, -b_ * c_
        else:
            ux, uy, uz = -c_ * a_, -c_ * b_, 1.0 - c_ * c_
        length = math.sqrt(ux * ux + uy * uy + uz * uz)
        ux, uy, uz = ux / length, uy / length, uz / length
        vx, vy, vz = b_ * uz - c_ * uy, c_ * ux - a_ * uz, a_ * uy - b_ * ux
        stride = int(told[r, 0]) // _MOST + 1
        count = passed = 0
        uu = vv = uv = square = third = 0.0
        for i in range(max(cells[r, 0] - _REACH, 0), min(cells[r, 0] + _REACH + 1, nx)):
            for j in range(max(cells[r, 1] - _REACH, 0), min(cells[r, 1] + _REACH + 1, ny)):
                for k in range(max(cells[r, 2] - _REACH, 0), min(cells[r, 2] + _REACH + 1, nz)):
                    q = number_at[i, j, k] - 1
                    if q < 0:
                        continue
                    for p in range(start[q], start[q + 1]):
                        passed += 1
                        if passed % stride != 0 or count == _MOST:
                            continue
                        dx, dy = points[p, 0] - center[0], points[p, 1] - center[1]
                        dz = points[p, 2] - center[2]
                        x[count] = ux * dx + uy * dy + uz * dz
                        y[count] = vx * dx + vy * dy + vz * dz
                        z[count] = a_ * dx + b_ * dy + c_ * dz
                        own[count] = q == r
                        uu += x[count] * x[count]
                        vv += y[count] * y[count]
                        uv += x[count] * y[count]
                        square += z[count] * z[count]
                        third += z[count] ** 3
                        count += 1
        told[r, 1:] = 0.0
        if square <= 0.0:
            continue
        variance = square / count
        # the area of a square of uniform points is 12 times the product of their deviations
        far = 12.0 * math.sqrt(max(uu * vv - uv * uv, 0.0)) / count**2 * _NEIGHBOUR**2
        for p in range(count):
            heap[p], many[p] = z[p], 1.0
        alike = pairs = 0.0
        for p in range(count):
            for q in range(p):
                dx, dy = x[p] - x[q], y[p] - y[q]
                apart = dx * dx + dy * dy
                if apart < disc:
                    heap[p] += z[q]
                    heap[q] += z[p]
                    many[p] += 1.0
                    many[q] += 1.0
                if apart >= far:
                    continue
                product = z[p] * z[q] / variance
                alike += product
                pairs += 1.0
                if own[p] or own[q]:
                    turn = math.floor((math.atan2(dy, dx) / math.pi + 2.0) * _TURNS + 0.5) % _TURNS
                    sums[r, turn, 0] += product
                    sums[r, turn, 1] += 1.0
        told[r, 1] = math.sqrt(square / (count - 3))
        told[r, 2] = alike / max(pairs, 1.0)
        told[r, 3] = third / count / variance**1.5
        for p in range(count):
            if many[p] >= 3.0:
                told[r, 4] = max(told[r, 4], abs(heap[p]) / math.sqrt(many[p]))
    return planes, told, sums


@kernel(lean=True)
def _alongside(bins: Bins, planes: Array, r: int, near: npt.NDArray[np.int64]) -> int:
    """Fill `near` with the cells around r that lie as it does; returns their number."""
    cells, number_at = bins.cells, bins.number_at
    nx, ny, nz = number_at.shape
    count = 0
    for i in range(max(cells[r, 0] - _AROUND, 0), min(cells[r, 0] + _AROUND + 1, nx)):
        for j in range(max(cells[r, 1] - _AROUND, 0), min(cells[r, 1] + _AROUND + 1, ny)):
            for k in range(max(cells[r, 2] - _LAYERS, 0), min(cells[r, 2] + _LAYERS + 1, nz)):
                q = number_at[i, j, k] - 1
                if q < 0:
                    continue
                cosine = (
                    planes[r, 3] * planes[q, 3]
                    + planes[r, 4] * planes[q, 4]
                    + planes[r, 5] * planes[q, 5]
                )
                if abs(cosine) >= _PARALLEL:
                    near[count] = q
                    count += 1
    return count


@kernel(nogil=True)
def _judge(bins: Bins, planes: Array, told: Array, sums: Array) -> tuple[Mask, Array]:
    """(m,) which neighbourhoods are planes, and the noise there, metres.

    Args:
        planes, told, sums: see `_look`.
    """
    m = len(bins.cells)
    white, plain = np.zeros(m, np.bool_), np.zeros(m, np.bool_)
    noise = np.full(m, np.inf)
    near = np.empty((2 * _AROUND + 1) ** 2 * (2 * _LAYERS + 1), np.int64)
    left = np.empty(len(near))
    along = np.empty((_TURNS, 2))
    disc = math.pi * (_DISC / (2.0 * _REACH + 1.0)) ** 2  # of the area that the points cover
    for r in range(m):
        if told[r, 1] == np.inf:
            continue
        count = 0
        for n in range(_alongside(bins, planes, r, near)):
            if told[near[n], 1] < np.inf:
                left[count] = told[near[n], 1]
                count += 1
        if count < _ENOUGH:
            continue
        deviation = math.sqrt(2.0 / (told[r, 0] - 3.0))  # of what is left, squared
        quiet = np.sort(left[:count])[int(_QUIET * count)]
        noise[r] = quiet / (1.0 - 0.5 * _QUIET_BY * deviation)
        shows = _LOW * math.sqrt(told[r, 0] * disc) / (_HEAPED + 1.0)
        white[r] = (
            noise[r] <= shows
            and told[r, 1] <= noise[r] * math.sqrt(1.0 + _MORE * deviation)
            and told[r, 2] <= _ALIKE
            and told[r, 4] <= _HEAPED * noise[r]
        )
    for r in range(m):
        if not white[r]:
            continue
        along[:] = 0.0
        skewed = white_around = 0.0
        for n in range(_alongside(bins, planes, r, near)):
            q = near[n]
            if not white[q]:
                continue
            skewed += told[q, 3] if planes[q, 5] >= 0.0 else -told[q, 3]
            white_around += 1.0
            for turn in range(_TURNS):
                along[turn, 0] += sums[q, turn, 0]
                along[turn, 1] += sums[q, turn, 1]
        plain[r] = skewed <= _SKEWED * white_around
        for turn in range(_TURNS):
            if along[turn, 1] >= _PAIRS and along[turn, 0] > _ALIKE_ALONG * along[turn, 1]:
                plain[r] = False
    return plain, noise


@kernel(nogil=True)
def _move(bins: Bins, planes: Array, plain: Mask, noise: Array) -> tuple[Array, Mask]:
    """Points on their cell's plane, where that is none on the nearest beside; which lie on one."""
    points, start = bins.points, bins.start
    moved = points.copy()
    explained = np.zeros(len(points), np.bool_)
    candidates = np.empty(125, np.int64)
    for r in range(len(bins.cells)):
        for p in range(start[r], start[r + 1]):
            x, y, z = points[p, 0], points[p, 1], points[p, 2]
            best, distance = -1, math.inf
            if plain[r]:
                off = residual(planes, r, x, y, z)
                if abs(off) <= _OWN * noise[r]:
                    best, distance = r, off
            for ring in range(1, 1 if plain[r] else _REACH + 1):
                if best >= 0:
                    break
                for c in range(gather(bins, plain, r, ring, candidates, 0)):
                    q = candidates[c]
                    off = residual(planes, q, x, y, z)
                    if abs(off) <= _BESIDE * noise[q] and abs(off) < abs(distance):
                        best, distance = q, off
            if best >= 0:
                explained[p] = True
                for a in range(3):
                    moved[p, a] -= distance * planes[best, 3 + a]
    return moved, explained


@kernel(nogil=True)
def _doubtful(bins: Bins, planes: Array, plain: Mask, explained: Mask) -> Mask:
    """(m,) cells with points of no plane; with those around where these rise but a little."""
    points, start, cells, number_at = bins.points, bins.start, bins.cells, bins.number_at
    nx, ny, nz = number_at.shape
    marked = np.zeros(len(cells), np.bool_)
    candidates = np.empty(125, np.int64)
    for r in range(len(cells)):
        i, j, k = cells[r, 0], cells[r, 1], cells[r, 2]
        count = -1
        low = False
        for p in range(start[r], start[r + 1]):
            if explained[p]:
                continue
            marked[r] = True
            if count < 0:
                count = gather(bins, plain, r, 1, candidates, 0)
                count = gather(bins, plain, r, 2, candidates, count)
            for c in range(count):
                q = candidates[c]
                off = residual(planes, q, points[p, 0], points[p, 1], points[p, 2])
                low = low or (abs(off) < _RELIEF and abs(planes[q, 5]) > _LEVEL)
        for up in range(1, _LAYERS + 1):
            low = low and (k + up >= nz or number_at[i, j, k + up] == 0)
        if not low:
            continue
        for a in range(max(i - 1, 0), min(i + 2, nx)):
            for b in range(max(j - 1, 0), min(j + 2, ny)):
                for c in range(max(k - 1, 0), min(k + 2, nz)):
                    if number_at[a, b, c] > 0:
                        marked[number_at[a, b, c] - 1] = True
    return marked


def smoothed(
    bins: Bins,
    origin: Array,
    size: float,
    floor: float,
    min_points: int,
    lower: Array,
    upper: Array,
) -> tuple[Array, float, Cells] | None:
    """Points projected onto their surfaces where these are planes beyond doubt.

    Args:
        floor: clouds of less noise are clean, metres.
        min_points: of no plane, of which fewer are dropped.
        lower, upper: corners within which points are kept.

    Returns:
        (n, 3), NaN for lone points off every surface; the noise, metres; cells (k, 3) on which
        nothing is to stand. None where the cloud is clean, or noise cannot be told.
    """
    planes, told, sums = _look(bins, cell_moments(bins, origin, size), origin, size)
    left = told[np.isfinite(told[:, 1]), 1]
    if len(left) < _SURFACES * len(told) or np.quantile(left, 0.25) <= floor:
        return None
    plain, local = _judge(bins, planes, told, sums)
    if plain.sum() < _PLANES * len(told):
        return None
    noise = float(np.median(local[plain]))
    curved = scatter_about_curved(bins, _REACH)
    if noise <= max(floor, _LEAST) or (len(curved) and float(np.median(curved)) < _CURVED * noise):
        return None
    moved, explained = _move(bins, planes, plain, local)
    moved = np.clip(moved, lower, upper)
    moved[strays(bins, explained, min_points)] = np.nan
    return moved, noise, bins.cells[_doubtful(bins, planes, plain, explained)]
