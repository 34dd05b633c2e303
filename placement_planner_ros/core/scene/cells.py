"""Points sorted into the cells of a grid, and tight boxes around those of each cell.

Where the box around all points of a cell is thick in every direction, the side of it that holds
most points is cut off as a box of its own, and so on with the rest: floor and wall become two
boxes, a slope or a blob stays one. Boxes of one surface are closed over the gap to the neighbouring
cell, up to the face the two cells share; nothing grows where no neighbour is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.types import Array, Index, Index32
from placement_planner_ros.core.uncounted import Uncounted


class Bins(NamedTuple):
    """Points sorted by cell.

    Attributes:
        points: (n, 3), those of one cell next to each other.
        start: (m + 1,) first point of each occupied cell, and n.
        cells: (m, 3) int32 occupied cells in lexicographic order.
        number_at: (nx, ny, nz) int32, one more than the cell's row in `cells`, or 0. Most of it is
            memory that nobody has touched, and so takes neither time nor room.
    """

    points: Array
    start: Index
    cells: Index32
    number_at: Index32


class CellBoxes(NamedTuple):
    """m boxes; see `ObstacleSet` for the fields."""

    cells: Index32
    lower: Array
    upper: Array
    next: Index32
    first_point: Index
    points: npt.NDArray[np.float32]


@njit(cache=True, nogil=True)
def sort_into_cells(
    points: Array, origin: Array, cell_size: float, lower: Array, upper: Array, number_at: Index32
) -> tuple[Array, Index, Index32]:
    """A counting sort of those (n, 3) points that are finite and within the bounds, both ends
    included: the fields of `Bins`; of these, `number_at` (nx, ny, nz), all 0, is filled."""
    nx, ny, nz = number_at.shape
    # read once: writing into arrays might change others, for all that the compiler knows
    (x0, y0, z0), (x1, y1, z1), (ox, oy, oz) = lower, upper, origin
    # how many points each cell holds; `cell_of` remembers which
    n = len(points)
    cell_of = np.empty(n, np.int32)
    flat = number_at.reshape(-1)
    column_used = np.zeros((nx, ny), np.bool_)
    occupied = kept = last_z = 0
    first_z = nz
    for i in range(n):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if not (x0 <= x <= x1 and y0 <= y <= y1 and z0 <= z <= z1):  # also where one is NaN
            cell_of[i] = -1
            continue
        # its cell, the last one where it lies on the grid's upper face
        ix = min(int((x - ox) / cell_size), nx - 1)
        iy = min(int((y - oy) / cell_size), ny - 1)
        iz = min(int((z - oz) / cell_size), nz - 1)
        cell = (ix * ny + iy) * nz + iz
        cell_of[i] = cell
        kept += 1
        # the first point of a cell: note its column and its layer
        if flat[cell] == 0:
            occupied += 1
            column_used[ix, iy] = True
            first_z, last_z = min(first_z, iz), max(last_z, iz)
        flat[cell] += 1
    # number the occupied cells in their order; each begins where the one before ends
    cells = np.empty((occupied, 3), np.int32)
    start = np.zeros(occupied + 1, np.int64)
    row = 0
    for ix in range(nx):
        for iy in range(ny):
            if not column_used[ix, iy]:
                continue  # memory that nobody has touched
            for iz in range(first_z, last_z + 1):
                count = number_at[ix, iy, iz]
                if count > 0:
                    cells[row, 0], cells[row, 1], cells[row, 2] = ix, iy, iz
                    start[row + 1] = start[row] + count
                    row += 1
                    number_at[ix, iy, iz] = row
    # put every point behind those of its cell that are already there
    fill = start[:-1].copy()
    kept_points = np.empty((kept, 3))
    for i in range(n):
        if cell_of[i] >= 0:
            row = flat[cell_of[i]] - 1
            to = fill[row]
            fill[row] += 1
            for a in range(3):
                kept_points[to, a] = points[i, a]
    return kept_points, start, cells


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _bound_points(points: Array, rows: Index, skin: float, box: Array) -> tuple[float, bool]:
    """`box` (2, 3): the tight box around points[rows].

    Returns:
        Its volume, each side counted as at least `skin`; whether some side is no thicker than that.
    """
    volume, flat = 1.0, False
    for a in range(3):
        low, high = np.inf, -np.inf
        for row in rows:
            low, high = min(low, points[row, a]), max(high, points[row, a])
        box[0, a], box[1, a] = low, high
        volume *= max(high - low, skin)
        flat = flat or high - low <= skin
    return volume, flat


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _cut_off(points: Array, rows: Index, box: Array, skin: float, spill: Index) -> int:
    """Put those of `rows` first whose points lie within `skin` of the fullest side of their box.

    The order is kept otherwise. Returns how many there are. Upright sides come first where equal:
    the rows of points on two walls of one cell are no floors.
    """
    # the side with most points
    best, axis, high = 0, 0, False
    for a in range(3):
        for side in range(2):
            # how many points are within the skin of it
            hits = 0
            for row in rows:
                away = points[row, a] - box[0, a] if side == 0 else box[1, a] - points[row, a]
                hits += away <= skin
            if hits > best:
                best, axis, high = hits, a, side == 1
    # theirs first, then the others
    taken = spilled = 0
    for row in rows:
        away = box[1, axis] - points[row, axis] if high else points[row, axis] - box[0, axis]
        if away <= skin:
            rows[taken] = row
            taken += 1
        else:
            spill[spilled] = row
            spilled += 1
    # the others follow in their old order
    for i in range(spilled):
        rows[taken + i] = spill[i]
    return taken


@njit(cache=True, nogil=True)
def _cut_cell(
    points: Array, rows: Index, skin: float, max_boxes: int, spill: Index, boxes: Array, ends: Index
) -> int:
    """Cut the points of one cell, as the module says; returns into how many boxes.

    Args:
        rows: (k,) of its points, put into the order of their boxes.
        boxes: (max_boxes, 2, 3), filled; box i is that of rows[ends[i]:ends[i + 1]].
    """
    count = len(rows)
    # one box around all of them; what is flat stays so
    whole, flat = _bound_points(points, rows, skin, boxes[0])
    ends[0], ends[1] = 0, count
    if flat or max_boxes == 1:
        return 1
    number, volume, of_rest, left = 0, 0.0, whole, count
    while left > 0:
        # boxes[number] is around all that is left, of which the last box takes all
        if number + 1 == max_boxes or flat:
            volume += of_rest
            left = 0
        else:
            # the fullest side becomes a box of its own
            rest = rows[count - left :]
            taken = _cut_off(points, rest, boxes[number], skin, spill)
            volume += _bound_points(points, rest[:taken], skin, boxes[number])[0]
            left -= taken
        number += 1
        ends[number] = count - left
        # the next box is around what remains
        if left > 0:
            of_rest, flat = _bound_points(points, rows[count - left :], skin, boxes[number])
    if volume <= 0.5 * whole:
        return number
    # not worth it where they fill more than half of the single box
    _bound_points(points, rows, skin, boxes[0])
    ends[1] = count
    return 1


@njit(cache=True, nogil=True)
def boxes_of_cells(
    bins: Bins, skin: float, max_boxes: int
) -> tuple[Index32, Array, Array, Index32, Index, npt.NDArray[np.float32]]:
    """The fields of `CellBoxes`: the points of each cell, in up to so many boxes.

    A cut is used if it leaves out a good part of the volume.

    Args:
        bins: `number_at` is rewritten to one more than the first box of each cell.
        skin: thickness of one level surface, metres.
    """
    points, start, cells = bins.points, bins.start, bins.cells
    # room for the most boxes that there can be
    room = len(cells) * max_boxes
    box_cells = np.empty((room, 3), np.int32)
    lower, upper = np.empty((room, 3)), np.empty((room, 3))
    following = np.full(room, np.int32(-1))
    first_point = np.zeros(room + 1, np.int64)
    grouped = np.empty((len(points), 3), np.float32)
    ordered, spill = np.arange(len(points)), np.empty(len(points), np.int64)
    boxes = np.empty((max_boxes, 2, 3))
    ends = np.empty(max_boxes + 1, np.int64)
    m = 0
    for r in range(len(cells)):
        rows = ordered[start[r] : start[r + 1]]
        number = _cut_cell(points, rows, skin, max_boxes, spill, boxes, ends)
        bins.number_at[cells[r, 0], cells[r, 1], cells[r, 2]] = m + 1
        # its boxes follow each other, and so do their points
        for part in range(number):
            for a in range(3):
                box_cells[m, a] = cells[r, a]
                lower[m, a], upper[m, a] = boxes[part, 0, a], boxes[part, 1, a]
            if part + 1 < number:
                following[m] = m + 1
            m += 1
            first_point[m] = start[r] + ends[part + 1]
    # the points in the order of their boxes
    for i in range(len(points)):
        for a in range(3):
            grouped[i, a] = points[ordered[i], a]
    return (
        box_cells[:m].copy(),
        lower[:m].copy(),
        upper[:m].copy(),
        following[:m].copy(),
        first_point[: m + 1].copy(),
        grouped,
    )


@njit(cache=True, nogil=True)
def close_gaps(
    boxes: CellBoxes, number_at: Index32, origin: Array, cell_size: float, skin: float
) -> tuple[Array, Array]:
    """Extend boxes of one surface in neighbouring cells to the face between these cells.

    Neighbours along an axis are of one surface where both are flat in the same other direction and
    at one level, or where they overlap (nearly) in both other directions and the box is thick along
    the axis, no thin sheet across it.

    Returns:
        (m, 3), (m, 3) new lower and upper corners. A side without neighbour is left as measured.
    """
    cells, lower, upper = boxes.cells, boxes.lower, boxes.upper
    shape, thin, half = number_at.shape, 2.0 * skin, 0.5 * cell_size
    new_lower, new_upper = lower.copy(), upper.copy()
    cell = np.empty(3, np.int64)
    for p in range(len(cells)):
        for axis in range(3):
            b, c = (axis + 1) % 3, (axis + 2) % 3
            low_b, high_b, low_c, high_c = lower[p, b], upper[p, b], lower[p, c], upper[p, c]
            size_b, size_c = high_b - low_b, high_c - low_c
            # across a thin sheet goes on what is flat in another direction, too, or nothing
            thick = upper[p, axis] - lower[p, axis] > 0.2 * cell_size
            if not (thick or min(size_b, size_c) <= thin):
                continue
            for side in range(-1, 2, 2):
                # the face on that side and the cell behind it
                face = origin[axis] + (cells[p, axis] + (side > 0)) * cell_size
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
                    # any box of that cell that is of the same surface closes the gap
                    q = number_at[cell[0], cell[1], cell[2]] - 1
                    while q >= 0 and not closed:
                        other_b, other_c = upper[q, b] - lower[q, b], upper[q, c] - lower[q, c]
                        # how far apart they are in both, negative where they overlap
                        gap_b = max(low_b - upper[q, b], lower[q, b] - high_b)
                        gap_c = max(low_c - upper[q, c], lower[q, c] - high_c)
                        # both flat in one direction, at one level, and near in the other
                        closed = (
                            max(size_b, other_b) <= thin and gap_b <= skin and gap_c <= half
                        ) or (max(size_c, other_c) <= thin and gap_c <= skin and gap_b <= half)
                        # or overlapping in both
                        closed = closed or (
                            thick
                            and gap_b <= max(skin, 0.25 * min(size_b, other_b))
                            and gap_c <= max(skin, 0.25 * min(size_c, other_c))
                        )
                        q = boxes.next[q]
                    if closed:
                        break
                # up to the face, and never inwards
                if closed and side > 0:
                    new_upper[p, axis] = max(face, upper[p, axis])
                elif closed:
                    new_lower[p, axis] = min(face, lower[p, axis])
    return new_lower, new_upper
