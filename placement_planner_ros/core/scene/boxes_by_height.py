"""The boxes that count for the clearance, sorted by where they end."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.outlines import Outlines
from placement_planner_ros.core.scene.slab_ends import ends_in_slabs
from placement_planner_ros.core.types import Array

Index = npt.NDArray[np.int32]

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
    """(k,) how far above the lower level of their slab they end, see `ends_in_slabs`."""
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


def boxes_by_height(
    outlines: Outlines, cells: Index, bottoms: Array, ends: Array, origin_z: float, rise: float
) -> BoxesByHeight:
    """Sort boxes for `nearest_boxes`.

    Args:
        outlines: of k boxes.
        cells: (k, 2) number of their cells along x and y.
        bottoms: (k,) z of their lower faces.
        ends: (k,) z up to which each of them counts, none below `origin_z`.
        origin_z: of the lowest level.
        rise: height of a slab.
    """
    x, y = (cells - cells.min(axis=0, initial=0)).T.astype(np.int64)
    slab, end = ends_in_slabs(x, y, bottoms - origin_z, ends - origin_z, rise)
    group = 2 * slab + (outlines.counts > 0)
    width, depth = (int(np.max(number, initial=0)) + 1 for number in (x, y))
    cell = (group * width + x) * depth + y
    order = np.argsort(cell, kind="stable")
    _highest_first(order, cell, end, bottoms)
    column_start = _starts((group * width + x)[order])
    first_in_column = order[column_start[:-1]]
    group_start = _starts(group[first_in_column])
    outlines = outlines.of_rows(order)
    place, column = cells[order, 1].astype(np.int32), cells[first_in_column, 0].astype(np.int32)
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
        end[order],
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
