"""Search by expected improvement over cells of the pose sets Ŝ(r, f), refined where that is most.

A cell is a face, a box of contact points on one region and an interval of θ. Uniform samples grade
the coarse cells they fall into. In each round the cells that promise most for their cost
(`expected_improvement`) are split and their parts sampled, beside as many uniform samples. A cell
is split once only, but its parts stay: nothing that is free and better is put aside for good, and
what the arms fail to reach promises less with each try.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.search.cell_layout import (
    CELL_COLUMNS,
    LOWER,
    MAX_CELLS,
    PARTS,
    SET,
    UPPER,
    contact_areas,
    halved_cells,
    sets_of,
)
from placement_planner_ros.core.search.expected_improvement import (
    DEPTH,
    KIND,
    LACKING,
    NODE,
    STATE,
    ImprovementModel,
)
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.search.pruning import CellBounds, Ruling
from placement_planner_ros.core.search.sampler import (
    BatchSampler,
    Draws,
    GoalChecker,
    Index,
    Outcome,
    SamplerSettings,
)
from placement_planner_ros.core.search.uniform import UniformPoses
from placement_planner_ros.core.settings import setting
from placement_planner_ros.core.types import Array, Verdict

_COARSE_CELLS = 4
"""A region's extent is cut into so many coarse cells along x and y."""
_AT_ONCE = 12
"""Cells split in a round, so that their parts are checked together."""
_PATIENCE = 2000
"""Samples over which a goal may wait for its motion."""


@dataclass(frozen=True, slots=True)
class OptimisticSettings(SamplerSettings):
    """Budgets, and how much is looked at before and beside the best cells.

    Attributes:
        batch: as in `SamplerSettings`, of the uniform samples at the beginning.
        uniform_first: samples before the search begins to refine; until then all are uniform, so
            that the coarse cells have been graded.
        uniform_share: of the samples after these, at least.
        even_share: of all uniform samples: drawn from all regions alike instead of by area, since
            what is best may stand on a small one.
        prune: whether parts of cells that provably hold nothing are left out.
    """

    uniform_first: int = setting(2000, "[0, inf)")
    uniform_share: float = setting(0.5, "[0, 1)")
    even_share: float = setting(0.5, "[0, 1]")
    prune: bool = True


class OptimisticSampler(BatchSampler):
    """SampleGoals by optimistic search; arm and grasp are chosen once a pose is worth reaching.

    Args:
        checker: checks samples.
        rng: draws poses within cells.
        bounds: tell which cells hold nothing; None: none is known to.
    """

    def __init__(
        self,
        hierarchy: AfrHierarchy,
        checker: GoalChecker,
        settings: OptimisticSettings,
        rng: np.random.Generator,
        bounds: CellBounds | None = None,
    ) -> None:
        super().__init__(checker, settings)
        self._settings = settings
        self._bounds = bounds if settings.prune else None
        self._rng = rng
        self._uniform = UniformPoses(hierarchy, rng, settings.even_share)
        self._sets = hierarchy.sets
        self._steps = np.array(
            [_COARSE_CELLS, _COARSE_CELLS, hierarchy.settings.angle_intervals**2]
        )
        self._min_area = hierarchy.settings.min_area
        self._model = ImprovementModel(hierarchy.faces)
        self._filed = _Cells(self._model)
        self._split: set[bytes] = set()
        self._nodes: dict[bytes, int] = {}  # of the coarse cells drawn from
        # goals that wait for their motion: ξ, and at how many samples they were found in which node
        self._waiting: list[tuple[float, int, int]] = []
        self._ranked_for = -np.inf  # ξ by which the cells are ranked
        self._ranked_at = 0  # samples by which they are
        # what is left of the round: cells with what is known of them, and (x, y, θ) drawn from them
        self._cells = np.empty((0, CELL_COLUMNS))
        self._state = np.empty((0, STATE))
        self._poses = np.empty((0, 3))

    def _draw(self, most: int, best: float) -> Draws:
        """The next poses of the round, at most so many; of a new round where it is over."""
        if len(self._cells) == 0:
            self._begin_round(self.count.samples >= self._settings.uniform_first, best)
        return self._sets.draws(sets_of(self._cells[:most]), self._poses[:most])

    def _learn(self, outcome: Outcome, best: float) -> None:
        """File the cells by what their sample was; the rest of the round is drawn from next."""
        tried = len(outcome.verdicts)
        cells = self._cells[:tried]
        state = self._model.learn(
            self._state[:tried], outcome.verdicts, outcome.values, max(best, self._ranked_for)
        )
        # A cell too small to be split is split nevertheless if what is better there is not reached.
        missed = (outcome.verdicts > Verdict.NOT_BETTER) & (outcome.verdicts < Verdict.FEASIBLE)
        kept = (contact_areas(cells) > self._min_area) | missed
        self._filed.add(cells[kept], state[kept], self._ranked_for)
        for row in np.flatnonzero(outcome.verdicts == Verdict.FEASIBLE).tolist():
            node = int(state[row, NODE])
            self._waiting.append((float(outcome.values[row]), self.count.samples, node))
        self._keep(slice(tried, None))

    def _keep(self, rows: slice | Index) -> None:
        self._cells, self._state = self._cells[rows], self._state[rows]
        self._poses = self._poses[rows]

    def _begin_round(self, refine: bool, best: float = -np.inf) -> None:
        """Draw poses to be checked; each grades the cell it was drawn from."""
        share = self._settings.uniform_share
        # Parts of the best cells, and the uniform samples beside them.
        parts = [self._open_parts(best)] if refine else []
        finer = sum(len(cells) for cells, _ in parts)
        count = round(finer * share / (1.0 - share)) if finer else self._budget.batch
        coarse, drawn = self._graded(max(1, count))
        parts.append((coarse, self._model.coarse([self._node_of(cell) for cell in coarse])))
        self._cells = np.concatenate([cells for cells, _ in parts])
        self._state = np.concatenate([state for _, state in parts])
        # A pose in each part; uniform ones stay as they were drawn.
        low, high = self._cells[:, LOWER], self._cells[:, UPPER]
        self._poses = low + self._rng.random((len(low), 3)) * (high - low)
        self._poses[finer:] = drawn
        # In random order, so that both kinds are mixed.
        self._keep(self._rng.permutation(len(low)))

    def _node_of(self, cell: Array) -> int:
        """The node of a coarse cell."""
        name = cell.tobytes()
        if name not in self._nodes:
            self._nodes[name] = self._model.add_node(int(self._sets.face[int(cell[SET])]))
        return self._nodes[name]

    def _graded(self, count: int) -> tuple[Array, Array]:
        """Coarse cells (n, 7) of n uniform poses, and these (n, 3) as x, y, θ."""
        sets, poses = self._uniform.draw(count)
        # The coarse cell that each pose lies in.
        low, high = self._sets.low[sets], self._sets.high[sets]
        size = (high - low) / self._steps
        place = np.clip(np.floor((poses - low) / size), 0, self._steps - 1)
        corner = low + place * size
        return self._sets.cells_between(sets, corner, low + (place + 1.0) * size), poses

    def _open_parts(self, best: float) -> tuple[Array, Array]:
        """The parts of the most promising cells that may hold a goal, and what is known of them.

        Where the cell's sample was free of collision nothing is known to rule parts out.
        """
        cells, state = self._take(best)
        parts, state = halved_cells(cells), np.repeat(state, PARTS, axis=0)
        state[:, DEPTH] += 1.0
        # Only where the sample was outside, unsupported or in collision.
        doubtful = state[:, KIND] < LACKING
        if self._bounds is None or not doubtful.any():
            return parts, state
        is_open = ~doubtful
        is_open[doubtful] = self._bounds.rulings(parts[doubtful]) == Ruling.OPEN
        return parts[is_open], state[is_open]

    def _take(self, best: float) -> tuple[Array, Array]:
        """The most promising cells (n, 7), and what is known of them (n, 6)."""
        best = self._aim(best)
        # Rank anew where the aim has changed, or the samples have doubled.
        if best != self._ranked_for or self.count.samples > 2 * self._ranked_at:
            if self.count.samples > 2 * self._ranked_at:
                self._model.forget()
            self._ranked_for, self._ranked_at = best, self.count.samples
            self._filed.rank(best)
        cells: list[Array] = []
        states: list[Array] = []
        while len(cells) < _AT_ONCE and (found := self._filed.take()) is not None:
            cell, state = found
            # A coarse cell is split once only; another becomes a node.
            if state[DEPTH] == 0:
                name = cell.tobytes()
                if name in self._split:
                    continue
                self._split.add(name)
            else:
                state[NODE] = self._model.add_node(int(state[NODE]))
            cells.append(cell)
            states.append(state)
        return np.array(cells).reshape(-1, CELL_COLUMNS), np.array(states).reshape(-1, STATE)

    def _aim(self, best: float) -> float:
        """ξ that is to be improved on: ξ_best, or that of the best goal which waits for its motion;
        one that waited in vain is given up."""
        latest = self.count.samples - _PATIENCE
        # Goals that waited for too long count as tries that failed.
        for value, found_at, node in self._waiting:
            if value > best and found_at < latest:
                self._model.lose(node)
        self._waiting = [each for each in self._waiting if each[0] > best and each[1] >= latest]
        return max([best, *(value for value, _, _ in self._waiting)])


class _Cells:
    """The cells that have not been split, most promising first.

    Args:
        model: what they promise.
    """

    def __init__(self, model: ImprovementModel) -> None:
        self._model = model
        # One a row: the cell, what is known of it, and what it promises.
        self._rows = np.empty((0, CELL_COLUMNS + STATE + 2))
        self._count = 0
        self._heap: list[tuple[float, int]] = []  # by what a sample adds, negative

    def add(self, cells: Array, state: Array, best: float) -> None:
        """File cells (n, 7) with what is known of them (n, 6)."""
        # What each promises, beside what is known of it.
        rows = np.column_stack([cells, state, *self._model.promise(state, best)])
        first, end = self._count, self._count + len(rows)
        # Twice the room where all is used.
        if end > len(self._rows):
            room = np.empty((end, self._rows.shape[1]))
            self._rows = np.concatenate([self._rows[:first], rows, room])
        self._rows[first:end] = rows
        self._count = end
        for entry in self._entries(first):
            heapq.heappush(self._heap, entry)
        if len(self._heap) > MAX_CELLS:
            # the half that promises less is forgotten
            self._heap = heapq.nsmallest(MAX_CELLS // 2, self._heap)
            self.rank(best)

    def rank(self, best: float) -> None:
        """Rank all anew, and forget those that were taken."""
        self._rows = self._rows[[row for _, row in self._heap]]
        self._count = len(self._rows)
        state = self._rows[:, CELL_COLUMNS:-2]
        self._rows[:, -2:] = np.column_stack(self._model.promise(state, best))
        self._heap = sorted(self._entries(0))

    def take(self) -> tuple[Array, Array] | None:
        """Remove the most promising one: (7,), and what is known of it (6,); None without any."""
        while self._heap:
            row = self._heap[0][1]
            # It promises less by now where tries to reach poses failed.
            entry = next(self._entries(row, row + 1))
            if entry[0] <= min(self._heap[1:3], default=(0.0, 0))[0]:
                heapq.heappop(self._heap)
                found = self._rows[row].copy()
                return found[:CELL_COLUMNS], found[CELL_COLUMNS:-2]
            heapq.heapreplace(self._heap, entry)
        return None

    def _entries(self, first: int, end: int | None = None) -> Iterator[tuple[float, int]]:
        """Of rows, for the heap: what is expected of a sample and the tries that it leads to."""
        rows = self._rows[first : self._count if end is None else end]
        columns = rows[:, [-2, -1, CELL_COLUMNS + NODE]].tolist()
        for row, (gain, tried, node) in enumerate(columns, first):
            chance, cost = self._model.outlook(int(node))
            yield -gain * chance / (1.0 + tried * cost), row
