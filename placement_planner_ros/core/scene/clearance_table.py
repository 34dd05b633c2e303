"""The values of a clearance field around one part of V, made where they are asked for."""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.scene.boxes_by_height import BoxesByHeight
from placement_planner_ros.core.scene.clearance_levels import AROUND, fill_levels
from placement_planner_ros.core.scene.clearance_lookup import Table
from placement_planner_ros.core.scene.nearest_boxes import Lines
from placement_planner_ros.core.types import Array

_BESIDE = 8
"""Lines further than what is asked for that are made with it."""
_ROUNDING = 1e-6
"""m."""

Rectangle = tuple[int, int, int, int]
"""First line along x, first along y, and the lines behind the last."""


class ClearanceTable:
    """A `Table` of which a rectangle of lines is filled, which grows with what is asked for.

    Most of what lies around V is never asked for. Values are the same whenever they are made. Two
    threads that ask for more at once both make it.

    Args:
        boxes: those that count.
        lines: of the grid.
        shape: lines along x and y.
        origin: (3,) of the first line and level.
        rise: m between two levels.
        lift: see `Table`.
    """

    def __init__(
        self,
        boxes: BoxesByHeight,
        lines: Lines,
        shape: tuple[int, int],
        origin: Array,
        rise: float,
        lift: float,
    ) -> None:
        levels = int(np.max(boxes.slab, initial=0)) + AROUND + 2
        self._values = np.empty((*shape, levels), np.float32)
        self._boxes, self._lines = boxes, lines
        self._filled: Rectangle = (0, 0, 0, 0)
        self._surely = (np.inf, np.inf, -np.inf, -np.inf)
        seen = self._values.view()
        seen.setflags(write=False)
        origin.setflags(write=False)
        self._table = Table(seen, origin, lines.size, rise, lines.cap, lift)

    def within(self, low_x: float, low_y: float, high_x: float, high_y: float) -> Table | None:
        """The table where it surely is filled between those corners, told at once; else None."""
        a, b, c, d = self._surely
        return self._table if a <= low_x and b <= low_y and high_x <= c and high_y <= d else None

    def around(self, low: Array, high: Array) -> Table:
        """The table, filled for all points between corners (2,) or (3,), in x and y."""
        nx, ny, _ = self._values.shape
        begin = (low[:2] - self._table.origin[:2]) / self._table.size
        end = (high[:2] - self._table.origin[:2]) / self._table.size
        # the lines to either side; of what lies beyond the table, its last two
        i0, j0 = (int(min(max(0.0, v), n - 2.0)) for v, n in zip(begin, (nx, ny), strict=True))
        i1, j1 = (int(min(max(0.0, v), n - 2.0)) + 2 for v, n in zip(end, (nx, ny), strict=True))
        a, b, c, d = self._filled
        if not (a <= i0 and b <= j0 and i1 <= c and j1 <= d):
            self._fill(
                (
                    max(i0 - _BESIDE, 0),
                    max(j0 - _BESIDE, 0),
                    min(i1 + _BESIDE, nx),
                    min(j1 + _BESIDE, ny),
                )
            )
        return self._table

    def whole(self) -> Table:
        """The table, all of it filled."""
        self._fill((0, 0, *self._values.shape[:2]))
        return self._table

    def _fill(self, asked: Rectangle) -> None:
        """Fill what of a rectangle, and of the one around it and what is filled, is not."""
        a, b, c, d = self._filled
        if a == c:
            a, b, c, d = asked[0], asked[1], asked[0], asked[1]
        i0, j0, i1, j1 = (
            min(asked[0], a),
            min(asked[1], b),
            max(asked[2], c),
            max(asked[3], d),
        )
        for part in ((i0, j0, a, j1), (c, j0, i1, j1), (a, j0, c, b), (a, d, c, j1)):
            if part[0] < part[2] and part[1] < part[3]:
                fill_levels(self._boxes, self._lines, self._table.rise, part, self._values)
        self._filled = (i0, j0, i1, j1)
        x, y = (self._table.origin[:2] + _ROUNDING).tolist()
        nx, ny, _ = self._values.shape
        size = self._table.size
        self._surely = (
            x + i0 * size if i0 > 0 else -np.inf,
            y + j0 * size if j0 > 0 else -np.inf,
            x + (i1 - 1) * size - 2.0 * _ROUNDING if i1 < nx else np.inf,
            y + (j1 - 1) * size - 2.0 * _ROUNDING if j1 < ny else np.inf,
        )
