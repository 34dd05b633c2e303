"""Of the boxes that end at one height, the one nearest in x and y to each point of a line."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.boxes_by_height import BoxesByHeight
from placement_planner_ros.core.scene.outlines import aside
from placement_planner_ros.core.types import Array

Field = npt.NDArray[np.float32]
Index = npt.NDArray[np.int32]

_STEPS = 8
"""Boxes to go at most from the one that is taken for the nearest to nearer ones."""


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
