"""Branches that provably hold nothing, and what is left of the hierarchy without them."""

from __future__ import annotations

import enum
from typing import Protocol

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.search.cell_layout import (
    ANGLE,
    contact_areas,
    halved_cells,
    whole_cells,
)
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.types import Array

_CELLS_AT_ONCE = 8
"""Cells that are judged together: enough to make use of arrays, few enough to go deep first."""
_JUDGING_ROUNDS = 500
"""Rounds of judging in one call at most, some 0.1 s."""


class Ruling(enum.IntEnum):
    """What is known of a cell."""

    OPEN = 0
    """It may hold a goal."""
    OUT_OF_REACH = 1
    """At every pose the object is out of reach of every arm in every grasp."""
    UNSUPPORTED = 2
    """At every pose a vertex of v(f) has no support, or the centre of mass is outside V."""
    BREAKS_RULE = 3
    """At every pose a term that is required is too low."""


class CellBounds(Protocol):
    """Judges whole cells at once."""

    def rulings(self, cells: Array) -> npt.NDArray[np.int64]:
        """(n,) `Ruling` of each of the (n, 10) cells; any but OPEN is proven for all its poses."""
        ...


class Cause(enum.StrEnum):
    """Why a search has nothing left to look at, as the code of an ended run says it."""

    NO_REGION = "NO_REGION"
    """There is no placement region."""
    NO_FACE = "NO_FACE"
    """The object has no placement face, or none on which it is turned as asked."""
    OUT_OF_REACH = "OUT_OF_REACH"
    UNSUPPORTED = "UNSUPPORTED"
    """`Ruling`, of everything."""
    NO_SOLUTION = "NO_SOLUTION"
    """Several of these, or something else."""


class Remainder:
    """What of the hierarchy is not ruled out: all of it at first.

    A depth-first search for a leaf that may hold a goal. Where there is none, nothing is left.

    Attributes:
        rulings: what the parts ruled out so far were ruled out for.
    """

    def __init__(self, hierarchy: AfrHierarchy, bounds: CellBounds) -> None:
        self._bounds = bounds
        self._min_area = hierarchy.settings.min_area
        self._min_angle = hierarchy.settings.min_angle * (1 + 1e-9)
        self._open = list(whole_cells(hierarchy))
        self._found = False  # whether a leaf is known that may hold a goal
        self.rulings: set[Ruling] = set()

    def empty(self) -> bool:
        """Whether there is no goal; False as long as that is not proven."""
        for _ in range(_JUDGING_ROUNDS):
            if self._found:
                return False
            if not self._open:
                return True
            # Judge some cells, the deepest first.
            cells = np.array(self._open[-_CELLS_AT_ONCE:])
            del self._open[-_CELLS_AT_ONCE:]
            rulings = self._bounds.rulings(cells)
            self.rulings |= {Ruling(r) for r in rulings if r != Ruling.OPEN}
            cells = cells[rulings == Ruling.OPEN]
            # A leaf that is still open may hold a goal; other cells are halved.
            angles = cells[:, ANGLE + 1] - cells[:, ANGLE]
            self._found = bool(
                ((contact_areas(cells) <= self._min_area) & (angles <= self._min_angle)).any()
            )
            self._open += list(halved_cells(cells))
        return False

    @property
    def cause(self) -> Cause:
        """The one cause of all that was ruled out; NO_SOLUTION where there are several, or a rule
        of users is to blame."""
        if len(self.rulings) != 1:
            return Cause.NO_SOLUTION
        return Cause.__members__.get(next(iter(self.rulings)).name, Cause.NO_SOLUTION)
