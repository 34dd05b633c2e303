"""Flying pixels: points that a depth camera puts into the air, told by what it sees around them.

At an edge a camera mixes what is nearer with what is farther, and now and then a pixel fails; both
leave points somewhere along a line of sight. What is really there is seen by several pixels. So a
point stays if it is of a *piece*, beside two others at about its range; or
if a line through two pixels that stay, one behind the other, leads on to it, as on what is seen too
steeply to be of one range; or if the pixels around it saw little else: nothing contradicts it.

Pixels are found again from directions: clouds need not be organised. Directions are laid on a disc
by Lambert's equal-area projection, where the spacing of pixels follows from how many points lie on
an area.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from placement_planner_ros.core.scene.cloud import SAMPLES, SURE_NOISES
from placement_planner_ros.core.scene.freespace import BINS
from placement_planner_ros.core.types import Array, Index, Mask, kernel_input
from placement_planner_ros.core.uncounted import Uncounted

PIECE_PIXELS = 3
"""Pixels of the smallest piece."""
BESIDE_PIXELS = 1.6
"""Pixels between two that are beside each other: the 8 neighbours."""
STEEPEST = 1.0 / math.tan(math.radians(6.0))
"""Spacings by which the range may change from pixel to pixel along a line that is seen at 6°."""
WINDOW_PIXELS, CONTRADICTING_PIXELS = 3.5, 12
"""A point goes only where, of the 36 pixels that are so near, so many saw something else."""
MOST_FLYING = 0.3
"""Were more than this share to go, the cloud is not what one sensor saw from there: none goes."""
CROWDED_SHARE = 0.05
"""Nor where more than this share have another point in their very direction."""
TILES = 2 * BINS
"""Tiles of directions along each side of the disc's square, 0.9° each. A sensor that sees fewer
points in a tile than are of a piece is too coarse to tell."""


class SeenPixels(NamedTuple):
    """Points as seen by their sensor, those of one bin of directions next to each other.

    Attributes:
        at: (n, 2) where their directions are on the disc, in pixels from its corner.
        range: (n,) metres.
        row: (n,) of the cloud.
        start: (nx, ny + 1) first point of each bin, and of the one behind it; bins are as wide as
            pixels beside each other are apart.
        pitch: rad between neighbouring pixels.
    """

    at: Array
    range: Array
    row: Index
    start: Index
    pitch: float


def flying_pixels(points: Array, sensor: Array) -> Mask:
    """(n,) which points of a cloud are flying pixels.

    Clouds of which it cannot be told what lies beside what, as they are sparse, thinned or of
    several moments, are kept as they are.

    Args:
        points: (n, 3) all that a sensor measured in one moment, metres; NaN where nothing was.
        sensor: (3,) where it was, metres.
    """
    everything = np.ones(len(points), np.bool_)
    return _flying_of_sample(points, sensor, everything, everything)


def flying_among(points: Array, sensor: Array, rows: Index) -> Mask:
    """(k,) which of some points of a cloud are flying pixels, in a part of the time for all.

    Only those that `flying_pixels` says are: what else flies counts as support here. Whether too
    many of the cloud fly is told from a sample.

    Args:
        points, sensor: as for `flying_pixels`.
        rows: (k,) of the points.
    """
    sample, asked = np.zeros((2, len(points)), np.bool_)
    sample[:: max(1, len(points) // SAMPLES)] = True
    asked[rows] = True
    return _flying_of_sample(points, sensor, asked | sample, sample)[rows]


def _flying_of_sample(points: Array, sensor: Array, asked: Mask, sample: Mask) -> Mask:
    """(n,) flying pixels among those asked; none where too many of the sample, asked too, are."""
    points = kernel_input(points)
    gone = np.zeros(len(points), np.bool_)
    seen = _seen_pixels(points, kernel_input(sensor))
    if seen is None:
        return gone
    # the neighbours of a point lie in so many bins, each of no more points than the fullest
    bins = (int(4.0 * WINDOW_PIXELS / BESIDE_PIXELS) + 2) ** 2
    room = np.empty(bins * int(np.diff(seen.start, axis=1).max()), np.int64)
    residuals, crowded = _line_residuals(seen, max(1, len(seen.row) // SAMPLES), room)
    if not len(residuals) or crowded > CROWDED_SHARE:
        return gone
    # Of a normal distribution 70 % are within 1.036 deviations; 2 a - b - c varies by 6 times more.
    noise = float(np.quantile(residuals, 0.7)) / 1.036 / math.sqrt(6.0)
    flying = _unsupported_points(seen, SURE_NOISES * noise, asked[seen.row], room)
    sampled = sample[seen.row]
    if (flying & sampled).sum() <= MOST_FLYING * sampled.sum():
        gone[seen.row[flying]] = True
    return gone


def _seen_pixels(points: Array, sensor: Array) -> SeenPixels | None:
    """None where there is too little in view to tell neighbours."""
    some = points[:: max(1, len(points) // SAMPLES)] - sensor
    length = np.linalg.norm(some, axis=1)
    seen = np.isfinite(length) & (length > 0.0)
    middle = (some[seen] / length[seen, None]).sum(axis=0)
    if np.linalg.norm(middle) < 1e-3 * max(int(seen.sum()), 1):
        return None
    middle /= np.linalg.norm(middle)
    right = np.cross(middle, np.eye(3)[np.argmin(np.abs(middle))])
    right /= np.linalg.norm(right)
    frame = np.array([right, np.cross(middle, right), middle])
    at, ranges, row, tiles = _project_points(points, sensor, frame)
    occupied = tiles[tiles > 0]
    if not len(occupied) or np.median(occupied) < PIECE_PIXELS:
        return None
    pitch = 4.0 / TILES / math.sqrt(float(np.median(occupied)))
    at = (at - at.min(axis=0)) / pitch
    bins = (at / BESIDE_PIXELS).astype(np.int64)
    nx, ny = bins.max(axis=0) + 1
    bin_of = bins[:, 0] * ny + bins[:, 1]
    order = np.argsort(bin_of, kind="stable")
    start = np.append(0, np.bincount(bin_of, minlength=nx * ny).cumsum())
    starts = np.column_stack([start[:-1].reshape(nx, ny), start[ny::ny]])
    return SeenPixels(at[order], ranges[order], row[order], starts, pitch)


@njit(cache=True, nogil=True)
def _project_points(
    points: Array, sensor: Array, frame: Array
) -> tuple[Array, Array, Index, Index]:
    """Points on the disc: (x, y) √(2 / (1 + z)) of their directions (x, y, z) in a frame.

    Returns:
        (m, 2) of those that are in view, (m,) their ranges in metres and their rows, and how many
        lie in each tile.
    """
    n = len(points)
    at, ranges, row = np.empty((n, 2)), np.empty(n), np.empty(n, np.int64)
    tiles = np.zeros((TILES + 1) ** 2, np.int64)
    m = 0
    for p in range(n):
        x, y, z = points[p, 0] - sensor[0], points[p, 1] - sensor[1], points[p, 2] - sensor[2]
        r = math.sqrt(x * x + y * y + z * z)
        if not 0.0 < r < math.inf:  # also where a coordinate is NaN
            continue
        # further than 60° from the middle of the view all stays: directions are distorted there
        cosine = (frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z) / r
        if cosine < 0.5:
            continue
        # its place on the disc, and the tile that it lies in
        scale = math.sqrt(2.0 / (1.0 + cosine)) / r
        a = (frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z) * scale
        b = (frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z) * scale
        at[m, 0], at[m, 1], ranges[m], row[m] = a, b, r, p
        tiles[int((a + 2.0) * 0.25 * TILES) * (TILES + 1) + int((b + 2.0) * 0.25 * TILES)] += 1
        m += 1
    return at[:m], ranges[:m], row[:m], tiles


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _pixels_around(seen: SeenPixels, p: int, reach: float, near: Index) -> int:
    """Into `near` the other points within so many pixels of point p; returns how many."""
    a, b = seen.at[p, 0], seen.at[p, 1]
    nx, ny = seen.start.shape[0], seen.start.shape[1] - 1
    # the bins that the square around the point reaches into
    j0 = int(max(b - reach, 0.0) / BESIDE_PIXELS)
    j1 = min(int((b + reach) / BESIDE_PIXELS) + 1, ny)
    i0 = int(max(a - reach, 0.0) / BESIDE_PIXELS)
    count = 0
    for i in range(i0, min(int((a + reach) / BESIDE_PIXELS) + 1, nx)):
        # bins of one row lie one after the other
        for q in range(seen.start[i, j0], seen.start[i, j1]):
            u, v = seen.at[q, 0] - a, seen.at[q, 1] - b
            if u * u + v * v <= reach * reach and q != p:
                near[count] = q
                count += 1
    return count


@njit(cache=True, nogil=True)
def _line_residuals(seen: SeenPixels, stride: int, near: Index) -> tuple[Array, float]:
    """(k,) how far some points are from a line that leads to them, metres.

    And which share of them has another one in the very same direction.
    """
    found, everything = np.empty(len(seen.row) // stride + 1), np.ones(len(seen.row), np.bool_)
    k = asked = crowded = 0
    for p in range(0, len(seen.row), stride):
        asked += 1
        crowded += _pixels_around(seen, p, 0.5 * 0.5, near) > 0
        off = _off_line(seen, p, math.inf, everything, near)
        if off < math.inf:
            found[k] = off
            k += 1
    return found[:k], crowded / max(asked, 1)


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _off_line(seen: SeenPixels, p: int, tolerance: float, alive: Mask, near: Index) -> float:
    """How far point p is from the first line found that leads to it, no more than the tolerance
    away, through two points that stay, one behind the other; infinite without any.

    Such a line is straight to half a pixel, and not too steeply seen.
    """
    count = _pixels_around(seen, p, 2.0 * BESIDE_PIXELS + 0.5, near)
    for i in range(count):
        q = near[i]
        # over one of the 8 neighbours that stays
        u, v = seen.at[q, 0] - seen.at[p, 0], seen.at[q, 1] - seen.at[p, 1]
        if u * u + v * v > BESIDE_PIXELS * BESIDE_PIXELS or not alive[q]:
            continue
        # metres from there to p across the line of sight
        aside = math.sqrt(u * u + v * v) * seen.pitch * seen.range[p]
        for j in range(count):
            o = near[j]
            # how far beyond p the line from o through q, extended by as much, ends
            off = abs(2.0 * seen.range[q] - seen.range[o] - seen.range[p])
            if off > tolerance or o == q or not alive[o]:
                continue
            # how far o is from where it is straight
            s, t = seen.at[o, 0] - seen.at[p, 0] - 2.0 * u, seen.at[o, 1] - seen.at[p, 1] - 2.0 * v
            steep = abs(seen.range[q] - seen.range[o]) > STEEPEST * aside
            if s * s + t * t <= 0.5 * 0.5 and not steep:
                return off
    return math.inf


@njit(cache=True, nogil=True)
def _unsupported_points(seen: SeenPixels, least: float, asked: Mask, near: Index) -> Mask:
    """(n,) points that go, until each of those asked that stays has what it stays for.

    A point that goes only ever takes support from others, so the order makes no difference, and
    fewer go where not all are asked.

    Args:
        least: m by which points beside each other may differ, a spacing at least.
    """
    n = len(seen.row)
    doubtful, count = np.empty(n, np.int64), 0
    for p in range(n):
        tolerance = max(least, seen.pitch * seen.range[p])
        if not asked[p]:
            continue
        # whether it is of a piece, each of its points beside one that is about as far
        middle, piece = p, False
        for _ in range(2):  # what is beside the point, then what is beside the only one there
            alike, other = 0, p
            for q in near[: _pixels_around(seen, middle, BESIDE_PIXELS, near)]:
                if abs(seen.range[q] - seen.range[middle]) <= tolerance:
                    alike, other = alike + 1, q
            piece = alike + 1 >= PIECE_PIXELS
            if piece:
                break
            middle = other
        if piece:
            continue
        # what the pixels around it saw instead
        others = 0
        for q in near[: _pixels_around(seen, p, WINDOW_PIXELS, near)]:
            others += abs(seen.range[q] - seen.range[p]) > tolerance
        if others >= CONTRADICTING_PIXELS:
            doubtful[count] = p
            count += 1
    # of these, what no line leads to goes, until nothing changes
    alive = np.ones(n, np.bool_)
    changed = True
    while changed:
        changed = False
        for p in doubtful[:count]:
            tolerance = max(least, seen.pitch * seen.range[p])
            if alive[p] and _off_line(seen, p, tolerance, alive, near) > tolerance:
                alive[p] = False
                changed = True
    return ~alive
