"""Cells of the pose sets Ŝ(r, f), as rows of an array: a pose set, and a box of places in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.search.sampler import Draws, Index
from placement_planner_ros.core.types import Array

SET, X, Y, ANGLE = 0, 1, 3, 5
CELL_COLUMNS = 7
"""Pose set, x min and max, y min and max, θ min and max."""
MAX_CELLS = 100_000
"""Cells that a search remembers."""
LOWER, UPPER = [X, Y, ANGLE], [X + 1, Y + 1, ANGLE + 1]
_PARTS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
PARTS = len(_PARTS)


class PoseSets:
    """All pose sets, one a row; a place in one is (x, y, θ), of the contact point and the turn.

    Args:
        regions: R.
        rows: face, index of the region, and ends of the range of θ, of each.

    Attributes:
        face, region: (k,) indices.
        z, slope: (k,) and (k, 2) of the planes; z is that at x = y = 0.
        low, high: (k, 3) corners of a box that holds all places.
    """

    def __init__(
        self, regions: Sequence[Region], rows: Sequence[tuple[int, int, float, float]]
    ) -> None:
        table = np.array(rows, dtype=np.float64).reshape(-1, 4)
        self.face, self.region = table[:, 0].astype(np.int64), table[:, 1].astype(np.int64)
        planes = np.array([(r.z, *r.slope) for r in regions]).reshape(-1, 3)[self.region]
        self.z, self.slope = planes[:, 0], planes[:, 1:]
        corners = np.array(
            [(*r.rectangles[:, :2].min(axis=0), *r.rectangles[:, 2:].max(axis=0)) for r in regions]
        ).reshape(-1, 4)[self.region]
        self.low = np.column_stack([corners[:, :2], table[:, 2]])
        self.high = np.column_stack([corners[:, 2:], table[:, 3]])

    def __len__(self) -> int:
        return len(self.face)

    @property
    def cells(self) -> Array:
        """(k, 7) cells that hold all of each."""
        return self.cells_between(np.arange(len(self)), self.low, self.high)

    @staticmethod
    def cells_between(sets: Index, low: Array, high: Array) -> Array:
        """(n, 7) cells of sets (n,) from corner to corner, (n, 3) each."""
        cells = np.empty((len(sets), CELL_COLUMNS))
        cells[:, SET], cells[:, LOWER], cells[:, UPPER] = sets, low, high
        return cells

    def contact_points(self, sets: Index, xy: Array) -> Array:
        """(n, 3) points at (n, 2) on the planes of sets (n,)."""
        return np.column_stack([xy, self.z[sets] + (self.slope[sets] * xy).sum(axis=1)])

    def draws(self, sets: Index, places: Array) -> Draws:
        """The poses at places (n, 3) of sets (n,), for any arm and grasp."""
        any_will_do = np.full(len(sets), -1)
        contact = self.contact_points(sets, places[:, :2])
        slope = self.slope[sets]
        return Draws(any_will_do, any_will_do, self.face[sets], contact, places[:, 2], slope)


def sets_of(cells: Array) -> Index:
    """(n,) the pose sets of cells."""
    return cells[:, SET].astype(np.int64)


def halved_cells(cells: Array) -> Array:
    """(8 n, 7) the parts of (n, 7) cells, cell by cell: halves of x, y and θ."""
    # Both halves of each side, in all combinations.
    low = cells[:, LOWER]
    half = (0.5 * (cells[:, UPPER] - low))[:, None]
    parts = np.repeat(cells, PARTS, axis=0).reshape(-1, PARTS, CELL_COLUMNS)
    parts[..., LOWER] = low[:, None] + _PARTS * half
    parts[..., UPPER] = low[:, None] + (_PARTS + 1) * half
    return parts.reshape(-1, CELL_COLUMNS)


def bisected_cells(cells: Array, turn_radius: float) -> Array:
    """(2 n, 7) the halves of (n, 7) cells, cell by cell, across the longest side of each.

    Args:
        turn_radius: m that one radian counts as.
    """
    rows = np.arange(len(cells))
    sides = (cells[:, UPPER] - cells[:, LOWER]) * (1.0, 1.0, turn_radius)
    low = np.array(LOWER)[sides.argmax(axis=1)]
    parts = np.repeat(cells, 2, axis=0)
    middle = 0.5 * (cells[rows, low] + cells[rows, low + 1])
    parts[2 * rows, low + 1] = parts[2 * rows + 1, low] = middle
    return parts


def contact_areas(cells: Array) -> Array:
    """(n,) m² of the boxes of contact points."""
    return np.asarray((cells[:, X + 1] - cells[:, X]) * (cells[:, Y + 1] - cells[:, Y]))
