"""Cells around a mesh: how far they are from it, and which of them the outside leads to.

What a cell says holds for all of its points, so that what keeps clear of far cells keeps near the
mesh at every point and not only at some.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy import ndimage

from placement_planner_ros.core.body.convex_part import ConvexPart
from placement_planner_ros.core.types import Array, Index, Mask

MAX_CELLS = 10_000_000
"""Cells around a mesh: 0.2 GB; a tenth as many points of triangles are made at once."""

CELLS_IN_TOLERANCE = 6.0
"""Cells along a tolerance, where `MAX_CELLS` allows it; two thirds of them at the fewest."""


@dataclass(frozen=True, slots=True, eq=False)
class FarCells:
    """The border of what is far from a mesh.

    A cell is far where a point of it may be further from the mesh than the reach, and where the
    outside leads to it through such cells: the inside of a solid is not, nor what only narrower
    openings lead to. A connected set that has points near the mesh and far ones meets a cell of the
    border.

    Attributes:
        grid: all cells; what is outside of their box is far.
        reach: metres.
        cells: mask of all cells, whether they are far.
        middles: (b, 3) metres, of the border's cells, in their order along x.
    """

    grid: MeshCells
    reach: float
    cells: Mask
    middles: Array

    def further_away(self) -> FarCells:
        """What is further from the mesh by two cells."""
        return self.grid.far(self.reach + 2.0 * self.grid.cell)

    def is_met_by(self, hull: ConvexPart) -> bool:
        """Whether a hull may hold a far point."""
        low, high, half = hull.vertices.min(axis=0), hull.vertices.max(axis=0), 0.5 * self.grid.cell
        if (low < self.grid.low).any() or (high > self.grid.high).any():
            return True
        # Only cells that the hull reaches along x.
        first, last = np.searchsorted(self.middles[:, 0], (low[0] - half, high[0] + half))
        return bool(_any_met(self.middles[first:last], hull.normals, hull.offsets, half))


@njit(cache=True, nogil=True)
def _any_met(middles: Array, normals: Array, offsets: Array, half: float) -> bool:
    """Whether there is a cell, by their middles (n, 3) and half sides, that none of some planes,
    normals (p, 3) and offsets (p,), has all of on its outer side."""
    last = 0
    for i in range(len(middles)):
        x, y, z = middles[i]
        met = True
        # The plane that the cell before is outside of comes first, as it mostly is of this one too.
        for k in range(len(normals)):
            p = (last + k) % len(normals)
            n, m, o = normals[p]
            if n * x + m * y + o * z - offsets[p] > half * (abs(n) + abs(m) + abs(o)):
                met, last = False, p
                break
        if met:
            return True
    return False


class MeshCells:
    """The cells around a mesh, with a bound on how far their points are from it.

    Args:
        corners: (t, 3, 3) metres, of its triangles.
        tolerance: metres, how far from the mesh points may be that do not matter.

    Attributes:
        tolerance: metres; more than given where that would take too many cells.
        cell: metres, the side of a cell.
        low, high: (3,) metres, corners of the box of all cells.
    """

    def __init__(self, corners: Array, tolerance: float) -> None:
        # Cells as fine as the tolerance asks, or as there may be, with a rim of far ones.
        low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        room = float((high - low + 3.0 * tolerance).prod())
        self.cell = max(tolerance / CELLS_IN_TOLERANCE, (room / MAX_CELLS) ** (1.0 / 3.0))
        self.tolerance = max(tolerance, 2.0 / 3.0 * CELLS_IN_TOLERANCE * self.cell)
        self.low = low - 1.5 * self.tolerance
        shape = np.ceil((high + 1.5 * self.tolerance - self.low) / self.cell).astype(int)
        self.high = self.low + shape * self.cell
        # Those that the surface passes, and those that the outside leads to.
        free = np.ones(shape, np.bool_)
        for points in surface_points(corners, 0.5 * self.cell):
            free[self.cells_of(points)] = False
        self._outside = _led_to(free, None)
        # No point of a cell is further from those of another than their middles and a diagonal.
        apart = ndimage.distance_transform_edt(free, sampling=self.cell)
        self._distance = (apart + np.sqrt(3.0) * self.cell).astype(np.float32)

    def cells_of(self, points: Array) -> tuple[Index, ...]:
        """(n,) each, the cells of points (n, 3) along every axis."""
        return tuple(((points - self.low) / self.cell).astype(np.int64).T)

    def inside(self, points: Array) -> Mask:
        """(n,) which of points (n, 3) within the mesh's box are in it: nothing but a way through
        its surface, or through the cells that it is in, leads to them."""
        return np.asarray(~self._outside[self.cells_of(points)])

    def far(self, reach: float) -> FarCells:
        """What is further from the mesh than the reach, in metres."""
        # Far cells beside others, by their middles.
        far = _led_to(self._distance > reach, np.ones((3, 3, 3), np.bool_))
        border = far & ndimage.binary_dilation(~far)
        middles = self.low + (np.argwhere(border) + 0.5) * self.cell
        return FarCells(self, reach, far, middles)


def _led_to(cells: Mask, neighbours: Mask | None) -> Mask:
    """Those of the cells that the rim of the grid leads to through others of them.

    Args:
        neighbours: (3, 3, 3) which cells around one it leads to; None: those that share a side.
    """
    # Connected sets that have a cell at the rim.
    label, count = ndimage.label(cells, neighbours)
    led = np.zeros(count + 1, np.bool_)
    for axis in range(3):
        led[np.take(label, [0, -1], axis)] = True
    led[0] = False
    return np.asarray(led[label])


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
        for few in np.array_split(rows, 1 + len(rows) * len(weights) * 10 // MAX_CELLS):
            yield (weights @ few).reshape(-1, 3)
