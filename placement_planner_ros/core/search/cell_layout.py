"""Cells of the pose sets Ŝ(r, f), as records: a pose set, and a box of places in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.search.sampler import Draws
from placement_planner_ros.core.types import Array, Index

CELL = np.dtype([("set", np.int64), ("low", np.float64, 3), ("high", np.float64, 3)])
"""Pose set, and the ends of x, y and θ."""
Cells = npt.NDArray[np.void]
"""(n,) of that, or with further fields."""
Row = tuple[int, int, float, float]
"""Face, index of the region, and ends of the range of θ, of a pose set."""
MAX_CELLS = 30_000
"""Cells that a search remembers."""
CELLS_AT_ONCE = 12
"""Cells that are split together: enough to make use of arrays, few enough to go deep."""
_PARTS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


class PoseSets:
    """All pose sets, one a row; a place in one is (x, y, θ), of the contact point and the turn.

    Args:
        regions: R.
        rows: what each is.
        middles: of each face x + iy, m, from the contact point to the object's middle at θ = 0.

    Attributes:
        face, region: (k,) indices.
        planes: (m, 3) z at x = y = 0, and slope, of each plane that there is.
        plane, z, slope: (k,) its number, and (k,) and (k, 2) the same of each set.
        middle: (k,) of these, that of each set.
        low, high: (k, 3) corners of a box that holds all places.
    """

    def __init__(
        self, regions: Sequence[Region], rows: Sequence[Row], middles: Sequence[complex]
    ) -> None:
        table = np.array(rows, dtype=np.float64).reshape(-1, 4)
        self.face, self.region = table[:, 0].astype(np.int64), table[:, 1].astype(np.int64)
        self.middle = np.array(middles, np.complex128)[self.face]
        planes = np.array([(r.z, *r.slope) for r in regions]).reshape(-1, 3)[self.region]
        self.z, self.slope = planes[:, 0], planes[:, 1:]
        self.planes, of = np.unique(planes, axis=0, return_inverse=True)
        self.plane = of.ravel()
        corners = np.array(
            [(*r.rectangles[:, :2].min(axis=0), *r.rectangles[:, 2:].max(axis=0)) for r in regions]
        ).reshape(-1, 4)[self.region]
        self.low = np.column_stack([corners[:, :2], table[:, 2]])
        self.high = np.column_stack([corners[:, 2:], table[:, 3]])

    def __len__(self) -> int:
        return len(self.face)

    @property
    def cells(self) -> Cells:
        """(k,) cells that hold all of each."""
        cells = np.empty(len(self), dtype=CELL)
        cells["set"], cells["low"], cells["high"] = np.arange(len(self)), self.low, self.high
        return cells

    def contact_points(self, sets: Index, xy: Array) -> Array:
        """(n, 3) points at (n, 2) on the planes of sets (n,)."""
        return np.column_stack([xy, self.z[sets] + (self.slope[sets] * xy).sum(axis=1)])

    def draws(self, sets: Index, places: Array) -> Draws:
        """The poses at places (n, 3) of sets (n,), for any arm and grasp."""
        any_one = np.full(len(sets), -1)
        contact = self.contact_points(sets, places[:, :2])
        return Draws(any_one, any_one, self.face[sets], contact, places[:, 2], self.slope[sets])


def halved_cells(cells: Cells) -> Cells:
    """(8 n,) the parts of (n,) cells, cell by cell: halves of x, y and θ."""
    # Both halves of each side, in all combinations.
    low = cells["low"][:, None]
    half = 0.5 * (cells["high"][:, None] - low)
    parts = np.repeat(cells, len(_PARTS))
    of_each = parts.reshape(-1, len(_PARTS))
    of_each["low"], of_each["high"] = low + _PARTS * half, low + (_PARTS + 1) * half
    return parts


def bisected_cells(cells: Cells, turn_radius: float) -> Cells:
    """(2 n,) the halves of (n,) cells, cell by cell, across the longest side of each.

    Args:
        turn_radius: m that one radian counts as.
    """
    rows = np.arange(len(cells))
    side = ((cells["high"] - cells["low"]) * (1.0, 1.0, turn_radius)).argmax(axis=1)
    middle = 0.5 * (cells["low"] + cells["high"])[rows, side]
    parts = np.repeat(cells, 2)
    parts["high"][2 * rows, side] = parts["low"][2 * rows + 1, side] = middle
    return parts


def contact_areas(cells: Cells) -> Array:
    """(n,) m² of the boxes of contact points."""
    return np.asarray((cells["high"] - cells["low"])[:, :2].prod(axis=1))
