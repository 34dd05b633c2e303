"""What is left of the hierarchy without branches that provably hold nothing, or nothing better."""

from __future__ import annotations

import enum
import heapq
import itertools

import numpy as np

from placement_planner_ros.core.search.cell_layout import (
    CELLS_AT_ONCE,
    MAX_CELLS,
    Cells,
    bisected_cells,
    contact_areas,
)
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.search.pruning import CellBounds, Ruling
from placement_planner_ros.core.types import Array

_ROUNDS = 20
"""Rounds at most in one call in search of a cell that may hold a goal, some 0.1 s."""
_PARTS_PER_SAMPLE = 0.04
"""Parts that are judged for each sample after the first placement, so that sampling goes on."""


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

    Before anything was found, a depth-first search for a leaf that may hold a goal: where there is
    none, nothing is left. Then branch and bound: the cells in which ξ may be largest are taken
    apart. Only geometry and provable reach rule cells out, so what is left does not depend on what
    was tried.

    Attributes:
        rulings: what the parts ruled out so far were ruled out for.
    """

    def __init__(self, hierarchy: AfrHierarchy, bounds: CellBounds) -> None:
        self._bounds = bounds
        self._min_area = hierarchy.settings.min_area
        self._min_angle = hierarchy.settings.min_angle * (1 + 1e-9)
        self._number = itertools.count()
        # by the bound of ξ, negative, then the latest, which is the deepest
        self._open: list[tuple[float, int, np.void]] = []
        self._found = False  # whether a leaf is known that may hold a goal
        self._judged, self._least = 0.0, -np.inf
        self.rulings: set[Ruling] = set()
        cells = hierarchy.sets.cells
        self._add(cells, np.full(len(cells), np.inf))

    def gap(self, best: float, least: float) -> float | None:
        """By how much ξ of anything on the placement regions exceeds `best` at most, or `least`
        where that is more; None where that is not known."""
        most = -self._open[0][0] if self._open else -np.inf
        return max(most - best, least) if most < np.inf else None

    def empty(self) -> bool:
        """Whether there is no goal; False as long as that is not proven."""
        for _ in range(_ROUNDS):
            if self._found or not self._open:
                break
            cells, _ = self._taken_apart()
            # A leaf that is still open may hold a goal.
            angles = (cells["high"] - cells["low"])[:, 2]
            leaves = (contact_areas(cells) <= self._min_area) & (angles <= self._min_angle)
            self._found = bool(leaves.any())
            self._add(cells, np.full(len(cells), np.inf))
        return not self._open

    def narrow(self, least: float, samples: int) -> None:
        """Take the most promising cells apart, and drop what holds nothing better than `least`.

        Args:
            samples: tried so far.
        """
        budget = _PARTS_PER_SAMPLE * samples if self._bounds.bounded else 0
        # For what was tried until something was found one round is enough: all may take seconds.
        if self._least == -np.inf:
            self._judged = max(budget - 1, 0)
        # What cannot be above the new least is dropped.
        if least > self._least:
            self._least = least
            self._open = sorted(each for each in self._open if -each[0] > least)  # a heap, too
        # Then the most promising cells are taken apart, within the budget.
        while self._open and self._judged < budget and len(self._open) < MAX_CELLS:
            cells, most = self._taken_apart()
            if len(cells):
                most = np.minimum(most, self._bounds.most(cells))
            self._add(cells[most > least], most[most > least])

    def _taken_apart(self) -> tuple[Cells, Array]:
        """(n,) parts of the first cells that are not ruled out, and (n,) the bounds of the whole
        ones."""
        # Halve the first cells; their bounds hold for both parts.
        number = min(2 * CELLS_AT_ONCE, len(self._open))
        taken = [heapq.heappop(self._open) for _ in range(number)]
        parts = bisected_cells(np.array([cell for _, _, cell in taken]), self._bounds.turn_radius)
        most = np.repeat([-bound for bound, _, _ in taken], 2)
        self._judged += len(parts)
        # Keep what is not ruled out, and note why the rest is.
        rulings = self._bounds.rulings(parts)
        self.rulings |= {Ruling(r) for r in rulings if r != Ruling.OPEN}
        is_open = rulings == Ruling.OPEN
        return parts[is_open], most[is_open]

    def _add(self, cells: Cells, most: Array) -> None:
        for cell, bound in zip(cells, most.tolist(), strict=True):
            heapq.heappush(self._open, (-bound, -next(self._number), cell))

    @property
    def cause(self) -> Cause:
        """The one cause of all that was ruled out; NO_SOLUTION where there are several, or a rule
        of users is to blame."""
        if len(self.rulings) != 1:
            return Cause.NO_SOLUTION
        return Cause.__members__.get(next(iter(self.rulings)).name, Cause.NO_SOLUTION)
