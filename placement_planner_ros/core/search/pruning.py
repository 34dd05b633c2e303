"""Branches that provably hold nothing, and what is left of the hierarchy without them."""

from __future__ import annotations

import enum
from typing import Protocol

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.search.cell_layout import ANGLE, areas, halved, whole_cells
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.types import Array

_AT_ONCE = 8
"""Cells that are judged together: enough to make use of arrays, few enough to go deep first."""
_ROUNDS = 500
"""Rounds of judging in one call at most while there is no placement, some 0.1 s."""
_ROUNDS_LATER = 4
"""And once there is one, where each rise of ξ_best asks anew and ξ has to be bounded too."""


class Ruling(enum.IntEnum):
    """What is known of a cell."""

    OPEN = 0
    """It may hold a goal."""
    OUT_OF_REACH = 1
    """At every pose the object is out of reach of every arm in every grasp."""
    UNSUPPORTED = 2
    """At every pose a vertex of v(f) has no support, or the centre of mass is outside V."""
    NOT_BETTER = 3
    """No pose has ξ(x) > ξ_best."""


class CellBounds(Protocol):
    """Judges whole cells at once."""

    def rulings(self, cells: Array, best: float) -> npt.NDArray[np.int64]:
        """(n,) `Ruling` of each of the (n, 8) cells; any but OPEN is proven for all its poses."""
        ...


_WORDS = {
    Ruling.OUT_OF_REACH: (
        "out of reach of every arm in every grasp",
        "move target_volume closer to the robot, or give further grasps",
    ),
    Ruling.UNSUPPORTED: (
        "without support for every vertex of the placement face, or has the centre of mass outside "
        "target_volume",
        "choose a target_volume with larger surfaces, or look at ~/occupancy for holes in them",
    ),
    Ruling.NOT_BETTER: ("no better than that", ""),
}


class Remainder:
    """What of the hierarchy is not ruled out: all of it at first, and less as ξ_best rises.

    A depth-first search for a leaf that may hold a goal. Such a leaf is a witness that the search
    goes on until ξ_best rules that out too; where there is none, nothing is left.

    Attributes:
        rulings: what the parts ruled out so far were ruled out for.
    """

    def __init__(self, hierarchy: AfrHierarchy, bounds: CellBounds) -> None:
        self._bounds = bounds
        self._min_area = hierarchy.settings.min_area
        self._min_angle = hierarchy.settings.min_angle * (1 + 1e-9)
        self._open = list(whole_cells(hierarchy))
        self._witness = np.nan  # ξ_best up to which the last open cell is known to be open
        self.rulings: set[Ruling] = set()

    def empty(self, best: float) -> bool:
        """Whether no goal with ξ above `best` exists; False as long as that is not proven."""
        if self._witness >= best:
            return False
        for _ in range(_ROUNDS if best == -np.inf else _ROUNDS_LATER):
            if not self._open:
                return True
            cells = np.array(self._open[-_AT_ONCE:])
            del self._open[-_AT_ONCE:]
            rulings = self._bounds.rulings(cells, best)
            self.rulings |= {Ruling(r) for r in rulings if r != Ruling.OPEN}
            cells = cells[rulings == Ruling.OPEN]
            leaf = (areas(cells) <= self._min_area) & (
                cells[:, ANGLE + 1] - cells[:, ANGLE] <= self._min_angle
            )
            if leaf.any():
                self._open += [*cells[~leaf], *cells[leaf]]
                self._witness = best
                return False
            self._open += list(halved(cells))
        return False

    def why_empty(self, best: float) -> str:
        """In words, why nothing is left, and what to do about it."""
        rulings = sorted(self.rulings)
        poses = "every pose on the placement regions is "
        poses += ", or ".join(_WORDS[ruling][0] for ruling in rulings)
        if best > -np.inf:
            return f"no placement better than {best:.6g} is left: {poses}"
        remedies = "; ".join(_WORDS[ruling][1] for ruling in rulings)
        return f"no placement is possible: {poses}: {remedies}"
