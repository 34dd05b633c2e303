"""How far points around a mesh are from it, by cells.

What a cell says holds for all of its points, so that what keeps clear of far cells keeps near the
mesh, at every point and not only at some.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from placement_planner_ros.core.types import Array

Mask = npt.NDArray[np.bool_]

_CELLS = 10_000_000
"""Most cells that the surroundings of a mesh are divided into."""

_FINE, _COARSE = 6.0, 4.0
"""Cells in a tolerance: as many as are affordable, and the least."""

_AT_ONCE = 1_000_000
"""Points of triangles that are looked at at once."""

_ROUNDING = 2e-6
"""Metres that distances with 32 bits may be wrong by."""

_BLOCK, _BLOCKS = 8, 512
"""Planes that cells are compared with at once: first so few, as most cells are outside one of
them, then twice as many each time, up to so many."""

_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
"""Multiples of it, without what is before the point, are spread evenly."""

_SIDE = 8
"""Cells along the sides of a block."""


@dataclass(frozen=True, slots=True, eq=False)
class Far:
    """The border of what is far from a mesh.

    A cell is far where a point of it may be further from the mesh than the reach, and where it is
    connected to the outside through such cells: what only narrower openings lead to, such as the
    inside of a solid, is not. A connected set that has points near the mesh and far ones meets a
    cell of the border.

    Attributes:
        middles: (b, 3) metres, of far cells beside others, ordered by the block they are in.
        first: (k + 1,) rows of the first cells of each block, and b.
        boxes: (k, 2, 3) metres, middles and half sides of the blocks.
        half: metres, half the side of a cell.
        low, high: (3,) metres, corners of the box of all cells; what is outside it is far.
        reach: metres.
        cells: mask of all cells, whether they are far.
    """

    middles: Array
    first: npt.NDArray[np.int64]
    boxes: Array
    half: float
    low: Array
    high: Array
    reach: float
    cells: Mask

    @classmethod
    def of(cls, far: Mask, low: Array, cell: float, reach: float) -> Far:
        """Of a mask of cells."""
        border = far & _beside(~far)
        index = np.argwhere(border)
        blocks = [count // _SIDE + 1 for count in border.shape]
        at = np.ravel_multi_index(tuple((index // _SIDE).T), blocks)
        block = np.unique(at, return_inverse=True)[1].reshape(-1)
        index = index[np.argsort(block, kind="stable")]
        first = np.concatenate([[0], np.cumsum(np.bincount(block))])
        middles = np.asarray(low + (index + 0.5) * cell)
        lowest = np.minimum.reduceat(middles, first[:-1])
        highest = np.maximum.reduceat(middles, first[:-1])
        boxes = np.stack([0.5 * (lowest + highest), 0.5 * (highest - lowest + cell)], axis=1)
        high = low + np.array(border.shape) * cell
        return cls(middles, first, boxes, 0.5 * cell, low, high, reach, far)

    def holds(self, points: Array) -> bool:
        """Whether one of points (n, 3) within the box of all cells is in a far one."""
        x, y, z = ((points - self.low) / (2.0 * self.half)).astype(np.int64).T
        return bool(self.cells[x, y, z].any())

    def met(self, planes: Array) -> Array:
        """Middles (k, 3) of those cells that the polytope of planes (p, 4) meets."""
        blocks = _met(planes, self.boxes[:, 0], self.boxes[:, 1])
        rows = [np.arange(self.first[k], self.first[k + 1]) for k in blocks]
        return self.met_of(planes, self.middles[np.concatenate(rows)]) if rows else np.zeros((0, 3))

    def met_of(self, planes: Array, middles: Array) -> Array:
        """The same of some cells."""
        return middles[_met(planes, middles, np.full((1, 3), self.half))]

    def is_met(self, vertices: Array, planes: Array) -> bool:
        """Whether the polytope of vertices (m, 3) and planes (p, 4) may hold a far point."""
        if (vertices < self.low).any() or (vertices > self.high).any():
            return True
        return len(self.met(planes)) > 0


def _beside(mask: Mask) -> Mask:
    """Where a cell, or one that it shares a side with, is set."""
    made = mask.copy()
    for axis in range(3):
        ahead, behind = (np.moveaxis(each, axis, 0) for each in (made, mask))
        ahead[1:] |= behind[:-1]
        ahead[:-1] |= behind[1:]
    return made


def _met(planes: Array, middles: Array, halves: Array) -> npt.NDArray[np.int64]:
    """Rows of boxes, of middles (n, 3) and half sides (n or 1, 3), that no plane keeps outside."""
    rows = np.arange(len(middles))
    # Planes that follow each other are alike; those of a block are to face all ways.
    planes = planes[np.argsort(np.arange(len(planes)) * _GOLDEN % 1.0)]
    start, block = 0, _BLOCK
    while start < len(planes) and len(rows):
        normals, offsets = planes[start : start + block, :3], planes[start : start + block, 3]
        start, block = start + block, min(2 * block, _BLOCKS)
        reach = (halves if len(halves) == 1 else halves[rows]) @ np.abs(normals).T
        rows = rows[(middles[rows] @ normals.T + offsets <= reach).all(axis=1)]
    return rows


class MeshSurroundings:
    """The cells around a mesh, with a bound on how far their points are from it.

    Args:
        corners: (t, 3, 3) metres, its triangles.
        tolerance: metres that matter; more where that takes too many cells.

    Attributes:
        tolerance: metres.
        size: metres that no two points near the mesh are further apart than.
    """

    def __init__(self, corners: Array, tolerance: float) -> None:
        points = corners.reshape(-1, 3)
        low, size = points.min(axis=0), np.ptp(points, axis=0)
        cell = tolerance / _FINE
        while (size + 2.0 * _beyond(tolerance, cell)).prod() > _CELLS * cell**3:
            cell *= 1.05
            tolerance = max(tolerance, _COARSE * cell)
        self.tolerance = tolerance
        self.size = float(np.linalg.norm(size)) + tolerance
        beyond = _beyond(tolerance, cell)
        self._low, self._cell = low - beyond, cell
        shape = tuple(np.ceil((size + 2.0 * beyond) / cell).astype(int).tolist())
        sample = _samples(corners - self._low, cell, shape)
        self._distance = _distances(sample, cell)

    def far(self, reach: float) -> Far:
        """What is further from the mesh than the reach, in metres."""
        far = self._distance > reach
        label, count = ndimage.label(far, np.ones((3, 3, 3)))
        outside = np.zeros(count + 1, np.bool_)
        for axis in range(3):
            for end in (0, -1):
                outside[np.take(label, end, axis).ravel()] = True
        outside[0] = False
        return Far.of(outside[label], self._low, self._cell, reach)


def _beyond(tolerance: float, cell: float) -> float:
    """Metres by which cells reach beyond the mesh's box: the outermost ones are far."""
    return tolerance + 3.0 * cell


def _samples(corners: Array, cell: float, shape: tuple[int, ...]) -> npt.NDArray[np.float32]:
    """(..., 3) a point of the triangles in each cell, NaN in those without."""
    made = np.full((*shape, 3), np.nan, np.float32)
    for points in surface_points(corners, 0.5 * cell):
        x, y, z = (points / cell).astype(np.int64).T
        made[x, y, z] = points
    return made


def surface_points(corners: Array, spacing: float) -> Iterator[Array]:
    """(n, 3) points of the triangles (t, 3, 3), so many metres apart, or nearer."""
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    counts = np.maximum(np.ceil(sides / spacing), 1).astype(int)
    for count in np.unique(counts):
        i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1))
        kept = i + j <= count
        weights = np.stack([i[kept], j[kept], count - i[kept] - j[kept]], axis=1) / count
        rows = corners[counts == count]
        chunk = max(1, _AT_ONCE // len(weights))
        for start in range(0, len(rows), chunk):
            yield (weights @ rows[start : start + chunk]).reshape(-1, 3)


def _distances(sample: npt.NDArray[np.float32], cell: float) -> npt.NDArray[np.float32]:
    """Metres that no point of a cell is further than from the samples."""
    nearest = ndimage.distance_transform_edt(
        np.isnan(sample[..., 0]), return_distances=False, return_indices=True
    )
    made = np.empty(sample.shape[:3], np.float32)
    y, z = (np.arange(count) + 0.5 for count in sample.shape[1:3])
    for x in range(len(sample)):
        points = sample[tuple(nearest[:, x])]
        squares = (points[..., 0] - (x + 0.5) * cell) ** 2
        squares += (points[..., 1] - y[:, None] * cell) ** 2
        squares += (points[..., 2] - z * cell) ** 2
        made[x] = np.sqrt(squares)
    made += 0.5 * np.sqrt(3.0) * cell + _ROUNDING
    return made
