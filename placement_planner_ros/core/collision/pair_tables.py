"""Tables of pairs of links with one or two revolute joints between them: where these are apart.

How such a pair lies depends on two angles at most, so their plane is divided into cells. Either the
links are certainly as far apart as stated throughout a cell, or the cell is open and says nothing.
One joint is taken for two, of which the second does not turn. Tables depend on the robot alone:
they are kept on disk and shared by all checkers of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.types import Array

Indices = npt.NDArray[np.int64]

CELLS_PER_TURN = 720
"""Cells in a whole turn."""
CELL_RAD = 2.0 * math.pi / CELLS_PER_TURN
_MAX_RANGE_CELLS = 512
"""Cells that one question looks at, at most; wider motions are left to the other checks."""


class PairTables(NamedTuple):
    """Tables of t pairs for the kernels."""

    lower: Array
    """(t, 2) angles at which the two joints' first cells begin, rad."""
    counts: Indices
    """(t, 3) cells along the first joint, along the second, and the table's first in `apart`.

    A joint that can turn all the way round has `CELLS_PER_TURN`, the first after the last.
    """
    clear: float
    """Metres by which pairs are apart throughout a cell that says so."""
    apart: npt.NDArray[np.bool_]
    """(.,) whether a cell says that a pair is apart."""


def cell_count(lower: float, upper: float) -> int:
    """How many a joint with these limits, rad, has."""
    return min(math.floor((upper - lower) / CELL_RAD) + 1, CELLS_PER_TURN)


@kernel(lean=True)
def apart_within(
    tables: PairTables, table: int, q1: float, q2: float, delta1: float, delta2: float
) -> bool:
    """Whether a pair is certainly `clear` apart wherever its joints are within ±delta of q.

    It is where all cells say so that these ranges touch.
    """
    # Joint values and ranges in cells of the table.
    rows, columns, first = tables.counts[table, 0], tables.counts[table, 1], tables.counts[table, 2]
    u, du = (q1 - tables.lower[table, 0]) / CELL_RAD, delta1 / CELL_RAD
    v, dv = (q2 - tables.lower[table, 1]) / CELL_RAD, delta2 / CELL_RAD
    if columns == 1:
        # One cell for all of it.
        v, dv = 0.5, 0.0
    # Too wide a range, or more than ten turns away.
    far = 10.0 * CELLS_PER_TURN
    if not (du + dv <= _MAX_RANGE_CELLS and abs(u) < far and abs(v) < far):
        return False
    # A joint that does not go round must stay within its rows or columns.
    if rows < CELLS_PER_TURN and not (u >= du and u + du < rows):
        return False
    if columns < CELLS_PER_TURN and not (v >= dv and v + dv < columns):
        return False
    # All cells that the range touches, if they are not too many.
    i0, i1 = int(np.floor(u - du)), int(np.floor(u + du))
    j0, j1 = int(np.floor(v - dv)), int(np.floor(v + dv))
    if (i1 - i0 + 1) * (j1 - j0 + 1) > _MAX_RANGE_CELLS:
        return False
    # Every one of them must say that the pair is apart; round joints wrap.
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            if not tables.apart[first + (i % rows) * columns + j % columns]:
                return False
    return True
