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
from numba import njit

from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted

Indices = npt.NDArray[np.int64]

CELLS_PER_TURN = 720
"""Cells in a whole turn."""
CELL_RAD = 2.0 * math.pi / CELLS_PER_TURN


class PairTables(NamedTuple):
    """Tables of t pairs for the kernels."""

    lower: Array
    """(t, 2) angles at which the two joints' first cells begin, rad."""
    counts: Indices
    """(t, 3) cells along the first joint, along the second, and where the table begins in `open`.

    A joint that can turn all the way round has `CELLS_PER_TURN`, the first after the last.
    """
    clear: float
    """Metres by which pairs are apart throughout a cell that says so."""
    open: npt.NDArray[np.int32]
    """(.,) of m by n cells (m + 1, n + 1) numbers: how many cells before a row and a column do not
    say that a pair is apart."""


def cell_count(lower: float, upper: float) -> int:
    """How many a joint with these limits, rad, has."""
    return min(math.floor((upper - lower) / CELL_RAD) + 1, CELLS_PER_TURN)


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def apart_within(
    tables: PairTables, table: int, q1: float, q2: float, delta1: float, delta2: float
) -> bool:
    """Whether a pair is certainly `clear` apart wherever its joints are within ±delta of q.

    It is where all cells say so that these ranges touch.
    """
    # Joint values and ranges in cells of the table; of a single one for all of them.
    rows, columns, first = tables.counts[table, 0], tables.counts[table, 1], tables.counts[table, 2]
    u, du = (q1 - tables.lower[table, 0]) / CELL_RAD, delta1 / CELL_RAD
    v, dv = (q2 - tables.lower[table, 1]) / CELL_RAD, delta2 / CELL_RAD
    if columns == 1:
        v, dv = 0.5, 0.0
    # A joint that goes round, within its first turn.
    if rows == CELLS_PER_TURN:
        u -= rows * np.floor((u - du) / rows)
    if columns == CELLS_PER_TURN:
        v -= columns * np.floor((v - dv) / columns)
    # A range beyond the table, or across the end of a turn, is left to the other checks.
    if not (u - du >= 0.0 and u + du < rows and v - dv >= 0.0 and v + dv < columns):
        return False
    # How many of the cells that the range touches are open.
    i0, i1 = first + int(u - du) * (columns + 1), first + (int(u + du) + 1) * (columns + 1)
    j0, j1 = int(v - dv), int(v + dv) + 1
    opened = tables.open
    return bool(opened[i1 + j1] - opened[i0 + j1] - opened[i1 + j0] + opened[i0 + j0] == 0)
