"""Expected improvement over ξ_best, of each cell, learned as it goes.

A part of a cell is worth looking at if its sample may be free, better than ξ_best, and reached.
Each of the three is learned from the samples of the run: how often parts of such a cell were free,
and so was a hand, how far ξ of a part lies from ξ of the whole, and how many of the tries to reach
a pose succeeded there, smoothed over the cells above in the AFR hierarchy.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from placement_planner_ros.core.search.cell_layout import CELL, MAX_CELLS, Cells
from placement_planner_ros.core.search.sampler import Outcome
from placement_planner_ros.core.types import Array, Index, Verdict

NOT_FREE, COLLIDING, LACKING, BLOCKED, VALUED, UNREACHED, REACHED = KIND_NUMBERS = range(7)
"""What the sample of a cell was: outside or unsupported; in collision; against a rule; free, so
that its ξ is known, but not so any hand; with a hand; such a one that was better, but not reached;
and a goal."""
KINDS = np.full(len(Verdict), UNREACHED)
"""By verdict."""
KINDS[: Verdict.COLLIDING] = NOT_FREE
KINDS[Verdict.COLLIDING], KINDS[Verdict.BREAKS_RULE] = COLLIDING, LACKING
KINDS[Verdict.NOT_BETTER], KINDS[Verdict.FEASIBLE] = VALUED, REACHED

GRADED_CELL = np.dtype(
    [
        *CELL.descr,
        ("coarse", np.int64),  # number of a coarse cell; -1 of others
        ("node", np.int64),  # whose tries to reach poses its own count to
        ("depth", np.int64),
        ("kind", np.int64),  # of its sample
        ("value", np.float64),  # ξ of that, or of the cell above where it is not known
        ("scale", np.int64),  # the depth that ξ is of; -1 where it is the mean of all
        ("failed", np.float64),  # tries of the climber whose step leads there
        ("lack", np.float64),  # by how much the sample broke a rule
    ]
)
"""A cell and what is known of it; before its sample, all but its depth of the cell above."""
_NODE = np.dtype([("above", np.int64), ("counts", np.float64, 2)])
"""The cell above; tries to reach poses, and how many of them did."""

_TRIES = 2.0
"""Tries, or samples, that what was to be expected before counts as."""
_TRIES_OF_PART = 4.0
"""Tries in one part of a cell, at most, that count in the whole."""
TRY_SAMPLES = 50
"""Samples whose checks take as long as a try that fails with all that may."""
_PLACEMENT_SAMPLES = 2000
"""Samples whose checks take as long as what follows a goal: motion, OptimizeLocally, timing."""
DEEPEST = 30
"""Depth of the smallest cells that are told apart by their depth: a billionth of a region."""


class ImprovementModel:
    """What the samples so far say of parts of cells.

    Args:
        faces: |F|, the first nodes; each cell that is split is one more.
    """

    def __init__(self, faces: int) -> None:
        shape = DEEPEST + 1, len(KIND_NUMBERS)
        # Per depth and kind of the cell above: samples, and how many were free, with a hand.
        self._drawn, self._free = np.full(shape, 2.0), np.ones(shape)
        # Per depth: how many values are known whose cell above has one, their squared distances
        # from it, and what is typical of these; at depth 0 of all values, from their mean.
        self._values, self._squares = np.zeros((2, DEEPEST + 1))
        self._spread = 0.5 ** np.arange(DEEPEST + 1.0)
        self._sum = 0.0
        self._lacks, self._lack = 0, 0.0
        # Those made so far, and room for more.
        self._made = faces
        self._nodes = np.full(faces + MAX_CELLS, np.array((-1, 0.0), dtype=_NODE))

    @property
    def mean(self) -> float:
        """Of all values that were drawn evenly."""
        return self._sum / max(self._values[0], 1.0)

    def add_nodes(self, above: Index) -> Index:
        """The numbers of new nodes below these, of which the same is expected."""
        numbers = np.arange(self._made, self._made + len(above))
        self._made += len(above)
        while self._made > len(self._nodes):
            self._nodes = np.concatenate([self._nodes, np.zeros_like(self._nodes)])
        self._nodes["above"][numbers] = above
        return numbers

    def chances(self, cells: Cells) -> Array:
        """(n,) the share of tries that reach their pose, of what is known of cells (n,).

        From the faces down to their nodes, each node's own tries beside what those in the rest of
        the one above say.
        """
        # The nodes of the cells, those above them, and so on.
        path = [cells["node"]]
        while (path[-1] >= 0).any():
            path.append(np.where(path[-1] >= 0, self._nodes["above"][path[-1]], -1))
        counts = [np.where((n >= 0)[:, None], self._nodes["counts"][n], 0.0) for n in path]
        # From a half down: what the rest of the node above says counts as some tries.
        chances = np.full(len(cells), 0.5)
        for level in reversed(range(len(path) - 1)):
            below = _in_whole(counts[level - 1]) * (path[level] >= 0)[:, None] if level else 0.0
            tries, reached = (counts[level] - below).T
            chances = (reached + _TRIES * chances) / (tries + _TRIES)
        return chances

    def count_try(self, cell: np.void, tried: float, reached: float) -> None:
        """Count a try in a part of a cell, in its node and all above, where it counts the less the
        more of them were made in this part: many that fail in one say little of the others."""
        number, added = int(cell["node"]), np.array([tried, reached])
        while number >= 0:
            counts = self._nodes["counts"][number]
            before = _in_whole(counts)
            counts += added
            added = _in_whole(counts) - before
            # One level up.
            number = int(self._nodes["above"][number])

    def learn(self, cells: Cells, outcome: Outcome) -> None:
        """Learn from the samples of cells (n,), and write into these what is known after them."""
        values, kinds = outcome.values, KINDS[outcome.verdicts]
        kinds[(kinds >= VALUED) & ~outcome.usable] = BLOCKED
        depths = cells["depth"]
        of = depths, cells["kind"]
        valued = kinds >= BLOCKED
        # How many were free, with a hand.
        np.add.at(self._drawn, of, 1.0)
        np.add.at(self._free, of, kinds >= VALUED)
        # How far a value is from that of the cell above; a coarse cell's, from the mean.
        whole = valued & (depths == 0)
        self._sum += float(values[whole].sum())
        known = valued & (cells["scale"] == depths - 1)
        np.add.at(self._values, depths[known], 1.0)
        off = values[known] - np.where(whole[known], self.mean, cells["value"][known])
        np.add.at(self._squares, depths[known], off * off)
        self._spread_values()
        # What is known of the cells now.
        cells["kind"] = kinds
        cells["value"][valued], cells["scale"][valued] = values[valued], depths[valued]
        some = (kinds == LACKING) & np.isfinite(values)
        cells["lack"] = np.where(some, -values, 0.0)
        self._lacks, self._lack = self._lacks + int(some.sum()), self._lack - values[some].sum()

    def promise(self, cells: Cells, best: float) -> Array:
        """(n,) what a sample in a part of each cell is expected to add to ξ_best, for what it and
        the tries that it leads to take.

        Args:
            best: ξ_best; -inf where nothing was found, so that any value above the mean adds to it.
        """
        depths = np.minimum(cells["depth"] + 1, DEEPEST)
        gain, tried = self._gain(cells, depths, best)
        # What breaks a rule by less is nearer to what breaks none.
        if self._lack > 0.0:
            gain *= np.exp(-cells["lack"] * (self._lacks / self._lack))
        return np.asarray(gain * self.chances(cells) / (1.0 + TRY_SAMPLES * tried))

    def promise_of_tries(self, cells: Cells, values: Array, best: float) -> Array:
        """(n,) what a try to reach a pose with that ξ in each cell, before its sample, is expected
        to add to ξ_best, for what it takes; inf where nothing was found. A climber's tries that
        failed count beside what its cell says."""
        chances = self.chances(cells) * _TRIES / (_TRIES + cells["failed"])
        return (values - best) * chances / (TRY_SAMPLES + _PLACEMENT_SAMPLES * chances)

    def _gain(self, cells: Cells, depths: Index, best: float) -> tuple[Array, Array]:
        """(n,) what a sample at these depths is expected to add, as ξ of parts is spread about ξ of
        the cell above, and (n,) how often it is free and better."""
        of = depths, cells["kind"]
        free = self._free[of] / self._drawn[of]
        spread = self._spread[np.minimum(cells["scale"] + 1, DEEPEST)]
        # Expected improvement, with ξ of parts normally distributed.
        z = (cells["value"] - (best if best > -np.inf else self.mean)) / spread
        better = ndtr(z)
        gain = spread * (z * better + np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi))
        return free * np.maximum(gain, 0.0), free * better

    def _spread_values(self) -> None:
        """Typical distance of ξ of a part from that of the cell above, of each depth; where none is
        known, half of that of larger cells."""
        known = (self._values > 1.0) & (self._squares > 0.0)
        for depth in range(DEEPEST + 1):
            if known[depth]:
                self._spread[depth] = np.sqrt(self._squares[depth] / self._values[depth])
            elif depth:
                self._spread[depth] = 0.5 * self._spread[depth - 1]


def _in_whole(counts: Array) -> Array:
    """What tries and successes (..., 2) in a part count as in the whole."""
    return np.asarray(counts / (1.0 + counts[..., :1] / _TRIES_OF_PART))
