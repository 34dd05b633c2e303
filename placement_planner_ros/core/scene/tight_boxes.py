"""Tight boxes around the points of each cell, one per surface, closed over gaps between cells."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.binning import Bins
from placement_planner_ros.core.types import Array

Index = npt.NDArray[np.int32]

_WORTH_CUTTING = 0.6
"""A cell is cut where its boxes fill less than this share of the single box around its points."""


class TightBoxes(NamedTuple):
    """m boxes; see `ObstacleSet` for the fields."""

    cells: Index
    lower: Array
    upper: Array
    next: Index
    surface_height: Array
    surface_extent: Array
    surface_first: npt.NDArray[np.int64]
    surface_points: npt.NDArray[np.float32]
    first_point: npt.NDArray[np.int64]
    points: npt.NDArray[np.float32]


def tight_boxes(bins: Bins, skin: float, max_boxes: int, band: float) -> TightBoxes:
    """Box the points of each cell.

    Where the box around all points of a cell is thick in every direction, the side of it that
    holds most points within `skin` is cut off as a box of its own, and so on with the rest, at
    most `max_boxes` in all. The cut is used if it leaves out a good part of the volume: floor and
    wall become two boxes, a slope or a blob stays one.

    Args:
        bins: `number_at` is rewritten to one more than the first box of each cell.
        skin: thickness of one level surface, metres.
        band: points so far below the top of a box are of the surface on it, metres.
    """
    thick = _count_thick(bins.points, bins.start, skin)
    return TightBoxes(*_tight_boxes(bins, skin, max_boxes, thick * (max_boxes - 1), band))


@kernel(nogil=True)
def _count_thick(points: Array, start: npt.NDArray[np.int64], skin: float) -> int:
    """How many cells hold points that spread by more than `skin` along every axis."""
    thick = 0
    for r in range(len(start) - 1):
        flat = False
        for a in range(3):
            low, high = np.inf, -np.inf
            for p in range(start[r], start[r + 1]):
                low, high = min(low, points[p, a]), max(high, points[p, a])
            flat = flat or high - low <= skin
        thick += not flat
    return thick


@kernel(lean=True)
def _bound_points(points: Array, rows: npt.NDArray[np.int64], count: int, box: Array) -> None:
    """`box` (2, 3): the tight box around points[rows[:count]]."""
    for a in range(3):
        box[0, a], box[1, a] = np.inf, -np.inf
    for i in range(count):
        for a in range(3):
            value = points[rows[i], a]
            box[0, a] = min(box[0, a], value)
            box[1, a] = max(box[1, a], value)


@kernel(lean=True)
def _box_volume(box: Array, skin: float) -> float:
    """Volume, each side counted as at least `skin`."""
    volume = 1.0
    for a in range(3):
        volume *= max(box[1, a] - box[0, a], skin)
    return volume


@kernel()
def _fullest_side(
    points: Array, rows: npt.NDArray[np.int64], count: int, box: Array, skin: float
) -> tuple[int, int]:
    """The side (axis, 0 low or 1 high) of the box with most points within `skin` of it.

    Upright sides first where equal: the rows of points on two walls of one cell are no floors.
    """
    hits = np.zeros((3, 2), np.int64)
    for i in range(count):
        for a in range(3):
            value = points[rows[i], a]
            if value <= box[0, a] + skin:
                hits[a, 0] += 1
            if value >= box[1, a] - skin:
                hits[a, 1] += 1
    axis, side = 0, 0
    for a in range(3):
        for s in range(2):
            if hits[a, s] > hits[axis, side]:
                axis, side = a, s
    return axis, side


@kernel(lean=True)
def _is_flat(box: Array, skin: float) -> bool:
    """Whether a box (2, 3) is no thicker than one surface in some direction."""
    return (
        box[1, 0] - box[0, 0] <= skin
        or box[1, 1] - box[0, 1] <= skin
        or box[1, 2] - box[0, 2] <= skin
    )


@kernel(lean=True)
def _measure_surface(
    points: Array, rows: npt.NDArray[np.int64], count: int, top: float, skin: float, extent: Array
) -> float:
    """Mean height of the points within `skin` of the top; `extent` (8,) bounds them."""
    for a in range(0, 8, 2):
        extent[a], extent[a + 1] = np.inf, -np.inf
    total, number = 0.0, 0
    for i in range(count):
        x, y, z = points[rows[i], 0], points[rows[i], 1], points[rows[i], 2]
        if z < top - skin:
            continue
        total += z - top
        number += 1
        extent[0], extent[1] = min(extent[0], x), max(extent[1], x)
        extent[2], extent[3] = min(extent[2], y), max(extent[3], y)
        extent[4], extent[5] = min(extent[4], x + y), max(extent[5], x + y)
        extent[6], extent[7] = min(extent[6], x - y), max(extent[7], x - y)
    return top + total / number


@kernel(lean=True)
def _take_side(
    points: Array,
    rows: npt.NDArray[np.int64],
    count: int,
    box: Array,
    axis: int,
    side: int,
    skin: float,
    spill: npt.NDArray[np.int64],
) -> int:
    """Put those of rows[:count] first whose points lie within `skin` of a side of the box.

    The order is kept otherwise. Returns how many there are.
    """
    taken = 0
    spilled = 0
    for i in range(count):
        value = points[rows[i], axis]
        if (side == 0 and value <= box[0, axis] + skin) or (
            side == 1 and value >= box[1, axis] - skin
        ):
            rows[taken] = rows[i]
            taken += 1
        else:
            spill[spilled] = rows[i]
            spilled += 1
    for i in range(spilled):
        rows[taken + i] = spill[i]
    return taken


@kernel(nogil=True)
def _cut_box(
    points: Array,
    rows: npt.NDArray[np.int64],
    count: int,
    whole: Array,
    skin: float,
    max_boxes: int,
    spill: npt.NDArray[np.int64],
    boxes: Array,
    ends: npt.NDArray[np.int64],
) -> int:
    """Cut the points of one cell, rows[:count], as `tight_boxes` says; returns into how many boxes.

    Args:
        whole: (2, 3) the box around all.
        boxes: (max_boxes, 2, 3), filled; box i is that of rows[ends[i]:ends[i + 1]].
    """
    number = 0
    volume = 0.0
    rest = whole.copy()
    ends[0] = 0
    while True:
        # the last box takes all that is left
        first = ends[number]
        left = count - first
        if number + 1 == max_boxes or _is_flat(rest, skin):
            boxes[number] = rest
            ends[number + 1] = count
            volume += _box_volume(rest, skin)
            number += 1
            break
        # cut off the fullest side
        axis, side = _fullest_side(points, rows[first:], left, rest, skin)
        taken = _take_side(points, rows[first:], left, rest, axis, side, skin, spill)
        _bound_points(points, rows[first:], taken, boxes[number])
        volume += _box_volume(boxes[number], skin)
        number += 1
        ends[number] = first + taken
        if taken == left:
            break
        _bound_points(points, rows[first + taken :], left - taken, rest)
    if volume <= _WORTH_CUTTING * _box_volume(whole, skin):
        return number
    boxes[0] = whole
    ends[1] = count
    return 1


@kernel(nogil=True)
def _tight_boxes(
    bins: Bins, skin: float, max_boxes: int, spare: int, band: float
) -> tuple[
    Index,
    Array,
    Array,
    Index,
    Array,
    Array,
    npt.NDArray[np.int64],
    npt.NDArray[np.float32],
    npt.NDArray[np.int64],
    npt.NDArray[np.float32],
]:
    """The fields of `TightBoxes`, which `spare` more boxes than cells have room for."""
    points, start, cells = bins.points, bins.start, bins.cells
    room = len(cells) + spare
    box_cells = np.empty((room, 3), np.int32)
    lower = np.empty((room, 3))
    upper = np.empty((room, 3))
    following = np.full(room, -1, np.int32)
    height = np.empty(room)
    extent = np.empty((room, 8))
    top_first = np.zeros(room + 1, np.int64)
    top_points = np.empty((len(points), 2), np.float32)
    tops = 0
    first_point = np.zeros(room + 1, np.int64)
    grouped = np.empty((len(points), 3), np.float32)
    placed = 0
    longest = 0
    for r in range(len(cells)):
        longest = max(longest, start[r + 1] - start[r])
    ordered = np.empty(longest, np.int64)
    spill = np.empty(longest, np.int64)
    whole = np.empty((2, 3))
    boxes = np.empty((4, 2, 3))
    ends = np.empty(5, np.int64)
    m = 0
    for r in range(len(cells)):
        count = start[r + 1] - start[r]
        for i in range(count):
            ordered[i] = start[r] + i
        _bound_points(points, ordered, count, whole)
        if max_boxes > 1 and not _is_flat(whole, skin):
            number = _cut_box(points, ordered, count, whole, skin, max_boxes, spill, boxes, ends)
        else:
            number = 1
            boxes[0] = whole
            ends[0], ends[1] = 0, count
        bins.number_at[cells[r, 0], cells[r, 1], cells[r, 2]] = m + 1
        for part in range(number):
            box_cells[m] = cells[r]
            lower[m] = boxes[part, 0]
            upper[m] = boxes[part, 1]
            if part + 1 < number:
                following[m] = m + 1
            first, last = ends[part], ends[part + 1]
            height[m] = _measure_surface(
                points, ordered[first:], last - first, upper[m, 2], skin, extent[m]
            )
            for i in range(first, last):
                for a in range(3):
                    grouped[placed, a] = points[ordered[i], a]
                placed += 1
                if points[ordered[i], 2] >= upper[m, 2] - band:
                    top_points[tops, 0] = points[ordered[i], 0]
                    top_points[tops, 1] = points[ordered[i], 1]
                    tops += 1
            m += 1
            top_first[m] = tops
            first_point[m] = placed
    return (
        box_cells[:m].copy(),
        lower[:m].copy(),
        upper[:m].copy(),
        following[:m].copy(),
        height[:m].copy(),
        extent[:m].copy(),
        top_first[: m + 1].copy(),
        top_points[:tops].copy(),
        first_point[: m + 1].copy(),
        grouped,
    )


@kernel(lean=True)
def _axis_gap(lower: Array, upper: Array, p: int, q: int, axis: int) -> float:
    """How far apart boxes p and q are along an axis; negative where they overlap."""
    return max(lower[p, axis] - upper[q, axis], lower[q, axis] - upper[p, axis])


@kernel(lean=True)
def _one_surface(
    lower: Array, upper: Array, p: int, q: int, axis: int, skin: float, cell_size: float
) -> bool:
    """Whether boxes p and q, neighbours along `axis`, belong to one surface that p goes on along.

    Either both are flat in the same other direction and at one level, or both overlap (nearly) in
    both other directions and p is no thin sheet across `axis`.
    """
    b, c = (axis + 1) % 3, (axis + 2) % 3
    if axis == 0:
        b, c = 1, 2
    gap_b, gap_c = _axis_gap(lower, upper, p, q, b), _axis_gap(lower, upper, p, q, c)
    wide = 0.5 * cell_size
    for flat in (b, c):
        level, along = (gap_b, gap_c) if flat == b else (gap_c, gap_b)
        if (
            level <= skin
            and along <= wide
            and upper[p, flat] - lower[p, flat] <= 2.0 * skin
            and upper[q, flat] - lower[q, flat] <= 2.0 * skin
        ):
            return True
    if upper[p, axis] - lower[p, axis] <= 0.2 * cell_size:
        return False
    for other in (b, c):
        gap = gap_b if other == b else gap_c
        size_p = upper[p, other] - lower[p, other]
        size_q = upper[q, other] - lower[q, other]
        if gap > max(skin, 0.25 * min(size_p, size_q)):
            return False
    return True


@kernel(nogil=True)
def close_gaps(
    boxes: TightBoxes, number_at: Index, origin: Array, cell_size: float, skin: float
) -> tuple[Array, Array]:
    """Extend boxes of one surface in neighbouring cells to the face between these cells.

    Returns:
        (m, 3), (m, 3) new lower and upper corners. A side without neighbour is left as measured.
    """
    cells, lower, upper = boxes.cells, boxes.lower, boxes.upper
    m = len(cells)
    shape = number_at.shape
    new_lower = lower.copy()
    new_upper = upper.copy()
    cell = np.empty(3, np.int64)
    for p in range(m):
        for axis in range(3):
            b, c = (axis + 1) % 3, (axis + 2) % 3
            for side in range(-1, 2, 2):
                cell[axis] = cells[p, axis] + side
                if cell[axis] < 0 or cell[axis] >= shape[axis]:
                    continue
                closed = False
                # straight ahead first, then the cells beside it
                for turn in range(9):
                    cell[b] = cells[p, b] + (0, 1, -1)[turn % 3]
                    cell[c] = cells[p, c] + (0, 1, -1)[turn // 3]
                    if cell[b] < 0 or cell[b] >= shape[b] or cell[c] < 0 or cell[c] >= shape[c]:
                        continue
                    q = number_at[cell[0], cell[1], cell[2]] - 1
                    while q >= 0 and not closed:
                        closed = _one_surface(lower, upper, p, q, axis, skin, cell_size)
                        q = boxes.next[q]
                    if closed:
                        break
                if closed:
                    face = origin[axis] + (cells[p, axis] + (1 if side > 0 else 0)) * cell_size
                    if side > 0:
                        new_upper[p, axis] = max(face, upper[p, axis])
                    else:
                        new_lower[p, axis] = min(face, lower[p, axis])
    return new_lower, new_upper
