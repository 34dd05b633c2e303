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
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.search.cell_layout import (
    CELL_COLUMNS,
    FACE,
    LOWER,
    PARTS,
    SLOPE,
    UPPER,
    Z,
    contact_areas,
    contact_points,
    halved_cells,
    region_extent,
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
from placement_planner_ros.core.types import Array, Goal, Verdict

_LOWEST_VALUE = -1e300
"""Of values that are ranked."""
_COARSE_CELLS = 4
"""A region's extent is cut into so many coarse cells along x and y."""
_MAX_CELLS = 20_000
"""Cells of one scale that are remembered; beyond, the worse half is forgotten. Of those with a goal
as many are, and the worst is."""

_UNREACHED = 1
_VERDICT_CLASS = np.array(
    [3 if v <= Verdict.UNSTABLE else 2 if v is Verdict.COLLIDING else _UNREACHED for v in Verdict]
)  # of a cell by its sample's verdict: what is free comes first, what cannot be reached after it
_VERDICT_CLASS[[Verdict.BREAKS_RULE, Verdict.NOT_BETTER, Verdict.FEASIBLE]] = 0


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
        unreached: whether cells whose sample was better than ξ_best but not reached by any arm are
            split, too, in each round one of one scale, instead of after all whose sample was free.
            `PlacementPlanner` asks for it with weighted objectives.
    """

    uniform_first: int = setting(2000, "[0, inf)")
    uniform_share: float = setting(0.5, "[0, 1)")
    even_share: float = setting(0.5, "[0, 1]")
    prune: bool = True
    unreached: bool = False


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
        self._extents = np.array([region_extent(region) for region in hierarchy.regions])
        self._heights = np.array([region.z for region in hierarchy.regions])
        self._steps = np.array(
            [_COARSE_CELLS, _COARSE_CELLS, hierarchy.settings.angle_intervals**2]
        )
        self._min_area = hierarchy.settings.min_area
        # per depth, a heap of (class, rank, number, cell): the least is split next
        self._levels: list[list[tuple[int, float, int, Array]]] = [[]]
        # per depth, a heap of (rank, number, ξ, cell) of those that were better but not reached
        self._unreached: list[list[tuple[float, int, float, Array]]] = [[]]
        self._turns = itertools.count()
        self._numbers = itertools.count()
        self._split: set[bytes] = set()
        self._lacking = False  # whether a rule has refused poses: what lacks least shows where
        # heap of cells in which a goal was found, left alone until ξ_best is no less:
        # (ξ, number, depth, cell)
        self._with_goal: list[tuple[float, int, int, Array]] = []
        # what is left of the round: cells, their depths, and the poses (x, y, θ) drawn from them
        self._cells = np.empty((0, CELL_COLUMNS))
        self._depths = np.empty(0, dtype=np.int64)
        self._poses = np.empty((0, 3))

    def sample_goals(self, best: float, should_stop: Callable[[], bool]) -> list[Goal]:
        """Algorithm 2, in rounds of uniform samples and of parts of the best cells."""
        # cells whose goal has been reached, or something as good, may be split again
        while self._with_goal and self._with_goal[0][0] <= best:
            value, _, depth, cell = heapq.heappop(self._with_goal)
            self._push(depth, 0, -value, cell)
        return super().sample_goals(best, should_stop)

    def _draw(self, most: int, best: float) -> Draws:
        """The next poses of the round, at most so many; of a new round where it is over."""
        # A new round, with parts of cells once it is known what is good.
        if len(self._depths) == 0:
            graded = self.count.samples >= self._settings.uniform_first
            self._begin_round(graded and (best > -np.inf or self._lacking), best)
        cells, poses = self._cells[:most], self._poses[:most]
        undecided = np.full(len(cells), -1)
        return Draws(
            undecided,
            undecided,
            cells[:, FACE].astype(np.int64),
            contact_points(cells, poses[:, :2]),
            poses[:, 2],
            cells[:, [SLOPE, SLOPE + 1]],
        )

    def _learn(self, outcome: Outcome, best: float) -> None:
        """The rest of the round is drawn from next."""
        tried = len(outcome.verdicts)
        self._lacking |= bool((outcome.verdicts == Verdict.BREAKS_RULE).any())
        self._remember(outcome, self._cells[:tried], self._depths[:tried])
        self._keep(slice(tried, None))

    def _keep(self, rows: slice | Index) -> None:
        self._cells, self._depths = self._cells[rows], self._depths[rows]
        self._poses = self._poses[rows]

    def _begin_round(self, refine: bool, best: float = -np.inf) -> None:
        """Draw poses to be checked; each grades the cell it was drawn from."""
        # Parts of the best cells, and uniform poses beside them.
        share = self._settings.uniform_share
        parts = [self._open_parts(best)] if refine else []
        finer = sum(len(cells) for cells, _ in parts)
        count = round(finer * share / (1.0 - share)) if finer else self._budget.batch
        coarse, drawn = self._graded(max(1, count))
        parts.append((coarse, np.zeros(len(coarse), dtype=np.int64)))
        self._cells = np.concatenate([cells for cells, _ in parts])
        self._depths = np.concatenate([depths for _, depths in parts])
        # A pose at random in each part; the uniform poses are those drawn.
        low, high = self._cells[:, LOWER], self._cells[:, UPPER]
        self._poses = low + self._rng.random((len(low), 3)) * (high - low)
        self._poses[finer:] = drawn
        self._keep(self._rng.permutation(len(low)))

    def _graded(self, count: int) -> tuple[Array, Array]:
        """Coarse cells (n, 10) of n uniform poses, and these (n, 3) as x, y, θ."""
        # Uniform poses, and the extent of the pose set that each is from.
        drawn = self._uniform.draw(count)
        regions = drawn.region
        poses = np.column_stack([drawn.contact[:, :2], drawn.angle])
        low, high = np.empty((count, 3)), np.empty((count, 3))
        low[:, :2], high[:, :2] = self._extents[regions, ::2], self._extents[regions, 1::2]
        low[:, 2], high[:, 2] = drawn.low, drawn.high
        # The coarse cell that the pose lies in.
        size = (high - low) / self._steps
        place = np.clip(np.floor((poses - low) / size), 0, self._steps - 1)
        cells = np.empty((count, CELL_COLUMNS))
        cells[:, FACE] = drawn.face
        cells[:, Z] = self._heights[regions]
        cells[:, [SLOPE, SLOPE + 1]] = self._uniform.slopes[regions]
        cells[:, LOWER] = low + place * size
        cells[:, UPPER] = low + (place + 1.0) * size
        return cells, poses

    def _remember(self, outcome: Outcome, cells: Array, depths: Index) -> None:
        """File the cells under their depth by what their sample was, leaves left out."""
        # Classes of the verdicts; within the best class by ξ, else by chance.
        kinds = _VERDICT_CLASS[outcome.verdicts]
        worth = np.maximum(outcome.values, _LOWEST_VALUE)
        ranks = np.where(kinds == 0, -worth, self._rng.random(len(cells)))
        kept = contact_areas(cells) > self._min_area
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
            if kind == _UNREACHED and self._settings.unreached:
                unreached = self._unreached[depth]
                better = rank, next(self._numbers), float(worth[k]), cells[k].copy()
                heapq.heappush(unreached, better)
                if len(unreached) > _MAX_CELLS:
                    self._unreached[depth] = heapq.nsmallest(_MAX_CELLS // 2, unreached)

    def _push(self, depth: int, kind: int, rank: float, cell: Array) -> None:
        level = self._levels[depth]
        heapq.heappush(level, (kind, rank, next(self._numbers), cell))
        if len(level) > _MAX_CELLS:
            self._levels[depth] = heapq.nsmallest(_MAX_CELLS // 2, level)

    def _open_parts(self, best: float) -> tuple[Array, Index]:
        """The parts of the best cell of each depth that may hold a goal, and their depths.

        Where the cell's sample was free of collision nothing is known to rule parts out.
        """
        cells, depths, kinds = self._split_best(best)
        parts, depths = halved_cells(cells), np.repeat(depths + 1, PARTS)
        doubtful = np.repeat(kinds > 0, PARTS)
        if self._bounds is None or not doubtful.any():
            return parts, depths
        is_open = ~doubtful
        is_open[doubtful] = self._bounds.rulings(parts[doubtful]) == Ruling.OPEN
        return parts[is_open], depths[is_open]

    def _split_best(self, best: float = -np.inf) -> tuple[Array, Index, Index]:
        """Take the best cell of each depth: (n, 10), their depths (n,) and classes (n,); at the
        depth whose turn it is, one whose sample was better but not reached, if there is any."""
        cells, depths, kinds = [], [], []
        turn = next(self._turns) % len(self._levels)
        # The best cell of each depth; coarse cells only once.
        for depth, level in enumerate(self._levels):
            unreached = self._next_unreached(depth, best) if depth == turn else None
            if unreached is not None:
                cells.append(unreached)
                depths.append(depth)
                kinds.append(_UNREACHED)
                continue
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
            self._unreached.append([])
        return (
            np.array(cells).reshape(-1, CELL_COLUMNS),
            np.array(depths, dtype=np.int64),
            np.array(kinds, dtype=np.int64),
        )

    def _next_unreached(self, depth: int, best: float) -> Array | None:
        """A cell of that depth whose sample was better than ξ_best but not reached."""
        unreached = self._unreached[depth]
        while unreached:
            _, _, value, cell = heapq.heappop(unreached)
            if value <= best:
                continue
            if depth == 0:
                name = cell.tobytes()
                if name in self._split:
                    continue
                self._split.add(name)
            return cell
        return None
