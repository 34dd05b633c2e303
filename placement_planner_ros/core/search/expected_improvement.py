"""Expected improvement over ξ_best for its cost, of each cell, learned as it goes.

A part of a cell is worth looking at if its sample may be free, better than ξ_best, and reached.
Each of the three is learned from the samples of the run: how often parts of such a cell were free,
how far ξ of a part lies from ξ of the whole, and how many of the tries to reach a pose succeeded
there and what they cost, smoothed over the cells above in the AFR hierarchy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from placement_planner_ros.core.search.sampler import Index
from placement_planner_ros.core.types import Array, Verdict

NOT_FREE, COLLIDING, LACKING, VALUED = KIND_NUMBERS = range(4)
"""What the sample of a cell was: outside or unsupported; in collision; against a rule; free, so
that its ξ is known."""
KINDS = np.full(len(Verdict), VALUED)
"""By verdict."""
KINDS[: Verdict.COLLIDING] = NOT_FREE
KINDS[Verdict.COLLIDING], KINDS[Verdict.BREAKS_RULE] = COLLIDING, LACKING
TRY_COSTS = {
    Verdict.NO_IK: 5.0,
    Verdict.ARM_COLLIDING: 15.0,
    Verdict.NO_RELEASE: 90.0,
    Verdict.NO_APPROACH: 100.0,
    Verdict.NO_RETREAT: 200.0,
    Verdict.FEASIBLE: 100.0,
}
"""Samples whose checks take as long as a try to reach a pose with all arms and grasps, by how it
ends: medians of four cases."""

DEPTH, KIND, VALUE, SCALE, NODE, LACK = range(6)
STATE = 6
"""What is known of a cell, by column: its depth; its kind; ξ of its sample, or of the cell above
where that is not known; the depth ξ is of; the node whose tries to reach poses its own count to; by
how much its sample broke a rule."""
ROOT = -1.0
"""The depth that ξ is of where none is known: then it is the mean of all."""

_TRIES = 2.0
"""Tries that what is known of the cell above counts as."""
_TRIALS = 10.0
"""Samples that what cells promise counts as, beside what such cells gave."""
_DEEPEST = 30
"""Depth of the smallest cells that are told apart by their depth: a billionth of a region."""


@dataclass(slots=True)
class _Node:
    """A face, or a cell that was split or is coarse, and the tries to reach poses in it.

    Attributes:
        above: number of the node above; -1 for a face.
        tries, reached: how many there were, and how many did.
        spent: samples that they cost.
    """

    above: int
    tries: float = 0.0
    reached: float = 0.0
    spent: float = 0.0


class ImprovementModel:
    """What the samples so far say of parts of cells.

    Args:
        faces: |F|, the first nodes.
    """

    def __init__(self, faces: int) -> None:
        shape = _DEEPEST + 1, len(KIND_NUMBERS)
        # Per depth and kind of the cell above: samples, and how many of them were free.
        self._drawn, self._free = np.full(shape, 2.0), np.ones(shape)
        # Per depth and kind of the cell above: what its parts promised to add to ξ_best, and did.
        self._promised, self._kept = np.zeros((2, *shape))
        # Per depth: how many values are known whose cell above has one, their squared distances
        # from it, and what is typical of these; at depth 0 of all values, from their mean.
        self._values, self._squares = np.zeros((2, _DEEPEST + 1))
        self._spread = 0.5 ** np.arange(_DEEPEST + 1.0)
        self._sum = 0.0
        self._lacks, self._lack = 0, 0.0
        self._nodes = [_Node(-1) for _ in range(faces)]
        self._outlooks: dict[int, tuple[float, float]] = {}  # as long as there is no further try

    @property
    def mean(self) -> float:
        """Of all values that were drawn evenly."""
        return self._sum / max(self._values[0], 1.0)

    def coarse(self, nodes: Sequence[int]) -> Array:
        """(n, 6) what is known of cells, which are nodes, before their sample."""
        state = np.empty((len(nodes), STATE))
        state[:, DEPTH], state[:, KIND], state[:, SCALE] = 0, NOT_FREE, ROOT
        state[:, VALUE], state[:, LACK] = self.mean, 0.0
        state[:, NODE] = nodes
        return state

    def add_node(self, above: int) -> int:
        """The number of a new node below one."""
        self._nodes.append(_Node(above))
        return len(self._nodes) - 1

    def outlook(self, number: int) -> tuple[float, float]:
        """The chance that a try in a node reaches its pose, and the samples that it costs.

        Both are means over its tries, and over a few that go as those above it.
        """
        known = self._outlooks.get(number)
        if known is None:
            chance, cost = 0.5, TRY_COSTS[Verdict.NO_IK]
            node = self._nodes[number]
            if node.above >= 0:
                chance, cost = self.outlook(node.above)
            weight = _TRIES + node.tries
            chance = (_TRIES * chance + node.reached) / weight
            known = self._outlooks[number] = chance, (_TRIES * cost + node.spent) / weight
        return known

    def lose(self, node: int) -> None:
        """A goal there was not reached by any motion: it counts as a try that failed."""
        self._nodes[node].reached = max(self._nodes[node].reached - 1.0, 0.0)
        self._outlooks.clear()

    def learn(self, state: Array, verdicts: Index, values: Array, best: float) -> Array:
        """(n, 6) what is known of cells after their samples.

        Args:
            state: (n, 6) of what each was before: its own depth, all else of the cell above.
            best: as in `promise`.
        """
        kinds = KINDS[verdicts]
        depths = np.minimum(state[:, DEPTH].astype(np.int64), _DEEPEST)
        of = depths, state[:, KIND].astype(np.int64)
        valued = kinds == VALUED
        # What was promised, what came of it, and how many were free.
        np.add.at(self._promised, of, self._gain(state, depths, best)[0])
        gained = np.where(valued, np.maximum(values - self._reference(best), 0.0), 0.0)
        np.add.at(self._kept, of, gained)
        np.add.at(self._drawn, of, 1.0)
        np.add.at(self._free, of, valued)
        # How far a value is from that of the cell above; a coarse cell's, from the mean.
        whole = valued & (depths == 0)
        self._sum += float(values[whole].sum())
        known = whole | (valued & (state[:, SCALE] == depths - 1.0))
        np.add.at(self._values, depths[known], 1.0)
        off = values[known] - np.where(whole[known], self.mean, state[known, VALUE])
        np.add.at(self._squares, depths[known], off * off)
        self._spread_values()
        # Tries: many in one part say little of the others, so above they count ever less.
        for row in np.flatnonzero(verdicts > Verdict.NOT_BETTER).tolist():
            self._count_try(int(state[row, NODE]), Verdict(verdicts[row]))
        after = state.copy()
        after[:, KIND] = kinds
        after[valued, VALUE], after[valued, SCALE] = values[valued], depths[valued]
        lacking = kinds == LACKING
        after[:, LACK] = np.where(lacking, -values, 0.0)
        some = lacking & np.isfinite(values)
        self._lacks, self._lack = self._lacks + int(some.sum()), self._lack - values[some].sum()
        return after

    def _count_try(self, number: int, verdict: Verdict) -> None:
        weight = 1.0
        self._outlooks.clear()
        # From the node up to its face, with ever less weight.
        while number >= 0:
            node = self._nodes[number]
            node.tries += weight
            node.reached += weight * (verdict is Verdict.FEASIBLE)
            node.spent += weight * TRY_COSTS[verdict]
            weight *= _TRIES / (_TRIES + node.tries)
            number = node.above

    def promise(self, state: Array, best: float) -> tuple[Array, Array]:
        """(n,) what a sample in a part of each cell is expected to add to ξ_best if what is better
        is reached, and (n,) how often it is tried whether it is.

        Args:
            state: (n, 6) of the cells.
            best: ξ_best, or that of a goal which waits for its motion; -inf where nothing was
                found, so that any value above the mean adds to it.
        """
        depths = np.minimum(state[:, DEPTH].astype(np.int64) + 1, _DEEPEST)
        gain, tried = self._gain(state, depths, best)
        # What such cells promised so far, and what they gave.
        kinds = state[:, KIND].astype(np.int64)
        promised, kept = self._promised[depths, kinds], self._kept[depths, kinds]
        doubt = _TRIALS * promised / self._drawn[depths, kinds]
        gain *= np.divide(
            kept + doubt, promised + doubt, out=np.ones(len(state)), where=promised > 0.0
        )
        # What breaks a rule by less is nearer to what breaks none.
        if self._lack > 0.0:
            gain *= np.exp(-state[:, LACK] * (self._lacks / self._lack))
        return gain, tried

    def _gain(self, state: Array, depths: Index, best: float) -> tuple[Array, Array]:
        """(n,) what a sample at these depths is expected to add, as ξ of parts is spread about ξ of
        the cell above, and (n,) how often it is free and better."""
        kinds = state[:, KIND].astype(np.int64)
        # How often parts of such cells were free.
        free = self._free[depths, kinds] / self._drawn[depths, kinds]
        scales = np.minimum(state[:, SCALE].astype(np.int64) + 1, _DEEPEST)
        spread = self._spread[scales]
        # Expected improvement, with ξ of parts normally distributed.
        z = (state[:, VALUE] - self._reference(best)) / spread
        better = ndtr(z)
        gain = spread * (z * better + np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi))
        return free * np.maximum(gain, 0.0), free * better

    def _reference(self, best: float) -> float:
        return best if best > -np.inf else self.mean

    def forget(self) -> None:
        """What was promised and kept counts for half from now on."""
        self._promised *= 0.5
        self._kept *= 0.5

    def _spread_values(self) -> None:
        """Typical distance of ξ of a part from that of the cell above, of each depth; where none is
        known, half of that of larger cells."""
        known = (self._values > 1.0) & (self._squares > 0.0)
        for depth in range(_DEEPEST + 1):
            if known[depth]:
                self._spread[depth] = np.sqrt(self._squares[depth] / self._values[depth])
            elif depth:
                self._spread[depth] = 0.5 * self._spread[depth - 1]
