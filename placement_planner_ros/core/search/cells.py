"""Optimistic search over cells of the pose sets Ŝ(r, f): uniform samples, refined at every scale.

A cell is a face, a box of contact points on one region and an interval of θ. Uniform samples grade
the coarse cells they fall into. In each round, the best cell of every scale is split and its parts
are sampled in turn (simultaneous optimistic optimisation, Munos 2011): a cell is split once only,
so the search moves on from what has been looked at closely, and needs neither a bound on the slope
of ξ nor a constant of exploration.
"""

from __future__ import annotations

import heapq
import itertools
from collections import Counter
from collections.abc import Callable

import numpy as np

from placement_planner_ros.core.scene.region_points import RegionPoints
from placement_planner_ros.core.search.cell_layout import (
    COLUMNS,
    FACE,
    LOWER,
    PARTS,
    UPPER,
    Z,
    areas,
    extent,
    halved,
)
from placement_planner_ros.core.search.hierarchy import FULL_TURN, AfrHierarchy
from placement_planner_ros.core.search.pruning import CellBounds, Ruling
from placement_planner_ros.core.search.sampler import (
    Draws,
    GoalChecker,
    Index,
    Outcome,
    SampleCount,
    SamplerSettings,
)
from placement_planner_ros.core.types import Array, Goal, Verdict

_COARSE = 4
"""A region's extent is cut into so many coarse cells along x and y."""
_MAX_CELLS = 20_000
"""Cells of one scale that are remembered; beyond, the worse half is forgotten. Of those with a goal
as many are, and the worst is."""

_CLASS = np.array(
    [3 if v <= Verdict.UNSTABLE else 2 if v is Verdict.COLLIDING else 1 for v in Verdict]
)  # of a cell by its sample's verdict: what is free comes first, what cannot be reached after it
_CLASS[Verdict.NOT_BETTER] = _CLASS[Verdict.FEASIBLE] = 0


class CellSampler:
    """SampleGoals by optimistic search; arm and grasp are chosen once a pose is worth reaching.

    Args:
        checker: checks samples.
        rng: draws poses within cells.
        bounds: tell which cells hold nothing; None: none is known to.

    Attributes:
        rulings: how many parts of cells got each `Ruling`, those not asked about left open.
    """

    def __init__(
        self,
        hierarchy: AfrHierarchy,
        checker: GoalChecker,
        settings: SamplerSettings,
        rng: np.random.Generator,
        bounds: CellBounds | None = None,
    ) -> None:
        self.count = SampleCount()
        self.rulings: Counter[Ruling] = Counter()
        self._bounds = bounds
        self._checker = checker
        self._settings = settings
        self._rng = rng
        self._faces = hierarchy.faces
        self._points = RegionPoints(hierarchy.regions)
        surface = np.array([region.area for region in hierarchy.regions])
        even = settings.even_share
        self._shares = (1.0 - even) * surface / surface.sum() + even / max(len(surface), 1)
        self._extents = np.array([extent(region) for region in hierarchy.regions])
        self._steps = np.array([_COARSE, _COARSE, hierarchy.settings.angle_intervals**2])
        self._min_area = hierarchy.settings.min_area
        # per depth, a heap of (class, rank, number, cell): the least is split next
        self._levels: list[list[tuple[int, float, int, Array]]] = [[]]
        self._numbers = itertools.count()
        self._split: set[bytes] = set()
        # heap of cells in which a goal was found, left alone until ξ_best is no less:
        # (ξ, number, depth, cell)
        self._with_goal: list[tuple[float, int, int, Array]] = []
        # what is left of the round: cells, their depths, and the poses (x, y, θ) drawn from them
        self._cells = np.empty((0, COLUMNS))
        self._depths = np.empty(0, dtype=np.int64)
        self._poses = np.empty((0, 3))

    def sample_goals(self, best: float, should_stop: Callable[[], bool]) -> list[Goal]:
        """Algorithm 2, in rounds of uniform samples and of parts of the best cells."""
        self._return_to(best)
        goals: list[Goal] = []
        left, wanted = self._settings.samples_per_call, self._settings.goals_per_call
        while left > 0 and len(goals) < wanted and not should_stop():
            if len(self._depths) == 0:
                graded = self.count.samples >= self._settings.uniform_first
                self._begin_round(best, refine=graded and best > -np.inf)
            outcome = self._checker.check_batch(
                self._draws(left), best, wanted - len(goals), should_stop
            )
            tried = len(outcome.verdicts)
            self._remember(outcome, self._cells[:tried], self._depths[:tried])
            self._keep(slice(tried, None))
            self.count.add(outcome.verdicts)
            left -= tried
            goals += outcome.goals
        return goals

    def _keep(self, rows: slice | Index) -> None:
        self._cells, self._depths = self._cells[rows], self._depths[rows]
        self._poses = self._poses[rows]

    def _draws(self, count: int) -> Draws:
        """The next poses of the round, at most `count`."""
        cells, poses = self._cells[:count], self._poses[:count]
        undecided = np.full(len(cells), -1)
        contact = np.column_stack([poses[:, :2], cells[:, Z]])
        return Draws(undecided, undecided, cells[:, FACE].astype(np.int64), contact, poses[:, 2])

    def _begin_round(self, best: float, refine: bool) -> None:
        """Draw poses to be checked; each grades the cell it was drawn from."""
        share = self._settings.uniform_share
        parts = [self._open_parts(best)] if refine else []
        finer = sum(len(cells) for cells, _ in parts)
        count = round(finer * share / (1.0 - share)) if finer else self._settings.batch
        coarse, drawn = self._uniform(max(1, count))
        parts.append((coarse, np.zeros(len(coarse), dtype=np.int64)))
        self._cells = np.concatenate([cells for cells, _ in parts])
        self._depths = np.concatenate([depths for _, depths in parts])
        low, high = self._cells[:, LOWER], self._cells[:, UPPER]
        self._poses = low + self._rng.random((len(low), 3)) * (high - low)
        self._poses[finer:] = drawn
        self._keep(self._rng.permutation(len(low)))

    def _uniform(self, count: int) -> tuple[Array, Array]:
        """Coarse cells (n, 8) of n uniform poses, and these (n, 3) as x, y, θ."""
        rng = self._rng
        regions = rng.choice(len(self._shares), size=count, p=self._shares)
        contact = self._points.sample(regions, rng)
        poses = np.column_stack([contact[:, :2], rng.uniform(0.0, FULL_TURN, size=count)])
        low, high = self._extents[regions, ::2], self._extents[regions, 1::2]
        size = (high - low) / self._steps
        place = np.clip(np.floor((poses - low) / size), 0, self._steps - 1)
        cells = np.empty((count, COLUMNS))
        cells[:, FACE] = rng.integers(self._faces, size=count)
        cells[:, Z] = contact[:, 2]
        cells[:, LOWER] = low + place * size
        cells[:, UPPER] = low + (place + 1.0) * size
        return cells, poses

    def _remember(self, outcome: Outcome, cells: Array, depths: Index) -> None:
        """File the cells under their depth by what their sample was, leaves left out."""
        kinds = _CLASS[outcome.verdicts]
        ranks = np.where(kinds == 0, -outcome.values, self._rng.random(len(cells)))
        kept = areas(cells) > self._min_area
        found = outcome.verdicts == Verdict.FEASIBLE
        # the cells are copied one by one: a view would keep the whole round in memory
        for k in np.flatnonzero(kept & found).tolist():
            entry = float(outcome.values[k]), next(self._numbers), int(depths[k]), cells[k].copy()
            heapq.heappush(self._with_goal, entry)
            if len(self._with_goal) > _MAX_CELLS:
                heapq.heappop(self._with_goal)
        rows = np.flatnonzero(kept & ~found)
        for k, depth, kind, rank in zip(
            rows.tolist(),
            depths[rows].tolist(),
            kinds[rows].tolist(),
            ranks[rows].tolist(),
            strict=True,
        ):
            self._push(depth, kind, rank, cells[k].copy())

    def _push(self, depth: int, kind: int, rank: float, cell: Array) -> None:
        level = self._levels[depth]
        heapq.heappush(level, (kind, rank, next(self._numbers), cell))
        if len(level) > _MAX_CELLS:
            self._levels[depth] = heapq.nsmallest(_MAX_CELLS // 2, level)

    def _return_to(self, best: float) -> None:
        """Cells whose goal has been reached, or something as good, may be split again."""
        while self._with_goal and self._with_goal[0][0] <= best:
            value, _, depth, cell = heapq.heappop(self._with_goal)
            self._push(depth, 0, -value, cell)

    def _open_parts(self, best: float) -> tuple[Array, Index]:
        """The parts of the best cell of each depth that may hold a goal, and their depths.

        Where the cell's sample was free of collision only ξ could rule parts out.
        """
        cells, depths, kinds = self._split_best()
        parts, depths = halved(cells), np.repeat(depths + 1, PARTS)
        doubtful = np.repeat((kinds > 0) | self._settings.prune_objective, PARTS)
        if self._bounds is None or not doubtful.any():
            return parts, depths
        rulings = np.full(len(parts), Ruling.OPEN, dtype=np.int64)
        rulings[doubtful] = self._bounds.rulings(parts[doubtful], best)
        for ruling in Ruling:
            self.rulings[ruling] += int((rulings == ruling).sum())
        is_open = rulings == Ruling.OPEN
        return parts[is_open], depths[is_open]

    def _split_best(self) -> tuple[Array, Index, Index]:
        """Take the best cell of each depth: (n, 8), their depths (n,) and classes (n,)."""
        cells, depths, kinds = [], [], []
        for depth, level in enumerate(self._levels):
            while level:
                kind, _, _, cell = heapq.heappop(level)
                if depth == 0:
                    name = cell.tobytes()
                    if name in self._split:
                        continue
                    self._split.add(name)
                cells.append(cell)
                depths.append(depth)
                kinds.append(kind)
                break
        if depths and depths[-1] == len(self._levels) - 1:
            self._levels.append([])
        return (
            np.array(cells).reshape(-1, COLUMNS),
            np.array(depths, dtype=np.int64),
            np.array(kinds, dtype=np.int64),
        )
