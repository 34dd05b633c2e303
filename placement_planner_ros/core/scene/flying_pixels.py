"""Flying pixels: points that a depth camera puts into the air, told by what it sees around them.

At an edge a camera mixes what is nearer with what is farther, and now and then a pixel fails; both
leave points somewhere along a line of sight. What is really there is seen by several neighbouring
pixels, at about one range, at least along a line: a contour of a slanted surface, a wire. So a
point stays if enough points that stay are seen beside it at its range, or if a line through two of
them leads on to it, as on what is seen too steeply for that. It stays too where the pixels around
it saw little else: nothing contradicts it.

A surface seen at a flat angle has, a few rows of pixels on, the range of whatever is close before
it. So where pixels around a point lie in a plane that passes behind it (`plane_behind`), these say
nothing for it: what stays there needs others, beside it at its range or as far before that plane.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.plane_behind import (
    Flags,
    before_plane,
    on_plane,
    plane_behind,
)
from placement_planner_ros.core.scene.seen_pixels import SAMPLED, Index, Seen, around, seen_from
from placement_planner_ros.core.types import Array

Mask = npt.NDArray[np.bool_]

_SEEN = 0.3
"""Cosine to the middle of the view below which directions are too distorted: nothing is dropped."""
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
_TOO_CLOSE = 0.3
"""Pixels between directions; what one sensor sees at once has none so close together. ..."""
_MIXED = 0.05
"""... Where more than this share are, none goes."""
_ROOM = 256
"""Neighbours that are looked at, at most."""
_NOT_ASKED, _NOTHING, _PLANE = 0, 1, 2
"""What passes behind a point, as far as it was asked."""


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
    sample[:: max(1, len(points) // SAMPLED)] = True
    asked[rows] = True
    return _flying(points, sensor, asked | sample, sample)[rows]


def _flying(points: Array, sensor: Array, asked: Mask, sample: Mask) -> Mask:
    """(n,) flying pixels among those asked; none where too many of the sample, asked too, are."""
    points = np.ascontiguousarray(points, dtype=np.float64)
    gone = np.zeros(len(points), np.bool_)
    seen = seen_from(points, np.asarray(sensor, dtype=np.float64), _WINDOW)
    if seen is None:
        return gone
    residuals, crowded = _residuals(seen, max(1, len(seen.row) // SAMPLED))
    if not len(residuals) or crowded > _MIXED:
        return gone
    # Of a normal distribution 70 % are within 1.036 deviations; 2 a - b - c varies by 6 times more.
    noise = float(np.quantile(residuals, 0.7)) / 1.036 / math.sqrt(6.0)
    flying = _unsupported(seen, noise, asked[seen.row])
    sampled = sample[seen.row]
    if (flying & sampled).sum() <= _MOST * sampled.sum():
        gone[seen.row[flying]] = True
    return gone


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
        crowded += around(seen, p, _TOO_CLOSE, near) > 0
        beside = around(seen, p, _BESIDE, near)
        first = near[:beside].copy()
        count = around(seen, p, 2.0 * _BESIDE + _ASIDE, near)
        off = np.inf
        for q in first:
            for j in range(count):
                if near[j] != q:
                    off = abs(_off_line(seen, p, q, near[j]))
                if off < np.inf:
                    break
            if off < np.inf:
                break
        if off < np.inf:
            found[k] = off
            k += 1
    return found[:k], crowded / max(asked, 1)


@kernel(lean=True)
def _count(
    seen: Seen, p: int, first: int, last: int, tolerance: float, alive: Mask, enough: int
) -> int:
    """How many of these points that stay are beside point p at its range, `enough` at most."""
    a, b, r = seen.at[p, 0], seen.at[p, 1], seen.range[p]
    reach = (_WINDOW * seen.pitch) ** 2
    count = 0
    for q in range(first, last):
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
    j0, j1 = max(column - 1, 0), min(column + 2, ny)
    count = 0
    for i in range(max(row - 1, 0), min(row + 2, nx)):
        # bins of one row lie one after the other
        first, last = seen.start[i * ny + j0], seen.start[i * ny + j1]
        count += _count(seen, p, first, last, tolerance, alive, _STAND_BY - count)
        if count == _STAND_BY:
            return True
    return False


@kernel(lean=True)
def _in_line(seen: Seen, p: int, tolerance: float, alive: Mask, near: Index, count: int) -> bool:
    """Whether a line through two points that stay, one behind the other, leads to point p.

    Args:
        near: the first `count` are the points around it.
    """
    within = (_BESIDE * seen.pitch) ** 2
    for i in range(count):
        q = near[i]
        u, v = seen.at[q, 0] - seen.at[p, 0], seen.at[q, 1] - seen.at[p, 1]
        if u * u + v * v > within or not alive[q]:
            continue
        for j in range(count):
            o = near[j]
            # first what rules most of them out
            if abs(2.0 * seen.range[q] - seen.range[o] - seen.range[p]) > tolerance:
                continue
            if o != q and alive[o] and abs(_off_line(seen, p, q, o)) <= tolerance:
                return True
    return False


@kernel(lean=True)
def _contradicted(seen: Seen, p: int, tolerance: float, near: Index, count: int) -> bool:
    """Whether enough of the pixels in the window of point p saw something else."""
    reach = (_WINDOW * seen.pitch) ** 2
    others = 0
    for i in range(count):
        u, v = seen.at[near[i], 0] - seen.at[p, 0], seen.at[near[i], 1] - seen.at[p, 1]
        if u * u + v * v <= reach:
            others += abs(seen.range[near[i]] - seen.range[p]) > tolerance
    return others >= _CONTRADICT


@kernel(lean=True)
def _between(seen: Seen, p: int, tolerance: float, near: Index) -> bool:
    """Whether point p lies between two of its 8 neighbours, in range too: within a surface."""
    count = around(seen, p, _BESIDE, near)
    for i in range(count):
        u, v = seen.at[near[i], 0] - seen.at[p, 0], seen.at[near[i], 1] - seen.at[p, 1]
        for j in range(i):
            s, t = seen.at[near[j], 0] - seen.at[p, 0], seen.at[near[j], 1] - seen.at[p, 1]
            if (u + s) ** 2 + (v + t) ** 2 > (_ASIDE * seen.pitch) ** 2:
                continue
            if abs(2.0 * seen.range[p] - seen.range[near[i]] - seen.range[near[j]]) <= tolerance:
                return True
    return False


@kernel(lean=True)
def _stands_before(
    seen: Seen, p: int, tolerance: float, alive: Mask, near: Index, count: int, plane: Array
) -> bool:
    """Whether enough points that stay, not of the plane behind point p, are beside it.

    At its range, or as far before the plane; or two of them lead on to it.
    """
    own = before_plane(seen, p, p, plane)
    beside = 0
    for i in range(count):
        q = near[i]
        off = before_plane(seen, p, q, plane)
        if not alive[q] or off <= 0.5 * tolerance:
            continue
        u, v = seen.at[q, 0] - seen.at[p, 0], seen.at[q, 1] - seen.at[p, 1]
        if u * u + v * v <= (_WINDOW * seen.pitch) ** 2:
            beside += abs(seen.range[q] - seen.range[p]) <= tolerance or abs(off - own) <= tolerance
        if beside == _STAND_BY:
            return True
        if u * u + v * v > (_BESIDE * seen.pitch) ** 2:
            continue
        for j in range(count):
            o = near[j]
            if abs(2.0 * seen.range[q] - seen.range[o] - seen.range[p]) > tolerance:
                continue
            if o == q or not alive[o] or before_plane(seen, p, o, plane) <= 0.5 * tolerance:
                continue
            if abs(_off_line(seen, p, q, o)) <= tolerance:
                return True
    return False


@kernel(lean=True)
def _stays(
    seen: Seen,
    p: int,
    tolerance: float,
    alive: Mask,
    in_line: Mask,
    behind: Flags,
    planes: Array,
    near: Index,
    window: Array,
) -> bool:
    """Whether point p has enough that stay beside it; fills in what was found of it.

    Args:
        in_line: (n,) whether it stays for a line that leads to it.
        behind, planes: (n,), (n, 3) what passes behind it.
        near, window: room for the points around it.
    """
    count = 0
    if not _stands(seen, p, tolerance, alive):
        count = around(seen, p, 2.0 * _BESIDE + _ASIDE, near)
        in_line[p] = _in_line(seen, p, tolerance, alive, near, count)
        if not in_line[p] and _contradicted(seen, p, tolerance, near, count):
            return False
    if behind[p] == _NOT_ASKED:
        behind[p] = _NOTHING
        if not _between(seen, p, tolerance, near):
            beside = around(seen, p, _WINDOW, near)
            if plane_behind(seen, p, near, beside, tolerance, window, planes[p]):
                behind[p] = _PLANE
    if behind[p] != _PLANE:
        return True
    count = around(seen, p, 2.0 * _BESIDE + _ASIDE, near)
    return _stands_before(seen, p, tolerance, alive, near, count, planes[p])


@kernel(nogil=True)
def _unsupported(seen: Seen, noise: float, asked: Mask) -> Mask:
    """(n,) points that go, until each of those asked that stays has enough that stay beside it.

    A point that goes only ever takes support from others, so the order makes no difference, and
    fewer go where not all are asked.
    """
    n = len(seen.row)
    alive, in_line = np.ones(n, np.bool_), np.zeros(n, np.bool_)
    behind, planes = np.zeros(n, np.int8), np.empty((n, 3))
    near, again = np.empty(_ROOM, np.int64), np.empty(_ROOM, np.int64)
    window = np.empty((_ROOM, 3))
    gone = np.empty(n, np.int64)  # a queue, whose neighbours up to `done` were asked again
    count = 0
    for cell in range(len(seen.start) - 1):
        on_plane(seen, cell, _NOISES * noise, behind)
        first, last = seen.start[cell], seen.start[cell + 1]
        for p in range(first, last):
            tolerance = max(_NOISES * noise, seen.pitch * seen.range[p])
            if not asked[p] or seen.cosine[p] < _SEEN:
                continue
            # most points lie in a surface, of which their own bin shows enough
            if behind[p] == _NOTHING and (
                _count(seen, p, first, last, tolerance, alive, _STAND_BY) == _STAND_BY
            ):
                continue
            if not _stays(seen, p, tolerance, alive, in_line, behind, planes, near, window):
                alive[p] = False
                gone[count] = p
                count += 1
    done = 0
    while done < count:
        lost = gone[done]
        done += 1
        for k in range(around(seen, lost, _WINDOW, again)):
            p = again[k]
            tolerance = max(_NOISES * noise, seen.pitch * seen.range[p])
            if not asked[p] or not alive[p] or seen.cosine[p] < _SEEN:
                continue
            aside = abs(seen.range[p] - seen.range[lost])
            if aside > tolerance and not in_line[p] and behind[p] != _PLANE:
                continue  # it had nothing from what has gone
            if not _stays(seen, p, tolerance, alive, in_line, behind, planes, near, window):
                alive[p] = False
                gone[count] = p
                count += 1
    return ~alive
