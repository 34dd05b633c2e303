"""Flying pixels: points that a depth camera puts into the air, told by what it sees around them.

At an edge a camera mixes what is nearer with what is farther, and now and then a pixel fails; both
leave points somewhere along a line of sight. What is really there is seen by several neighbouring
pixels, at about one range, at least along a line: a contour of a slanted surface, a wire. So a
point stays if enough points that stay are seen beside it at its range, or if a line through two of
them leads on to it, as on what is seen too steeply for that. It stays too where the pixels around
it saw little else: nothing contradicts it.

Pixels are found again from directions: clouds need not be organised. Directions are laid on a disc
by Lambert's equal-area projection, where the spacing of pixels follows from how many points lie on
an area.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.types import Array

Mask = npt.NDArray[np.bool_]
Index = npt.NDArray[np.int64]

_TILES = 257
_TILE = 4.0 / 256
"""Tiles of directions on the disc, of radius 2: how many along each axis, and their edge, 0.9°."""
_SEEN = 0.3
"""Cosine to the middle of the view below which directions are too distorted: nothing is dropped."""
_FEWEST_IN_TILE = 4.0
"""A sensor that sees fewer points than this in a tile is too coarse to tell: nothing is dropped."""
_WINDOW = 3.5
"""Pixels around a point that may stand by it: 36, three of them beside the end of a wire."""
_BESIDE = 1.6
"""Pixels around a point from which lines may lead on to it: the 8 neighbours."""
_ASIDE = 0.6
"""Pixels by which such a line may fail to be straight."""
_STEEPEST = 10.0
"""By how many spacings the range may change along it from pixel to pixel: 6° to the surface."""
_STAND_BY = 3
"""Points beside it at its range that a point needs, or one line that leads to it."""
_CONTRADICT = 12
"""A point goes only where at least so many pixels in its window saw something else."""
_NOISES = 4.5
"""Times the noise along a ray by which points beside each other may differ, a spacing at least."""
_MOST = 0.3
"""Were more than this share to go, the cloud is not what one sensor saw from there: none goes."""
_SAMPLED = 1500
"""Points looked at to estimate the noise."""
_TOO_CLOSE = 0.3
"""Pixels between directions; what one sensor sees at once has none so close together. ..."""
_MIXED = 0.05
"""... Where more than this share are, none goes."""
_ROOM = 256
"""Neighbours that are looked at, at most."""


class Seen(NamedTuple):
    """Points as seen by their sensor, those of one bin of directions next to each other.

    Attributes:
        at: (n, 2) coordinates of their directions on the disc.
        range: (n,) metres.
        cosine: (n,) of the angle to the middle of the view.
        row: (n,) of the cloud.
        start: (nx * ny + 1,) first point of each bin, and n.
        low: (2,) lower corner of the bins.
        edge: of a bin.
        shape: nx, ny.
        pitch: rad between neighbouring pixels.
    """

    at: Array
    range: Array
    cosine: Array
    row: Index
    start: Index
    low: Array
    edge: float
    shape: tuple[int, int]
    pitch: float


def flying_pixels(points: Array, sensor: Array) -> Mask:
    """(n,) which points of a cloud are flying pixels.

    What more than `_STAND_BY` pixels beside each other see at one range is kept. Clouds of which
    it cannot be told what lies beside what, as they are sparse, thinned or of several moments,
    are kept as they are.

    Args:
        points: (n, 3) all that a sensor measured in one moment, metres; NaN where nothing was.
        sensor: (3,) where it was, metres.
    """
    everything = np.ones(len(points), np.bool_)
    return _flying(points, sensor, everything, everything)


def flying_among(points: Array, sensor: Array, rows: Index) -> Mask:
    """(k,) which of some points of a cloud are flying pixels, in a part of the time for all.

    Only those that `flying_pixels` says are: what else flies counts as support here. Whether too
    many of the cloud fly is told from a sample.

    Args:
        points, sensor: as for `flying_pixels`.
        rows: (k,) of the points.
    """
    sample, asked = np.zeros((2, len(points)), np.bool_)
    sample[:: max(1, len(points) // _SAMPLED)] = True
    asked[rows] = True
    return _flying(points, sensor, asked | sample, sample)[rows]


def _flying(points: Array, sensor: Array, asked: Mask, sample: Mask) -> Mask:
    """(n,) flying pixels among those asked; none where too many of the sample, asked too, are."""
    points = np.ascontiguousarray(points, dtype=np.float64)
    gone = np.zeros(len(points), np.bool_)
    seen = _seen(points, np.asarray(sensor, dtype=np.float64))
    if seen is None:
        return gone
    residuals, crowded = _residuals(seen, max(1, len(seen.row) // _SAMPLED))
    if not len(residuals) or crowded > _MIXED:
        return gone
    # Of a normal distribution 70 % are within 1.036 deviations; 2 a - b - c varies by 6 times more.
    noise = float(np.quantile(residuals, 0.7)) / 1.036 / math.sqrt(6.0)
    flying = _unsupported(seen, noise, asked[seen.row])
    sampled = sample[seen.row]
    if (flying & sampled).sum() <= _MOST * sampled.sum():
        gone[seen.row[flying]] = True
    return gone


def _seen(points: Array, sensor: Array) -> Seen | None:
    """None where there is too little in view to tell neighbours."""
    some = points[:: max(1, len(points) // _SAMPLED)] - sensor
    length = np.linalg.norm(some, axis=1)
    some = some[np.isfinite(length) & (length > 0.0)]
    if not len(some):
        return None
    middle = (some / np.linalg.norm(some, axis=1)[:, None]).mean(axis=0)
    length = np.linalg.norm(middle)
    if length < 1e-3:
        return None
    middle /= length
    right = np.cross(middle, np.eye(3)[np.argmin(np.abs(middle))])
    right /= np.linalg.norm(right)
    frame = np.array([right, np.cross(middle, right), middle])
    flat, tiles, corners = _project(points, sensor, frame)
    occupied = tiles[tiles > 0]
    if not len(occupied) or np.median(occupied) < _FEWEST_IN_TILE:
        return None
    pitch = _TILE / math.sqrt(float(np.median(occupied)))
    edge = _WINDOW * pitch
    low = corners[0]
    sides = ((corners[1] - low) / edge).astype(np.int64) + 1
    at, ranges, cosine, row, start = _sort(flat, low, edge, int(sides[0]), int(sides[1]))
    return Seen(at, ranges, cosine, row, start, low, edge, (int(sides[0]), int(sides[1])), pitch)


@kernel(nogil=True)
def _project(points: Array, sensor: Array, frame: Array) -> tuple[Array, Index, Array]:
    """Each point on the disc: (x, y) √(2 / (1 + z)) of its direction (x, y, z) in the frame.

    Returns:
        (n, 4) the two coordinates, the range in metres, and z, the cosine to the middle; NaN where
        nothing was measured. (tiles²,) how many lie in each tile. (2, 2) the corners of all.
    """
    n = len(points)
    flat = np.full((n, 4), np.nan)
    low_a = low_b = 2.0
    high_a = high_b = -2.0
    tiles = np.zeros(_TILES * _TILES, np.int64)
    for p in range(n):
        x, y, z = points[p, 0] - sensor[0], points[p, 1] - sensor[1], points[p, 2] - sensor[2]
        r = math.sqrt(x * x + y * y + z * z)
        if not (r > 0.0 and r < np.inf):
            continue
        cosine = (frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z) / r
        if cosine < -0.9:  # close to where the whole rim of the disc is one direction
            continue
        scale = math.sqrt(2.0 / (1.0 + cosine)) / r
        a = (frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z) * scale
        b = (frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z) * scale
        flat[p, 0], flat[p, 1], flat[p, 2], flat[p, 3] = a, b, r, cosine
        low_a, high_a, low_b, high_b = min(low_a, a), max(high_a, a), min(low_b, b), max(high_b, b)
        tiles[int((a + 2.0) / _TILE) * _TILES + int((b + 2.0) / _TILE)] += 1
    return flat, tiles, np.array([[low_a, low_b], [high_a, high_b]])


@kernel(nogil=True)
def _sort(
    flat: Array, low: Array, edge: float, nx: int, ny: int
) -> tuple[Array, Array, Array, Index, Index]:
    """A counting sort: `at`, `range`, `cosine`, `row` and `start` of `Seen`."""
    n = len(flat)
    bin_of = np.full(n, -1, np.int64)
    start = np.zeros(nx * ny + 1, np.int64)
    for p in range(n):
        if flat[p, 2] > 0.0:
            i, j = int((flat[p, 0] - low[0]) / edge), int((flat[p, 1] - low[1]) / edge)
            bin_of[p] = i * ny + j
            start[bin_of[p] + 1] += 1
    for b in range(nx * ny):
        start[b + 1] += start[b]
    fill = start[:-1].copy()
    m = start[nx * ny]
    at, ranges, cosine = np.empty((m, 2)), np.empty(m), np.empty(m)
    row = np.empty(m, np.int64)
    for p in range(n):
        if bin_of[p] >= 0:
            to = fill[bin_of[p]]
            fill[bin_of[p]] += 1
            at[to, 0], at[to, 1], ranges[to], cosine[to] = (
                flat[p, 0],
                flat[p, 1],
                flat[p, 2],
                flat[p, 3],
            )
            row[to] = p
    return at, ranges, cosine, row, start


@kernel(lean=True)
def _around(seen: Seen, p: int, pixels: float, near: Index) -> int:
    """Into `near` other points within so many pixels of point p; returns how many."""
    a, b = seen.at[p, 0], seen.at[p, 1]
    reach = pixels * seen.pitch
    count = 0
    for i in range(
        max(int((a - reach - seen.low[0]) / seen.edge), 0),
        min(int((a + reach - seen.low[0]) / seen.edge) + 1, seen.shape[0]),
    ):
        for j in range(
            max(int((b - reach - seen.low[1]) / seen.edge), 0),
            min(int((b + reach - seen.low[1]) / seen.edge) + 1, seen.shape[1]),
        ):
            cell = i * seen.shape[1] + j
            for q in range(seen.start[cell], seen.start[cell + 1]):
                u, v = seen.at[q, 0] - a, seen.at[q, 1] - b
                if u * u + v * v <= reach * reach and q != p and count < len(near):
                    near[count] = q
                    count += 1
    return count


@kernel(lean=True)
def _off_line(seen: Seen, p: int, q: int, o: int) -> float:
    """How far beyond point p the line from o through q, extended by as much, ends, metres.

    Infinite where q is not in the middle between p and o, or too steeply seen.
    """
    u, v = seen.at[q, 0] - seen.at[p, 0], seen.at[q, 1] - seen.at[p, 1]
    s, t = seen.at[o, 0] - seen.at[p, 0] - 2.0 * u, seen.at[o, 1] - seen.at[p, 1] - 2.0 * v
    if s * s + t * t > (_ASIDE * seen.pitch) ** 2:
        return np.inf
    aside = math.sqrt(u * u + v * v) * seen.range[p]
    if abs(seen.range[q] - seen.range[o]) > _STEEPEST * aside:
        return np.inf
    return 2.0 * seen.range[q] - seen.range[o] - seen.range[p]


@kernel(nogil=True)
def _residuals(seen: Seen, stride: int) -> tuple[Array, float]:
    """(k,) how far some points are from a line that leads to them, metres.

    And which share of them has another one in the very same direction.
    """
    near = np.empty(_ROOM, np.int64)
    found = np.empty(len(seen.row) // stride + 1)
    k = asked = crowded = 0
    for p in range(0, len(seen.row), stride):
        asked += 1
        crowded += _around(seen, p, _TOO_CLOSE, near) > 0
        beside = _around(seen, p, _BESIDE, near)
        first = near[:beside].copy()
        count = _around(seen, p, 2.0 * _BESIDE + _ASIDE, near)
        off = np.inf
        for q in first:
            for j in range(count):
                if off == np.inf and near[j] != q:
                    off = abs(_off_line(seen, p, q, near[j]))
        if off < np.inf:
            found[k] = off
            k += 1
    return found[:k], crowded / max(asked, 1)


@kernel(lean=True)
def _count(seen: Seen, p: int, cell: int, tolerance: float, alive: Mask, enough: int) -> int:
    """How many points of a bin that stay are beside point p at its range, `enough` at most."""
    a, b, r = seen.at[p, 0], seen.at[p, 1], seen.range[p]
    reach = (_WINDOW * seen.pitch) ** 2
    count = 0
    for q in range(seen.start[cell], seen.start[cell + 1]):
        if abs(seen.range[q] - r) <= tolerance and q != p and alive[q]:
            u, v = seen.at[q, 0] - a, seen.at[q, 1] - b
            if u * u + v * v <= reach:
                count += 1
                if count == enough:
                    break
    return count


@kernel(lean=True)
def _stands(seen: Seen, p: int, tolerance: float, alive: Mask) -> bool:
    """Whether enough points that stay are beside point p at its range."""
    nx, ny = seen.shape
    row = int((seen.at[p, 0] - seen.low[0]) / seen.edge)
    column = int((seen.at[p, 1] - seen.low[1]) / seen.edge)
    count = _count(seen, p, row * ny + column, tolerance, alive, _STAND_BY)
    for i in range(max(row - 1, 0), min(row + 2, nx)):
        for j in range(max(column - 1, 0), min(column + 2, ny)):
            if count < _STAND_BY and (i != row or j != column):
                count += _count(seen, p, i * ny + j, tolerance, alive, _STAND_BY - count)
    return count >= _STAND_BY


@kernel(lean=True)
def _in_line(seen: Seen, p: int, tolerance: float, alive: Mask, near: Index) -> bool:
    """Whether a line through two points that stay, one behind the other, leads to point p."""
    count = _around(seen, p, 2.0 * _BESIDE + _ASIDE, near)
    within = (_BESIDE * seen.pitch) ** 2
    for i in range(count):
        u, v = seen.at[near[i], 0] - seen.at[p, 0], seen.at[near[i], 1] - seen.at[p, 1]
        if u * u + v * v > within or not alive[near[i]]:
            continue
        for j in range(count):
            if j == i or not alive[near[j]]:
                continue
            if abs(_off_line(seen, p, near[i], near[j])) <= tolerance:
                return True
    return False


@kernel(lean=True)
def _contradicted(seen: Seen, p: int, tolerance: float, near: Index) -> bool:
    """Whether enough of the pixels around point p saw something else."""
    count = _around(seen, p, _WINDOW, near)
    others = 0
    for i in range(count):
        others += abs(seen.range[near[i]] - seen.range[p]) > tolerance
    return others >= _CONTRADICT


@kernel(nogil=True)
def _unsupported(seen: Seen, noise: float, asked: Mask) -> Mask:
    """(n,) points that go, until each of those asked that stays has enough that stay beside it.

    A point that goes only ever takes support from others, so the order makes no difference, and
    fewer go where not all are asked.
    """
    n = len(seen.row)
    alive = np.ones(n, np.bool_)
    in_line = np.zeros(n, np.bool_)
    near = np.empty(_ROOM, np.int64)
    again = np.empty(_ROOM, np.int64)
    gone = np.empty(n, np.int64)  # a queue, whose neighbours up to `done` were asked again
    count = done = p = 0
    while p < n or done < count:
        if p < n:
            among = 1
            again[0] = p
            p += 1
        else:
            lost = gone[done]
            among = _around(seen, lost, _WINDOW, again)
            done += 1
        for k in range(among):
            q = again[k]
            tolerance = max(_NOISES * noise, seen.pitch * seen.range[q])
            if not asked[q] or not alive[q] or seen.cosine[q] < _SEEN:
                continue
            if done > 0 and not in_line[q]:  # it had nothing from what has gone
                aside = abs(seen.range[q] - seen.range[gone[done - 1]])
                if aside > tolerance:
                    continue
            if _stands(seen, q, tolerance, alive):
                continue
            in_line[q] = _in_line(seen, q, tolerance, alive, near)
            if not in_line[q] and _contradicted(seen, q, tolerance, near):
                alive[q] = False
                gone[count] = q
                count += 1
    return ~alive
