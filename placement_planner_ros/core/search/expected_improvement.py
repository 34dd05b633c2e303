"""Which cell promises most for its cost: expected improvement over ξ_best, learned as it goes.

A part of a cell is worth looking at if its sample may be free, better than ξ_best, and reached.
Each of the three is learned from the samples of the run: how often parts of such a cell were free,
how far ξ of a part lies from ξ of the whole, and how many of the tries to reach a pose succeeded
there, smoothed over the cells above in the AFR hierarchy.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr

from placement_planner_ros.core.search.sampler import Index
from placement_planner_ros.core.types import Array, Verdict

NOT_FREE, COLLIDING, LACKING, VALUED = KIND_NUMBERS = range(4)
"""What the sample of a cell was: outside or unsupported; in collision; against a rule; free, so
that its ξ is known."""
KINDS = np.array(
    [
        NOT_FREE
        if v <= Verdict.UNSTABLE
        else COLLIDING
        if v is Verdict.COLLIDING
        else LACKING
        if v is Verdict.BREAKS_RULE
        else VALUED
        for v in Verdict
    ]
)
"""By verdict."""

DEPTH, KIND, VALUE, SCALE, NODE, LACK = range(6)
STATE = 6
"""What is known of a cell, by column: its depth; its kind; ξ of its sample, or of the cell above
where that is not known; the depth ξ is of; the node whose tries to reach poses its own count to; by
how much its sample broke a rule."""
ROOT = -1.0
"""The depth that ξ is of where none is known: then it is the mean of all."""

_TRIES = 2.0
"""Tries that the chance of the cell above counts as."""
_TRIALS = 10.0
"""Samples that what cells promise counts as, beside what such cells gave."""
_REACH_COST = 5.0
"""Samples whose checks take as long as a try to reach a pose with all arms and grasps."""


class ImprovementModel:
    """What the samples so far say of parts of cells.

    Args:
        faces: |F|.
    """

    def __init__(self, faces: int) -> None:
        # Per depth and kind of the cell above: samples, and how many of them were free.
        self._drawn = np.full((1, len(KIND_NUMBERS)), 2.0)
        self._free = np.ones((1, len(KIND_NUMBERS)))
        # Per depth and kind of the cell above: what its parts promised to add to ξ_best, and did.
        self._promised, self._kept = np.zeros((2, 1, len(KIND_NUMBERS)))
        # Per depth: how many values are known whose cell above has one, and their squared distances
        # from it; at depth 0 all values, from their mean.
        self._values, self._squares = np.zeros(1), np.zeros(1)
        self._sum = 0.0
        self._lacks, self._lack = 0, 0.0
        # Nodes: the faces, then every cell that was split or is coarse. Of each, the one above, and
        # how many tries to reach a pose in it there were and how many did.
        self._above = np.full(2 * faces, -1)
        self._tries, self._reached = np.zeros((2, 2 * faces))
        self._nodes = faces

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
        node = self._nodes
        if node == len(self._above):
            self._above = np.append(self._above, np.full(node, -1))
            self._tries = np.append(self._tries, np.zeros(node))
            self._reached = np.append(self._reached, np.zeros(node))
        self._above[node] = above
        self._nodes += 1
        return node

    def chance_to_reach(self, node: int) -> float:
        """Of a try in a node: a Beta count, smoothed over the nodes above."""
        chain = []
        while node >= 0:
            chain.append(node)
            node = int(self._above[node])
        chance = 0.5
        for each in reversed(chain):
            chance = self._mixed(chance, each)
        return chance

    def chances_to_reach(self) -> Array:
        """(nodes,) the same of all nodes."""
        chances = np.empty(self._nodes)
        for node, above in enumerate(self._above[: self._nodes].tolist()):
            chances[node] = self._mixed(float(chances[above]) if above >= 0 else 0.5, node)
        return chances

    def _mixed(self, above: float, node: int) -> float:
        return (_TRIES * above + float(self._reached[node])) / (_TRIES + float(self._tries[node]))

    def lose(self, node: int) -> None:
        """A goal there was not reached by any motion: it counts as a try that failed."""
        self._reached[node] = max(self._reached[node] - 1.0, 0.0)

    def learn(self, state: Array, verdicts: Index, values: Array, best: float) -> Array:
        """(n, 6) what is known of cells after their samples.

        Args:
            state: (n, 6) of what each was before: its own depth, all else of the cell above.
            best: as in `promise`.
        """
        kinds = KINDS[verdicts]
        depths = state[:, DEPTH].astype(np.int64)
        self._grow(int(depths.max(initial=0)) + 2)
        valued = kinds == VALUED
        above = state[:, KIND].astype(np.int64)
        promised, _ = self._gain(state, depths, best)
        np.add.at(self._promised, (depths, above), promised)
        kept = np.where(valued, np.maximum(values - self._reference(best), 0.0), 0.0)
        np.add.at(self._kept, (depths, above), kept)
        np.add.at(self._drawn, (depths, above), 1.0)
        np.add.at(self._free, (depths, above), valued)
        # How far a value is from that of the cell above; a coarse cell's, from the mean.
        whole = valued & (depths == 0)
        self._sum += float(values[whole].sum())
        known = whole | (valued & (state[:, SCALE] == depths - 1.0))
        np.add.at(self._values, depths[known], 1.0)
        off = values[known] - np.where(whole[known], self.mean, state[known, VALUE])
        np.add.at(self._squares, depths[known], off * off)
        tried = verdicts > Verdict.NOT_BETTER
        reached = verdicts == Verdict.FEASIBLE
        for node, did in zip(state[tried, NODE].astype(np.int64), reached[tried], strict=True):
            # Many tries in one part say little of the others: above they count ever less.
            weight = 1.0
            while node >= 0:
                self._tries[node] += weight
                self._reached[node] += weight * did
                weight *= _TRIES / (_TRIES + self._tries[node])
                node = self._above[node]
        after = state.copy()
        after[:, KIND] = kinds
        after[valued, VALUE], after[valued, SCALE] = values[valued], depths[valued]
        lacking = kinds == LACKING
        after[:, LACK] = np.where(lacking, -values, 0.0)
        some = lacking & np.isfinite(values)
        self._lacks, self._lack = self._lacks + int(some.sum()), self._lack - values[some].sum()
        return after

    def promise(self, state: Array, best: float) -> Array:
        """(n,) what a sample in a part of each cell is expected to add to ξ_best, for its cost, if
        what is better is reached.

        Args:
            state: (n, 6) of the cells.
            best: ξ_best, or that of a goal which waits for its motion; -inf where nothing was
                found, so that any value above the mean adds to it.
        """
        depths = state[:, DEPTH].astype(np.int64) + 1
        gain, cost = self._gain(state, depths, best)
        # What such cells promised so far, and what they gave.
        kinds = state[:, KIND].astype(np.int64)
        promised, kept = self._promised[depths, kinds], self._kept[depths, kinds]
        doubt = _TRIALS * promised / self._drawn[depths, kinds]
        reliable = np.divide(
            kept + doubt, promised + doubt, out=np.ones(len(state)), where=promised > 0.0
        )
        promise = gain * reliable / cost
        # What breaks a rule by less is nearer to what breaks none.
        if self._lack > 0.0:
            promise *= np.exp(-state[:, LACK] * (self._lacks / self._lack))
        return np.asarray(promise)

    def _gain(self, state: Array, depths: Index, best: float) -> tuple[Array, Array]:
        """(n,) what a sample at these depths is expected to add, as ξ of parts is spread about ξ of
        the cell above, and (n,) its cost in samples."""
        kinds = state[:, KIND].astype(np.int64)
        free = self._free[depths, kinds] / self._drawn[depths, kinds]
        spread = self._spread()[state[:, SCALE].astype(np.int64) + 1]
        z = (state[:, VALUE] - self._reference(best)) / spread
        better = ndtr(z)
        gain = spread * (z * better + np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi))
        return free * np.maximum(gain, 0.0), 1.0 + _REACH_COST * free * better

    def _reference(self, best: float) -> float:
        return best if best > -np.inf else self.mean

    def forget(self) -> None:
        """What was promised and kept counts for half from now on."""
        self._promised *= 0.5
        self._kept *= 0.5

    def _spread(self) -> Array:
        """(depths + 1,) typical distance of ξ of a part from that of the cell of depth k - 1; where
        none is known, half of that of larger cells."""
        spread = np.ones(len(self._values))
        for depth, (count, squares) in enumerate(zip(self._values, self._squares, strict=True)):
            if count > 1.0 and squares > 0.0:
                spread[depth] = np.sqrt(squares / count)
            elif depth:
                spread[depth] = 0.5 * spread[depth - 1]
        return spread

    def _grow(self, depths: int) -> None:
        more = depths - len(self._values)
        if more > 0:
            self._drawn = np.vstack([self._drawn, np.full((more, len(KIND_NUMBERS)), 2.0)])
            self._free = np.vstack([self._free, np.ones((more, len(KIND_NUMBERS)))])
            none = np.zeros((more, len(KIND_NUMBERS)))
            self._promised = np.vstack([self._promised, none])
            self._kept = np.vstack([self._kept, none])
            self._values = np.append(self._values, np.zeros(more))
            self._squares = np.append(self._squares, np.zeros(more))
