"""Cells around a mesh: how far they are from it, and which of them the outside leads to.

What a cell says holds for all of its points, so that what keeps clear of far cells keeps near the
mesh at every point and not only at some.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy import ndimage

from placement_planner_ros.core.body.polytope import Polytope
from placement_planner_ros.core.types import Array

Mask = npt.NDArray[np.bool_]

MAX_CELLS = 10_000_000
"""Cells around a mesh: 0.2 GB."""

CELLS_IN_TOLERANCE = 6.0
"""Cells along a tolerance, where `MAX_CELLS` allows it; two thirds of them at the fewest."""

POINTS_AT_ONCE = 1_000_000
"""Points of triangles that are made at once: 24 MB."""


@dataclass(frozen=True, slots=True, eq=False)
class FarCells:
    """The border of what is far from a mesh.

    A cell is far where a point of it may be further from the mesh than the reach, and where the
    outside leads to it through such cells: the inside of a solid is not, nor what only narrower
    openings lead to. A connected set that has points near the mesh and far ones meets a cell of the
    border.

    Attributes:
        middles: (b, 3) metres, of the border's cells, in their order along x.
        half: metres, half the side of a cell.
        reach: metres.
        cells: mask of all cells, whether they are far.
        low, high: (3,) metres, corners of the box of all cells; what is outside of it is far.
    """

    middles: Array
    half: float
    reach: float
    cells: Mask
    low: Array
    high: Array

    def hold_one_of(self, points: Array) -> bool:
        """Whether one of points (n, 3) within the box of all cells is in a far one."""
        x, y, z = ((points - self.low) / (2.0 * self.half)).astype(np.int64).T
        return bool(self.cells[x, y, z].any())

    def is_met_by(self, hull: Polytope) -> bool:
        """Whether a hull may hold a far point."""
        if (hull.vertices < self.low).any() or (hull.vertices > self.high).any():
            return True
        # Only cells that the hull reaches along x.
        ends = hull.vertices[:, 0].min() - self.half, hull.vertices[:, 0].max() + self.half
        first, last = np.searchsorted(self.middles[:, 0], ends)
        return bool(_any_met(self.middles[first:last], hull.planes, self.half))


@njit(cache=True, nogil=True)
def _any_met(middles: Array, planes: Array, half: float) -> bool:
    """Whether there is a cell, by their middles (n, 3) and half sides, that none of some planes
    (p, 4) has all of on its outer side."""
    last = 0
    for i in range(len(middles)):
        x, y, z = middles[i]
        met = True
        # The plane that the cell before is outside of comes first, as it mostly is of this one too.
        for k in range(len(planes)):
            p = (last + k) % len(planes)
            n, m, o = planes[p, 0], planes[p, 1], planes[p, 2]
            beyond = n * x + m * y + o * z + planes[p, 3]
            if beyond > half * (abs(n) + abs(m) + abs(o)):
                met, last = False, p
                break
        if met:
            return True
    return False


class MeshCells:
    """The cells around a mesh, with a bound on how far their points are from it.

    Args:
        corners: (t, 3, 3) metres, its triangles.
        tolerance: metres that matter.

    Attributes:
        tolerance: metres; more than given where that would take too many cells.
        low, high: (3,) metres, corners of the box of all cells.
    """

    def __init__(self, corners: Array, tolerance: float) -> None:
        # Cells as fine as the tolerance asks, or as there may be.
        points = corners.reshape(-1, 3)
        low, size = points.min(axis=0), np.ptp(points, axis=0)
        cell = tolerance / CELLS_IN_TOLERANCE
        while (size / cell + 3.0 * CELLS_IN_TOLERANCE).prod() > MAX_CELLS:
            cell *= 1.05
            tolerance = max(tolerance, CELLS_IN_TOLERANCE * cell / 1.5)
        self.tolerance, self._cell = tolerance, cell
        # A rim of cells around the mesh.
        beyond = 1.5 * CELLS_IN_TOLERANCE * cell  # the outermost cells are far
        self.low = low - beyond
        shape = np.ceil((size + 2.0 * beyond) / cell).astype(int)
        self.high = self.low + shape * self._cell
        # A point of the triangles in each cell that has one.
        sample = np.full((*shape, 3), np.nan, np.float32)
        for each in surface_points(corners, 0.5 * self._cell):
            sample[self._cells_of(each)] = each - self.low
        # How far cells are from it, and which of them the outside leads to.
        on_surface = ~np.isnan(sample[..., 0])
        self._distance = _distances_from(sample, on_surface, self._cell)
        self._outside = _led_to(~on_surface, None)

    def _cells_of(self, points: Array) -> tuple[npt.NDArray[np.int64], ...]:
        return tuple(((points - self.low) / self._cell).astype(np.int64).T)

    def inside(self, points: Array) -> Mask:
        """(n,) which of points (n, 3) within the mesh's box are in it: nothing but a way through
        its surface, or through the cells that it is in, leads to them."""
        return np.asarray(~self._outside[self._cells_of(points)])

    def far(self, reach: float) -> FarCells:
        """What is further from the mesh than the reach, in metres."""
        # Far cells beside others, by their middles.
        far = _led_to(self._distance > reach, np.ones((3, 3, 3), np.bool_))
        border = far & ndimage.binary_dilation(~far)
        middles = self.low + (np.argwhere(border) + 0.5) * self._cell
        return FarCells(middles, 0.5 * self._cell, reach, far, self.low, self.high)


def _led_to(cells: Mask, neighbours: Mask | None) -> Mask:
    """Those of the cells that the rim of the grid leads to through others of them.

    Args:
        neighbours: (3, 3, 3) which cells around one it leads to; None: those that share a side.
    """
    # Connected sets that have a cell at the rim.
    label, count = ndimage.label(cells, neighbours)
    led = np.zeros(count + 1, np.bool_)
    for axis in range(3):
        for end in (0, -1):
            led[np.take(label, end, axis).ravel()] = True
    led[0] = False
    return np.asarray(led[label])


def _distances_from(sample: npt.NDArray[np.float32], known: Mask, cell: float) -> Array:
    """Metres that no point of a cell is further than from the nearest cell's sample."""
    # The sample in the nearest cell that has one, plane by plane.
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    made = np.empty(known.shape, np.float32)
    y, z = ((np.arange(count) + 0.5) * cell for count in known.shape[1:])
    for x in range(len(known)):
        away = sample[tuple(nearest[:, x])]
        away[..., 0] -= (x + 0.5) * cell
        away[..., 1] -= y[:, None]
        away[..., 2] -= z
        made[x] = np.sqrt(np.einsum("yzk,yzk->yz", away, away))
    return made + 0.5 * np.sqrt(3.0) * cell + 1e-6


def surface_points(corners: Array, spacing: float) -> Iterator[Array]:
    """(n, 3) points of the triangles (t, 3, 3), so many metres apart, or nearer."""
    # Into how many parts the sides of each triangle are divided.
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    counts = np.maximum(np.ceil(sides / spacing), 1).astype(int)
    for count in np.unique(counts):
        # Weights of the corners, for all that are divided alike.
        i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1))
        kept = i + j <= count
        weights = np.stack([i[kept], j[kept], count - i[kept] - j[kept]], axis=1) / count
        rows = corners[counts == count]
        chunk = max(1, POINTS_AT_ONCE // len(weights))
        for start in range(0, len(rows), chunk):
            yield (weights @ rows[start : start + chunk]).reshape(-1, 3)
