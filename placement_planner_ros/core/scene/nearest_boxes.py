"""Of the boxes that end at one height, the one nearest in x and y to each point of a line."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.outlines import Outlines, aside
from placement_planner_ros.core.types import Array

Field = npt.NDArray[np.float32]
Index = npt.NDArray[np.int32]

_STEPS = 8
"""Boxes to go at most from the one that is taken for the nearest to nearer ones."""
_APART = 1e-4
"""m: sides of boxes that lie no further apart are taken for the same."""


class BoxesByHeight(NamedTuple):
    """Boxes in groups: straight or turned ones that end in one slab; in there by column of cells
    along y; in there along y.

    k boxes in c columns of s groups. Turned boxes have outlines that fill no straight rectangle:
    what is nearest is told among straight ones exactly, among turned ones by the rectangles around
    their outlines first.
    """

    outlines: Outlines
    height: Array
    """(k,) z of their lower faces, from the lowest level on."""
    end: Array
    """(k,) how far above the lower level of their slab they end, or, where nothing goes on above,
    those in the cells around: the middle of a dome reaches higher than its rim in the same slab,
    which is nearer."""
    place: Index
    """(k,) number of their cell along y."""
    column: Index
    """(c,) number of their cells along x."""
    column_start: Index
    """(c + 1,) the first box of each column."""
    slab: Index
    """(s,) number of the slab, ascending: first its straight boxes, then its turned ones."""
    group_start: Index
    """(s + 1,) the first column of each group."""
    before: Index
    """(k,) of the boxes of a column up to this one, the one that reaches furthest along y."""
    after: Index
    """(k,) of the boxes of a column from this one on, the one that begins first along y."""
    near_start: Index
    """(k + 1,) where the boxes around begin, in `near`."""
    near: Index
    """Boxes of the same group that may be nearer where one is taken for the nearest: of a turned
    one, those in its cell and the eight around; of a straight one, those in its cell
    and the two beside it along y that reach further to a side."""


class Lines(NamedTuple):
    """Lines of a field along x, one for each y."""

    x: float
    """m, where they begin."""
    y: float
    """m, of the first line."""
    size: float
    """m between two lines, and between two points of one."""
    cap: float
    """m, the greatest distance of interest."""


class Envelope(NamedTuple):
    """Room for the parabolas (x - foot)² + base of one line."""

    foot: Array
    base: Array
    box: Index
    begin: Array
    """From where on each is the least."""

    @classmethod
    def for_boxes(cls, boxes: BoxesByHeight) -> Envelope:
        """For the widest group, four for each of its columns."""
        room = 4 * int(np.max(np.diff(boxes.group_start), initial=0))
        return cls(np.empty(room), np.empty(room), np.empty(room, np.int32), np.empty(room))


def boxes_by_height(
    outlines: Outlines, cells: Index, bottoms: Array, ends: Array, origin_z: float, rise: float
) -> BoxesByHeight:
    """Sort boxes for `nearest_on_line`.

    Args:
        outlines: of k boxes.
        cells: (k, 2) number of their cells along x and y.
        bottoms: (k,) z of their lower faces.
        ends: (k,) z up to which each of them counts, none below `origin_z`.
        origin_z: of the lowest level.
        rise: height of a slab.
    """
    slab = np.floor((ends - origin_z) / rise).astype(np.int64)
    x, y = (cells - cells.min(axis=0, initial=0)).T.astype(np.int64)
    covered = _covered(slab, ends - bottoms <= rise, x, y)
    ends = np.where(covered, origin_z + slab * rise, ends)
    slab -= covered
    group = 2 * slab + (outlines.counts > 0)
    width, depth = (int(np.max(number, initial=0)) + 1 for number in (x, y))
    cell = (group * width + x) * depth + y
    order = np.argsort(cell, kind="stable")
    _highest_first(order, cell, ends, bottoms)
    column_start = _starts((group * width + x)[order])
    first_in_column = order[column_start[:-1]]
    group_start = _starts(group[first_in_column])
    outlines = outlines.of_rows(order)
    place, column = cells[order, 1].astype(np.int32), cells[first_in_column, 0].astype(np.int32)
    end = _highest_around((ends - origin_z - slab * rise)[order], slab[order], x[order], y[order])
    before, after = _first_and_last(outlines.bounds, column_start)
    near_start, near = _boxes_around(
        outlines.counts[column_start[group_start[:-1]]] > 0,
        outlines.bounds,
        place,
        column,
        column_start,
        group_start,
    )
    return BoxesByHeight(
        outlines,
        bottoms[order] - origin_z,
        end,
        place,
        column,
        column_start,
        slab[first_in_column[group_start[:-1]]].astype(np.int32),
        group_start,
        before,
        after,
        near_start,
        near,
    )


def _starts(sorted_keys: npt.NDArray[np.int64]) -> Index:
    """Where each of the sorted keys begins, and how many they are."""
    first = np.flatnonzero(np.append(True, np.diff(sorted_keys) != 0)[: len(sorted_keys)])
    return np.append(first, len(sorted_keys)).astype(np.int32)


@kernel(nogil=True)
def _highest_first(
    order: npt.NDArray[np.int64], cell: npt.NDArray[np.int64], ends: Array, bottoms: Array
) -> None:
    """Of what is ordered by cell, put first in each cell what reaches furthest up, then down."""
    for n in range(1, len(order)):
        e, at = order[n], n
        while at > 0 and cell[order[at - 1]] == cell[e]:
            q = order[at - 1]
            if ends[q] > ends[e] or (ends[q] == ends[e] and bottoms[q] <= bottoms[e]):
                break
            order[at] = q
            at -= 1
        order[at] = e


@kernel(nogil=True)
def _covered(
    slab: npt.NDArray[np.int64],
    flat: npt.NDArray[np.bool_],
    x: npt.NDArray[np.int64],
    y: npt.NDArray[np.int64],
) -> npt.NDArray[np.bool_]:
    """(k,) of the boxes that are not flat, those with a flat one that ends in their slab in their
    cell or the eight around; none in slab 0."""
    k = len(slab)
    width, depth, high = 0, 0, np.int64(0)
    for e in range(k):
        width, depth, high = max(width, x[e] + 1), max(depth, y[e] + 1), max(high, slab[e] + 1)
    start = np.zeros(high + 1, np.int64)
    for e in range(k):
        start[slab[e] + 1] += 1
    for s in range(high):
        start[s + 1] += start[s]
    order, place = np.empty(k, np.int64), start.copy()
    for e in range(k):
        order[place[slab[e]]] = e
        place[slab[e]] += 1
    of_slab = np.full((width + 2, depth + 2), -1, np.int64)
    covered = np.zeros(k, np.bool_)
    for s in range(1, high):
        for n in range(start[s], start[s + 1]):
            if flat[order[n]]:
                of_slab[x[order[n]] + 1, y[order[n]] + 1] = s
        for n in range(start[s], start[s + 1]):
            e = order[n]
            for i in range(x[e], x[e] + 3):
                for j in range(y[e], y[e] + 3):
                    covered[e] = covered[e] or (not flat[e] and of_slab[i, j] == s)
    return covered


@kernel(nogil=True)
def _highest_around(
    end: Array, slab: npt.NDArray[np.int64], x: npt.NDArray[np.int64], y: npt.NDArray[np.int64]
) -> Array:
    """(k,) the greatest end in the cell of each box, and the eight around, among those of its slab;
    its own where something there ends in the next slab.

    Args:
        slab: ascending.
        x, y: of the boxes' cells, from 0 on.
    """
    k = len(end)
    width, depth = 0, 0
    for e in range(k):
        width, depth = max(width, x[e] + 1), max(depth, y[e] + 1)
    greatest = np.empty((width + 2, depth + 2))
    of_slab = np.full((width + 2, depth + 2), -2, np.int64)
    goes_on = np.empty(k, np.bool_)
    highest = end.copy()
    last = k
    while last > 0:
        first = last - 1
        while first > 0 and slab[first - 1] == slab[last - 1]:
            first -= 1
        now = slab[first]
        for e in range(first, last):
            goes_on[e] = False
            for i in range(x[e], x[e] + 3):
                for j in range(y[e], y[e] + 3):
                    goes_on[e] = goes_on[e] or of_slab[i, j] == now + 1
        for e in range(first, last):
            i, j = x[e] + 1, y[e] + 1
            if of_slab[i, j] != now or greatest[i, j] < end[e]:
                of_slab[i, j], greatest[i, j] = now, end[e]
        for e in range(first, last):
            if goes_on[e]:
                continue
            for i in range(x[e], x[e] + 3):
                for j in range(y[e], y[e] + 3):
                    if of_slab[i, j] == now:
                        highest[e] = max(highest[e], greatest[i, j])
        last = first
    return highest


@kernel(nogil=True)
def _first_and_last(bounds: Array, column_start: Index) -> tuple[Index, Index]:
    """`before` and `after` of boxes of those bounds (k, 4)."""
    before, after = np.empty(len(bounds), np.int32), np.empty(len(bounds), np.int32)
    for c in range(len(column_start) - 1):
        first, last = column_start[c], column_start[c + 1]
        for e in range(first, last):
            further = e == first or bounds[before[e - 1], 3] < bounds[e, 3]
            before[e] = e if further else before[e - 1]
        for e in range(last - 1, first - 1, -1):
            sooner = e + 1 == last or bounds[after[e + 1], 1] >= bounds[e, 1]
            after[e] = e if sooner else after[e + 1]
    return before, after


@kernel(nogil=True)
def _boxes_around(
    turned: npt.NDArray[np.bool_],
    bounds: Array,
    place: Index,
    column: Index,
    column_start: Index,
    group_start: Index,
) -> tuple[Index, Index]:
    """`near_start` and `near`, of straight and of `turned` (s,) groups; boxes have
    those bounds (k, 4)."""
    near_start = np.zeros(len(place) + 1, np.int32)
    near = np.empty(0, np.int32)
    for counted in (False, True):
        found = 0
        for s in range(len(group_start) - 1):
            first, last = group_start[s], group_start[s + 1]
            for c in range(first, last):
                for e in range(column_start[c], column_start[c + 1]):
                    for d in range(max(c - 1, first), min(c + 2, last)):
                        if abs(column[d] - column[c]) > (1 if turned[s] else 0):
                            continue
                        begin, end = column_start[d], column_start[d + 1]
                        begin = _bisected(place, begin, end, place[e] - 1)
                        end = _bisected(place, begin, end, place[e] + 2)
                        for q in range(begin, end):
                            further = bounds[q, 0] < bounds[e, 0] - _APART
                            further = further or bounds[q, 2] > bounds[e, 2] + _APART
                            if q == e or not (turned[s] or further):
                                continue
                            if counted:
                                near[found] = q
                            found += 1
                    near_start[e + 1] = found
        if not counted:
            near = np.empty(found, np.int32)
    return near_start, near


@kernel(lean=True)
def _bisected(place: Index, first: int, last: int, least: int) -> int:
    """The first box from `first` up to `last` whose place is at least so much."""
    while first < last:
        middle = (first + last) // 2
        if place[middle] < least:
            first = middle + 1
        else:
            last = middle
    return first


@kernel(lean=True)
def nearest_on_line(
    boxes: BoxesByHeight,
    group: int,
    line: int,
    lines: Lines,
    next_box: Index,
    room: Envelope,
    begin: int,
    nearest: Index,
    squared: Field,
) -> None:
    """Box of a group nearest to each of some points of a line, and the squared distance to it.

    Per column of cells along y, the nearest box before and after the line; then, along x, the
    lower envelope of the squared distances to these boxes (P. Felzenszwalb and D. Huttenlocher,
    Distance transforms of sampled functions, 2012). From there on to boxes in the cells around
    that are nearer.

    Args:
        line: its number; lines are to be asked for in ascending order.
        next_box: (c,) the first box of each column that lies behind the line before; kept up here.
        begin: the first of these points; they follow each other.
        nearest: (n,), -1 where there is none within the cap of the line.
        squared: (n,), m², infinite where there is none within the cap of the line.
    """
    y = lines.y + line * lines.size
    n = 0
    for c in range(boxes.group_start[group], boxes.group_start[group + 1]):
        at, last = next_box[c], boxes.column_start[c + 1]
        while at < last and boxes.place[at] < line:
            at += 1
        next_box[c] = at
        before = boxes.before[at - 1] if at > boxes.column_start[c] else -1
        after = boxes.after[at] if at < last else -1
        n = _add_column(boxes, c, before, after, y, lines, room, n)
    n = _lower_envelope(room.foot, room.base, room.box, room.begin, n)
    _along_line(room, n, lines, begin, nearest, squared)
    start, cap = boxes.outlines.start, lines.cap * lines.cap
    first = boxes.column_start[boxes.group_start[group]]
    last = boxes.column_start[boxes.group_start[group + 1]]
    if boxes.near_start[last] > boxes.near_start[first] or start[last] > start[first]:
        for i in range(len(nearest)):
            r = nearest[i]
            if squared[i] < cap and (
                boxes.near_start[r + 1] > boxes.near_start[r] or start[r + 1] > start[r]
            ):
                x = lines.x + (begin + i) * lines.size
                nearest[i], squared[i] = _nearest_outline(boxes, r, x, y)


@kernel(lean=True)
def _along_line(
    room: Envelope, count: int, lines: Lines, begin: int, nearest: Index, squared: Field
) -> None:
    """The least of the first parabolas of an envelope at points of a line, and its box."""
    i, nx = 0, len(nearest)
    for at in range(count):
        last = nx
        if at + 1 < count:
            end = math.ceil((room.begin[at + 1] - lines.x) / lines.size)
            last = int(min(max(end - begin, i), nx))
        foot, base, box = lines.x - room.foot[at], room.base[at], room.box[at]
        for k in range(i, last):
            off = foot + (begin + k) * lines.size
            squared[k] = off * off + base
            nearest[k] = box
        i = last
    for k in range(i, nx):
        squared[k] = np.inf
        nearest[k] = -1


@kernel(inline=True)
def _add_column(
    boxes: BoxesByHeight,
    column: int,
    before: int,
    after: int,
    y: float,
    lines: Lines,
    room: Envelope,
    n: int,
) -> int:
    """Add the parabolas of a column's boxes before and after a line, -1 for none, by their feet.

    A box is two parabolas with their feet at its ends: the left one counts left of the column's
    cells, the right one right of them; where that of the other box is less all the way up to the
    cap, it is left out.

    Returns:
        how many parabolas there are now, `n` before.
    """
    foot, base, box = room.foot, room.base, room.box
    a = b = np.inf
    if before >= 0:
        a = max(boxes.outlines.bounds[before, 1] - y, 0.0, y - boxes.outlines.bounds[before, 3])
    if after >= 0:
        b = max(boxes.outlines.bounds[after, 1] - y, 0.0, y - boxes.outlines.bounds[after, 3])
    left = lines.x + boxes.column[column] * lines.size
    first = n
    for side in range(2):
        r, q, gap, other = (before, after, a, b) if side == 0 else (after, before, b, a)
        if not gap < lines.cap:
            continue
        for end in range(2):
            if end == 0:
                at, of_other = boxes.outlines.bounds[r, 0], boxes.outlines.bounds[q, 0]
                off, off_other = at - left, of_other - left
            else:
                at, of_other = boxes.outlines.bounds[r, 2], boxes.outlines.bounds[q, 2]
                off, off_other = left + lines.size - at, left + lines.size - of_other
            if other < lines.cap and _is_beaten(off, gap, off_other, other, side, lines.cap):
                continue
            s = n - 1
            while s >= first and foot[s] > at:
                foot[s + 1], base[s + 1], box[s + 1] = foot[s], base[s], box[s]
                s -= 1
            foot[s + 1], base[s + 1], box[s + 1] = at, gap * gap, r
            n += 1
    return n


@kernel(inline=True)
def _is_beaten(
    off: float, gap: float, off_other: float, gap_other: float, side: int, cap: float
) -> bool:
    """Whether another parabola is less from 0 to the cap; of two that are the same, the first is.

    Args:
        off, off_other: how far beyond 0 their feet lie.
        gap, gap_other: roots of their bases.
        side: 0 for the first, 1 for the second.
    """
    base, base_other = gap * gap, gap_other * gap_other
    near = off * off + base - off_other * off_other - base_other
    far = (cap + off) ** 2 + base - (cap + off_other) ** 2 - base_other
    return near >= 0.0 and far >= 0.0 and (side == 1 or near > 0.0 or far > 0.0)


@kernel(lean=True)
def _lower_envelope(foot: Array, base: Array, box: Index, begin: Array, count: int) -> int:
    """Keep of the parabolas (x - foot)² + base, sorted by foot, those least somewhere.

    Returns:
        Their number n; from begin[i] to begin[i + 1] the least is i.
    """
    n = 0
    for t in range(count):
        x, a = foot[t], base[t]
        start = -np.inf
        keep = True
        while n > 0:
            width = x - foot[n - 1]
            if width <= 0.0:
                keep = a < base[n - 1]
                if not keep:
                    break
            else:
                # where the new one crosses the last
                start = 0.5 * ((a - base[n - 1]) / width + x + foot[n - 1])
                if start > begin[n - 1]:
                    break
            n -= 1
            start = -np.inf
        if keep:
            foot[n], base[n], box[n], begin[n] = x, a, box[t], start
            n += 1
    return n


@kernel(inline=True)
def _nearest_outline(boxes: BoxesByHeight, r: int, x: float, y: float) -> tuple[int, float]:
    """From box r on to those in the cells around, as long as their outlines are nearer to a point;
    with the squared distance."""
    least = _aside(boxes, r, x, y, np.inf)
    for _step in range(_STEPS):
        best = r
        for at in range(boxes.near_start[r], boxes.near_start[r + 1]):
            squared = _aside(boxes, boxes.near[at], x, y, least)
            if squared < least:
                best, least = boxes.near[at], squared
        if best == r:
            break
        r = best
    return r, least


@kernel(inline=True)
def _aside(boxes: BoxesByHeight, r: int, x: float, y: float, least: float) -> float:
    """Squared distance in x and y from a point to box r, or to the outline of its points where the
    box alone is nearer than `least`."""
    dx = max(boxes.outlines.bounds[r, 0] - x, 0.0, x - boxes.outlines.bounds[r, 2])
    dy = max(boxes.outlines.bounds[r, 1] - y, 0.0, y - boxes.outlines.bounds[r, 3])
    squared = dx * dx + dy * dy
    outlines = boxes.outlines
    if squared >= least or outlines.start[r] == outlines.start[r + 1]:
        return squared
    return aside(outlines.start, outlines.corners, r, x, y)
