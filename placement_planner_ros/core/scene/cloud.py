"""Clouds before anything is made of them: cropped, and thinned evenly where they are dense."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.errors import CloudError
from placement_planner_ros.core.types import Array, Index, Index32, kernel_input
from placement_planner_ros.core.uncounted import Uncounted

AROUND_M, CLEAR_M = 0.35, 0.1
"""m beside V in which surfaces are known, and m below and above them in which points matter."""
CONTACT_TOLERANCE_M = 0.003
"""m above or below a surface within which what stands on it touches."""
STEP_M = 0.005
"""m that one surface is above another at least; what is nearer to a surface is part of it."""
SURE_NOISES = 4.0
"""Standard deviations that noise is off by at most, but for one in ten thousand points."""
SAMPLES = 2000
"""Points, or cells, that are looked at for what is estimated of a cloud."""
CELL_POINTS = 16
"""Points that are left of a dense cell: four along each of two directions."""
DENSE_POINTS = CELL_POINTS * 3 // 2
"""Points up to which a cell is not dense."""
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_PRIME_X, _PRIME_Y, _PRIME_Z = 73856093, 19349663, 83492791


def checked_cloud(points: npt.ArrayLike) -> Array:
    """(n, 3) the points as they are, NaN where nothing was seen.

    Raises:
        CloudError: not (n, 3), or points, but no finite one.
    """
    try:
        cloud = np.ascontiguousarray(points, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise CloudError("points", type(points).__name__, "give numbers of shape (n, 3)") from error
    if cloud.size == 0:
        return np.zeros((0, 3))
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise CloudError("points.shape", cloud.shape, "give points of shape (n, 3)")
    if not np.isfinite(cloud.sum()) and not np.isfinite(cloud).all(axis=1).any():
        raise CloudError("points", f"{len(cloud)} points", "none is finite; check the sensor")
    return cloud


def checked_bounds(bounds: tuple[npt.ArrayLike, npt.ArrayLike]) -> tuple[Array, Array]:
    """Lower and upper corner (3,) of a box.

    Raises:
        CloudError: they are not finite, or not in this order.
    """
    corners = np.array(bounds, dtype=np.float64)
    if corners.shape != (2, 3) or not np.isfinite(corners).all():
        raise CloudError("bounds", corners.tolist(), "give two corners of three finite numbers")
    if not (corners[1] > corners[0]).all():
        raise CloudError("bounds", corners.tolist(), "give the lower corner first")
    return corners[0], corners[1]


class CroppedCloud(NamedTuple):
    """What of a cloud matters.

    Attributes:
        points: (n, 3) metres.
        finite: how many there were, wherever.
        extent: (2, 3) lower and upper corner of these, NaN where there are none.
        reach: (2, 3) corners of all space that anything gets to.
        held: (2, 3) of the part of it that holds points, with a rim.
    """

    points: Array
    finite: int
    extent: Array
    reach: tuple[Array, Array]
    held: tuple[Array, Array]


def crop_cloud(
    points: npt.ArrayLike,
    bounds: tuple[npt.ArrayLike, npt.ArrayLike] | None,
    volume: tuple[Array, Array],
    cell_size: float,
) -> CroppedCloud:
    """What of points (n, 3) lies within bounds, no denser than cells need (`thinned`).

    Args:
        bounds: two corners (3,); around the points and the volume unless given.
        volume: its two corners, which are what is held where there are no points.

    Raises:
        CloudError: see `checked_cloud` and `checked_bounds`.
    """
    cloud = checked_cloud(points)
    reach = checked_bounds(bounds) if bounds is not None else None
    within = (-np.inf, np.inf) if reach is None else reach
    rows, count, extent, held = _thinned_and_extents(cloud, cell_size, *within)
    if reach is None:  # around the points alone, a level surface had no room above
        reach = np.fmin(extent[0], volume[0]), np.fmax(extent[1], volume[1])
    if len(rows):  # with two cells around all points
        low, high = held[0] - 2.0 * cell_size, held[1] + 2.0 * cell_size
        volume = np.maximum(reach[0], low), np.minimum(reach[1], high)
    return CroppedCloud(cloud.take(rows, axis=0), count, extent, reach, volume)


def finite_extent(points: Array) -> tuple[int, Array]:
    """How many of the points (n, 3) are finite; their corners (2, 3), NaN where there are none."""
    return _thinned_and_extents(points, 1.0, -np.inf, np.inf)[1:3]


def thinned(
    points: Array, cell_size: float, lower: npt.ArrayLike = -np.inf, upper: npt.ArrayLike = np.inf
) -> Index:
    """Rows, in order, of the (n, 3) points that are kept; those that are not finite are not.

    Of a dense cell as many are left as `CELL_POINTS`, evenly spread over its points in the order in
    which they come, and of the cells beside it the same share: whether a point is kept has nothing
    to do with its noise.

    Args:
        lower, upper: corners (3,) outside of which none are kept.
    """
    return _thinned_and_extents(points, cell_size, lower, upper)[0]


def _thinned_and_extents(
    points: Array, cell_size: float, lower: npt.ArrayLike, upper: npt.ArrayLike
) -> tuple[Index, int, Array, Array]:
    """`thinned`, `finite_extent`, and the corners (2, 3) of what lies within those given."""
    slots = 1 << math.ceil(math.log2(1.5 * len(points) + 16.0))
    within = np.array(
        [np.broadcast_to(np.asarray(end, np.float64), (3,)) for end in (lower, upper)]
    )
    rows, count, extents = _thin_evenly(kernel_input(points), cell_size, within, slots)
    extents[~np.isfinite(extents).all(axis=(1, 2))] = np.nan
    return rows, count, extents[0], extents[1]


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _slot_of(known: Index32, number_at: Index32, cell: tuple[int, int, int]) -> int:
    """The slot of the hash table that a cell has, or would have, among those known (k, 3)."""
    mask = len(number_at) - 1
    # one after the other, until it is the cell's or nobody's
    slot = (cell[0] * _PRIME_X ^ cell[1] * _PRIME_Y ^ cell[2] * _PRIME_Z) & mask
    while number_at[slot] > 0:
        row = number_at[slot] - 1
        if known[row, 0] == cell[0] and known[row, 1] == cell[1] and known[row, 2] == cell[2]:
            break
        slot = (slot + 1) & mask
    return slot


@njit(cache=True, nogil=True)
def _thin_evenly(
    points: Array, cell_size: float, within: Array, slots: int
) -> tuple[Index, int, Array]:
    """`thinned`, to corners (2, 3); how many are finite; the corners (2, 2, 3) of these, and of
    those within. Cells are found by a hash table of so many slots, a power of two."""
    n, finite = len(points), 0
    extents = np.empty((2, 2, 3))
    extents[:, 0], extents[:, 1] = np.inf, -np.inf
    known, number_at = np.empty((n, 3), np.int32), np.zeros(slots, np.int32)
    cell_of, count = np.full(n, np.int32(-1)), np.empty(n, np.int32)
    cells = row = 0
    last = (0, 0, 0)
    (x0, y0, z0), (x1, y1, z1) = within
    # which cell each point is of, and how many each has
    for p in range(n):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        if not math.isfinite(x + y + z):
            continue
        finite += 1
        inside = x0 <= x <= x1 and y0 <= y <= y1 and z0 <= z <= z1
        for which in range(1 + inside):
            for a, value in ((0, x), (1, y), (2, z)):
                extents[which, 0, a] = min(extents[which, 0, a], value)
                extents[which, 1, a] = max(extents[which, 1, a], value)
        if not inside:
            continue
        cell = math.floor(x / cell_size), math.floor(y / cell_size), math.floor(z / cell_size)
        if cell != last or cells == 0:  # neighbours are mostly of one cell
            slot = _slot_of(known, number_at, cell)
            last = cell
            if number_at[slot] == 0:
                known[cells, 0], known[cells, 1], known[cells, 2] = cell
                count[cells] = 0
                cells += 1
                number_at[slot] = cells
            row = number_at[slot] - 1
        cell_of[p] = row
        count[row] += 1
    # how many the densest of each cell and the six beside it has: points that noise has moved out
    # of a dense cell stay as seldom as those in it
    most = count[:cells].copy()
    for c in range(cells):
        if count[c] <= DENSE_POINTS:
            continue
        for way in range(6):
            step = 1 - 2 * (way & 1)
            i, j, k = known[c]
            beside = i + step * (way < 2), j + step * (2 <= way < 4), k + step * (way >= 4)
            number = number_at[_slot_of(known, number_at, beside)]
            if number > 0:
                most[number - 1] = max(most[number - 1], count[c])
    # of each dense cell those whose multiple of the golden ratio falls into the share that is kept:
    # no two neighbours, in a row or in rows one above the other, before most others are
    rows, passed = np.empty(n, np.int64), np.zeros(cells, np.int32)
    kept = 0
    for p in range(n):
        c = cell_of[p]
        if c < 0:
            continue
        dense = most[c] > DENSE_POINTS
        if dense:
            turns = (c + passed[c]) * _GOLDEN
            passed[c] += 1
            dense = (turns - math.floor(turns)) * most[c] >= CELL_POINTS
        if not dense:
            rows[kept] = p
            kept += 1
    return rows[:kept], finite, extents
