"""Sorting points into the cells of a grid."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.types import Array


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
    start: npt.NDArray[np.int64]
    cells: npt.NDArray[np.int32]
    number_at: npt.NDArray[np.int32]


def sort_into_cells(
    points: Array,
    origin: Array,
    cell_size: float,
    shape: tuple[int, int, int],
    lower: Array,
    upper: Array,
) -> Bins:
    """Sort the (n, 3) points that are finite and within the bounds (both ends included)."""
    number_at = np.zeros(shape, np.int32)
    sorted_points, start, cells = _sort_into_cells(
        points, origin, cell_size, lower, upper, number_at
    )
    return Bins(sorted_points, start, cells, number_at)


@kernel(nogil=True)
def _sort_into_cells(
    points: Array,
    origin: Array,
    cell_size: float,
    lower: Array,
    upper: Array,
    number_at: npt.NDArray[np.int32],
) -> tuple[Array, npt.NDArray[np.int64], npt.NDArray[np.int32]]:
    """A counting sort: the fields of `Bins`; `number_at` (nx, ny, nz), all 0, is filled."""
    nx, ny, nz = number_at.shape
    # How many points each cell holds; `cell_of` remembers which.
    n = len(points)
    cell_of = np.empty(n, np.int32)
    flat = number_at.reshape(-1)
    column_used = np.zeros((nx, ny), np.bool_)
    occupied = 0
    kept = 0
    first_x, first_y, first_z = nx, ny, nz  # of the occupied cells
    last_x, last_y, last_z = -1, -1, -1
    for i in range(n):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        inside = (
            x >= lower[0]
            and x <= upper[0]
            and y >= lower[1]
            and y <= upper[1]
            and z >= lower[2]
            and z <= upper[2]
        )
        if not inside:  # also where a coordinate is NaN
            cell_of[i] = -1
            continue
        ix = min(int((x - origin[0]) / cell_size), nx - 1)
        iy = min(int((y - origin[1]) / cell_size), ny - 1)
        iz = min(int((z - origin[2]) / cell_size), nz - 1)
        cell = (ix * ny + iy) * nz + iz
        cell_of[i] = cell
        kept += 1
        if flat[cell] == 0:
            occupied += 1
            column_used[ix, iy] = True
            first_x, last_x = min(first_x, ix), max(last_x, ix)
            first_y, last_y = min(first_y, iy), max(last_y, iy)
            first_z, last_z = min(first_z, iz), max(last_z, iz)
        flat[cell] += 1
    # Number the occupied cells in their order; each begins where the one before ends.
    cells = np.empty((occupied, 3), np.int32)
    start = np.empty(occupied + 1, np.int64)
    row = 0
    total = 0
    for ix in range(first_x, last_x + 1):
        for iy in range(first_y, last_y + 1):
            if not column_used[ix, iy]:
                continue  # memory that nobody has touched
            for iz in range(first_z, last_z + 1):
                count = number_at[ix, iy, iz]
                if count == 0:
                    continue
                cells[row, 0] = ix
                cells[row, 1] = iy
                cells[row, 2] = iz
                start[row] = total
                total += count
                row += 1
                number_at[ix, iy, iz] = row
    start[occupied] = total
    # Put every point behind those of its cell that are already there.
    fill = start[:-1].copy()
    kept_points = np.empty((kept, 3))
    for i in range(n):
        if cell_of[i] < 0:
            continue
        row = flat[cell_of[i]] - 1
        at = fill[row]
        fill[row] = at + 1
        for a in range(3):
            kept_points[at, a] = points[i, a]
    return kept_points, start, cells
