"""Search by expected improvement over cells of the pose sets Ŝ(r, f), refined where that is most.

A cell is a face, a box of contact points on one region and an interval of θ. Uniform samples grade
the coarse cells they fall into. In each round the cells that promise most for their cost
(`expected_improvement`) are split and their parts sampled, beside as many uniform samples, or a
batch of these where that is more. A cell is split once only, but its parts stay: what the arms fail
to reach promises less with each try. Poses are reached for in the same order. Where samples are
usable, or better but blocked, `climbers` begin, which find pockets that no cell is small enough
for.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from placement_planner_ros.core.search.cell_layout import (
    CELLS_AT_ONCE,
    MAX_CELLS,
    Cells,
    contact_areas,
    halved_cells,
)
from placement_planner_ros.core.search.climbers import Climbers
from placement_planner_ros.core.search.expected_improvement import (
    DEEPEST,
    GRADED_CELL,
    NOT_FREE,
    TRY_SAMPLES,
    ImprovementModel,
)
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.search.pruning import CellBounds
from placement_planner_ros.core.search.sampler import (
    BatchSampler,
    Draws,
    GoalChecker,
    Outcome,
    SamplerSettings,
)
from placement_planner_ros.core.search.uniform import UniformPoses
from placement_planner_ros.core.settings import setting
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array, Index, Verdict

_REDRAWS = 4
"""Times that uniform poses are drawn where few can be better: four for one that is needed, then
twice as many each time."""


@dataclass(frozen=True, slots=True)
class OptimisticSettings(SamplerSettings):
    """Budgets, and how much is looked at before and beside the best cells.

    Attributes:
        batch: uniform samples at least whose cheap checks are made together.
        uniform_first: samples before the search begins to refine; until then all are uniform, so
            that the coarse cells have been graded.
        even_share: of all uniform samples: drawn from all regions alike instead of by area, since
            what is best may stand on a small one.
        climbers: usable poses that climb at a time, once there is a placement, beside up to twice
            as many blocked ones; see `Climbers`.
    """

    uniform_first: int = setting(600, "[0, inf)")
    even_share: float = setting(0.5, "[0, 1]")
    climbers: int = setting(100, "[0, 1000]")


class OptimisticSampler(BatchSampler):
    """SampleGoals by optimistic search; arm and grasp are chosen once a pose is worth reaching.

    Args:
        checker: checks samples.
        rng: draws poses within cells.
        bounds: tell what ξ is at most in a cell; None: nothing is known.
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
        self._bounds = bounds
        self._rng = rng
        self._uniform = UniformPoses(hierarchy, rng, settings.even_share)
        self._climbers = Climbers(hierarchy.sets, settings.climbers, rng)
        self._sets = hierarchy.sets
        # a coarse cell lies two levels of the hierarchy below its pose set
        self._shape = (max(len(self._sets), 1), 4, 4, hierarchy.settings.angle_intervals**2)
        self._min_area = hierarchy.settings.min_area
        self._model = ImprovementModel(hierarchy.faces)
        # the cells that have not been split, and what each promises, -1 where there is none; which
        # of the coarse ones have been, and False for all others
        self._filed = np.zeros(MAX_CELLS, dtype=GRADED_CELL)
        self._worth = np.full(MAX_CELLS, -1.0)
        self._room = np.arange(MAX_CELLS)  # rows for new ones
        self._split = np.zeros(math.prod(self._shape) + 1, np.bool_)
        self._nodes = np.full(len(self._split), -1)  # of the coarse cells, once graded
        self._most = np.full(len(self._split), np.nan)  # what ξ is at most there, once asked for
        # goals that wait for their motion: ξ, and the cell that they were found in
        self._waiting: list[tuple[float, np.void]] = []
        self._ranked_for = -np.inf  # ξ by which the cells are ranked
        self._ranked_at = 0  # samples by which they are
        # the cells that poses were drawn from last, these poses, and which of them are uniform
        self._drawn, self._places, self._evenly = self._filed[:0], np.empty((0, 3)), slice(0)
        # uniform poses that are left for the next batch with their cells, and ξ_best of then
        self._spare, self._spare_for = (self._drawn, self._places), -np.inf

    def _draw(self, best: float) -> Draws:
        """Poses in parts of the most promising cells, and uniform ones; only these at first, and
        while goals wait for the first motion: what is best is hard to reach, what is drawn
        evenly is as hard as it is in the mean."""
        # Goals count as reached once they, or something as good, were placed.
        for _, cell in (each for each in self._waiting if each[0] <= best):
            self._model.count_try(cell, 0.0, 1.0)
        self._waiting = [each for each in self._waiting if each[0] > best]
        left = self._settings.uniform_first - self.count.samples
        early = left > 0 or (best == -np.inf and self._waiting)
        parts = np.empty(0, dtype=GRADED_CELL) if early else self._parts(best)
        # A placement takes as long as some thousands of samples: once there is one, the rest of the
        # grading is one batch.
        count = max(self._budget.batch, len(parts), left if best > -np.inf else 0)
        # A pose in each part, and the coarse cells of uniform ones.
        within = parts["low"] + self._rng.random((len(parts), 3)) * (parts["high"] - parts["low"])
        coarse, drawn = self._even(count, best)
        # And the next step of each climber.
        sets, steps, above, failed = self._climbers.propose(best)
        climbing = self._as_nodes(self._coarse_cells(sets, steps))
        climbing["failed"] = failed
        self._drawn = np.concatenate([parts, coarse, climbing])
        self._places = np.concatenate([within, drawn, steps])
        self._evenly = slice(len(parts), len(parts) + len(coarse))
        least = np.concatenate([np.full(self._evenly.stop, np.nan), above])
        return replace(self._sets.draws(self._drawn["set"], self._places), least=least)

    def _order(self, rows: Index, outcome: Outcome, best: float) -> Iterator[int]:
        """As drawn until something is found; then what promises most for its cost first."""
        if best > -np.inf:
            promise = self._model.promise_of_tries(self._drawn[rows], outcome.values[rows], best)
            # Tries take no longer than samples; what is left is filed.
            tries = 1 + len(self._drawn) // TRY_SAMPLES
            rows = rows[np.argsort(-promise, kind="stable")[:tries]]
        yield from rows.tolist()

    def _learn(self, outcome: Outcome, best: float) -> None:
        """File the cells by what their sample was."""
        cells, verdicts, tried = self._drawn, outcome.verdicts, outcome.tried
        # A try that fails makes others nearby promise less, and most of all those of its climber.
        for row in np.flatnonzero(tried).tolist():
            self._model.count_try(cells[row], 1.0, 0.0)
            if verdicts[row] == Verdict.FEASIBLE:
                self._waiting.append((float(outcome.values[row]), cells[row].copy()))
        # Climbers learn of their own steps; others begin at usable uniform poses, and at any that
        # are better but lack more than an arm that is long enough.
        end, values, usable = self._evenly.stop, outcome.values, outcome.usable
        so_far = np.where(usable, Verdict.FEASIBLE, verdicts)
        failed = tried & (verdicts < Verdict.FEASIBLE)
        self._climbers.learn(values[end:], so_far[end:], failed[end:])
        if best > -np.inf:
            begins = (so_far > Verdict.NO_IK) & ~usable
            begins[self._evenly] |= usable[self._evenly]
            rows = np.flatnonzero(begins[:end])
            self._climbers.begin(cells["set"][rows], self._places[rows], values[rows], so_far[rows])
        # Cells learn of what was drawn in them.
        cells, verdicts, values, usable = cells[:end], verdicts[:end], values[:end], usable[:end]
        self._model.learn(cells, replace(outcome, verdicts=verdicts, values=values, usable=usable))
        # A cell too small to be split is split nevertheless if what is better there is not reached.
        missed = usable & (values > best) & (verdicts < Verdict.FEASIBLE)
        self._file(cells[(contact_areas(cells) > self._min_area) | missed])

    def _even(self, count: int, best: float) -> tuple[Cells, Array]:
        """The coarse cells (n,) of uniform poses, and these (n, 3) as x, y, θ: so many, each kept
        the likelier the more ξ of its cell may be above `best`; some, where few are kept."""
        bounds = self._bounds
        # What the last call kept beyond its count is kept still while ξ_best is the same.
        cells, poses = self._spare if best == self._spare_for else self._coarse(0)
        if best > -np.inf and bounds is not None and bounds.bounded:
            for times in range(_REDRAWS):
                if len(cells) >= count:
                    break
                more, places = self._kept(*self._coarse(4 * count << times), best, bounds)
                cells, poses = np.append(cells, more), np.vstack([poses, places])
        if not len(cells):
            cells, poses = self._coarse(count)
        self._spare, self._spare_for = (cells[count:], poses[count:]), best
        return self._as_nodes(cells[:count]), poses[:count]

    def _kept(self, cells: Cells, poses: Array, best: float, by: CellBounds) -> tuple[Cells, Array]:
        """Those of coarse cells (n,) with a pose each that are kept: a share that is what ξ may be
        above `best` at most, of what that is anywhere."""
        coarse, first = np.unique(cells["coarse"], return_index=True)
        new = np.isnan(self._most[coarse])
        step("bounding the objective")
        self._most[coarse[new]] = by.most(cells[first[new]], rough=True)
        share = self._rng.random(len(cells)) * max(np.nanmax(self._most) - best, 0.0)
        is_kept = self._most[cells["coarse"]] - best > share
        return cells[is_kept], poses[is_kept]

    def _coarse(self, count: int) -> tuple[Cells, Array]:
        """The coarse cells (n,) of n uniform poses, and these (n, 3) as x, y, θ."""
        sets, poses = self._uniform.draw(count)
        return self._coarse_cells(sets, poses), poses

    def _coarse_cells(self, sets: Index, poses: Array) -> Cells:
        """The coarse cells (n,) that places (n, 3) of pose sets (n,) lie in."""
        low, high = self._sets.low[sets], self._sets.high[sets]
        steps = np.array(self._shape[1:])
        size = (high - low) / steps
        place = np.clip(np.floor((poses - low) / size), 0, steps - 1).astype(np.int64)
        corner = low + place * size
        cells = np.zeros(len(sets), dtype=GRADED_CELL)
        cells["set"], cells["low"], cells["high"] = sets, corner, low + (place + 1.0) * size
        cells["coarse"] = np.ravel_multi_index((sets, *place.T), self._shape)
        return cells

    def _as_nodes(self, cells: Cells) -> Cells:
        """Coarse cells (n,) as they are graded, each a node."""
        # Tries in a coarse cell are counted there, and to its face.
        graded, first = np.unique(cells["coarse"], return_index=True)
        new = self._nodes[graded] < 0
        self._nodes[graded[new]] = self._model.add_nodes(self._sets.face[cells["set"][first[new]]])
        cells["node"] = self._nodes[cells["coarse"]]
        cells["kind"], cells["value"], cells["scale"] = NOT_FREE, self._model.mean, -1
        return cells

    def _parts(self, best: float) -> Cells:
        """The parts (n,) of the most promising cells, which are filed no longer; each of these is a
        node now."""
        # Rank anew where something was placed, or the samples have doubled.
        if self.count.samples > 2 * self._ranked_at or best != self._ranked_for:
            self._ranked_for, self._ranked_at = best, self.count.samples
            self._rank(np.flatnonzero(self._worth >= 0.0))
        # The most promising, by what is known of them now.
        rows = np.argpartition(-self._worth, 2 * CELLS_AT_ONCE)[: 2 * CELLS_AT_ONCE]
        rows = rows[self._worth[rows] > 0.0]
        self._rank(rows)
        taken: list[int] = []
        for row in rows[np.argsort(-self._worth[rows], kind="stable")].tolist():
            if len(taken) == CELLS_AT_ONCE:
                break
            self._worth[row] = -1.0
            # A coarse cell is filed as often as it was graded, and split once only.
            coarse = int(self._filed["coarse"][row])
            if not self._split[coarse]:
                self._split[coarse] = coarse >= 0
                taken.append(row)
        cells = self._filed[taken]
        cells["node"] = self._model.add_nodes(cells["node"])
        parts = halved_cells(cells)
        parts["depth"], parts["coarse"] = np.minimum(parts["depth"] + 1, DEEPEST), -1
        return parts

    def _file(self, cells: Cells) -> None:
        """Remember cells (n,) with what is known of them, in place of those that promise least."""
        cells = cells[~self._split[cells["coarse"]]]
        if len(self._room) < len(cells):
            self._room = np.argsort(self._worth)[: MAX_CELLS // 2]
        rows, self._room = np.split(self._room, [len(cells)])
        self._filed[rows] = cells
        self._rank(rows)

    def _rank(self, rows: Index) -> None:
        """Note what these of the cells promise now."""
        self._worth[rows] = self._model.promise(self._filed[rows], self._ranked_for)
