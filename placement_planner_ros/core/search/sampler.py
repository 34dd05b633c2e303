"""SampleGoals (Algorithm 2): Monte-Carlo tree search and the uniform ablation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.scene.region_points import RegionPoints
from placement_planner_ros.core.search.hierarchy import FULL_TURN, AfrHierarchy
from placement_planner_ros.core.search.tree import SearchTree
from placement_planner_ros.core.types import Array, Goal, Verdict

Index = npt.NDArray[np.int64]
Terms = tuple[bool, bool, bool, bool]


@dataclass(frozen=True, slots=True)
class SamplerSettings:
    """Budgets and rewards of SampleGoals.

    Attributes:
        samples_per_call: g_max, samples tried in one call at most.
        goals_per_call: a call ends once it has found that many goals.
        exploration: c of UCB1.
        reward: H, `checks_passed` (share of the ordered checks passed before the first failure)
            or `four_term` (the authors': mean of arm free, object free, stable, better; 0 without
            IK, and every check is made on every sample).
        max_nodes: bound on the tree's size.
        batch: samples whose cheap checks are made together. Each selection of a batch takes those
            before it for samples without reward; 1 is the paper's algorithm to the letter.
        selection: `ucb1` (Algorithm 3) or `optimistic` (cells.CellSampler, which takes nothing of
            exploration, reward and max_nodes).
        uniform_first: samples before optimistic search begins to refine; until then all are
            uniform, so that the coarse cells have been graded.
        uniform_share: of optimistic search's samples after these, at least, in [0, 1).
        even_share: of these, in [0, 1]: drawn from all regions alike instead of by area, since what
            is best may stand on a small one.
        prune_reach, prune_support, prune_objective: whether branches are ruled out that are out of
            reach, that cannot support the face, or where ξ has an upper bound not above ξ_best. The
            last costs more samples than it saves, unless the objective's bounds are cheap.
    """

    samples_per_call: int = 200
    goals_per_call: int = 1
    exploration: float = 0.5
    reward: Literal["checks_passed", "four_term"] = "checks_passed"
    max_nodes: int = 200_000
    batch: int = 16
    selection: Literal["ucb1", "optimistic"] = "optimistic"
    uniform_first: int = 2000
    uniform_share: float = 0.5
    even_share: float = 0.5
    prune_reach: bool = True
    prune_support: bool = True
    prune_objective: bool = False

    def __post_init__(self) -> None:
        if self.samples_per_call < 1 or self.goals_per_call < 1:
            raise ParameterError(
                "samples_per_call, goals_per_call",
                (self.samples_per_call, self.goals_per_call),
                "must be at least 1",
            )
        if self.batch < 1:
            raise ParameterError("batch", self.batch, "must be at least 1")
        if self.uniform_first < 0:
            raise ParameterError("uniform_first", self.uniform_first, "must be zero or larger")
        if not 0.0 <= self.uniform_share < 1.0:
            raise ParameterError("uniform_share", self.uniform_share, "must be in [0, 1)")
        if self.selection not in ("ucb1", "optimistic"):
            raise ParameterError("selection", self.selection, "choose ucb1 or optimistic")
        if self.reward not in ("checks_passed", "four_term"):
            raise ParameterError("reward", self.reward, "choose checks_passed or four_term")


@dataclass(frozen=True, slots=True, eq=False)
class Draws:
    """Poses drawn but not checked yet, (n,) each; arm and grasp are -1 where any will do.

    Attributes:
        contact: (n, 3).
    """

    arm: Index
    grasp: Index
    face: Index
    contact: Array
    angle: Array


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What became of the first m draws.

    Attributes:
        verdicts: (m,) of each.
        values: (m,) ξ where it was computed, else -inf.
        goals: those found, in order.
        terms: (reached, arm free, object free, stable), where every check was made.
    """

    verdicts: Index
    values: Array
    goals: list[Goal]
    terms: list[Terms] | None = None


class GoalChecker(Protocol):
    """Checks samples against every constraint of the problem."""

    def check_batch(
        self, draws: Draws, best: float, goals: int, should_stop: Callable[[], bool]
    ) -> Outcome:
        """Each up to the first check that fails, cheap checks first.

        Ends with the draw that gives the last of so many goals, or when told to stop; draws after
        it do not count.
        """
        ...

    def check_all(
        self, draws: Draws, best: float, goals: int, should_stop: Callable[[], bool]
    ) -> Outcome:
        """The same without stopping at the first failure, with `terms` filled."""
        ...


@dataclass(slots=True)
class SampleCount:
    """Running totals, read by other threads.

    Attributes:
        samples: samples tried.
        verdicts: how many ended with each verdict.
    """

    samples: int = 0
    verdicts: Counter[Verdict] = field(default_factory=lambda: Counter(dict.fromkeys(Verdict, 0)))

    def add(self, verdicts: npt.ArrayLike) -> None:
        """Count samples with these verdicts."""
        counts = np.bincount(np.atleast_1d(verdicts), minlength=len(Verdict))
        self.samples += int(counts.sum())
        for verdict in Verdict:
            self.verdicts[verdict] += int(counts[verdict])


class GoalSampler(Protocol):
    """SampleGoals with its state G_s."""

    count: SampleCount

    def sample_goals(self, best: float, should_stop: Callable[[], bool]) -> list[Goal]:
        """Goals better than `best`; ends at its budgets or when told to stop."""
        ...


def checks_passed(verdict: int, better: bool = True) -> float:
    """H(x, q, ξ_best) ∈ [0, 1]: the share of the ordered checks passed.

    Args:
        better: False for what it becomes once the sample no longer beats ξ_best.
    """
    passed = verdict if better else min(verdict, int(Verdict.NOT_BETTER))
    return passed / int(Verdict.FEASIBLE)


def four_term(terms: Terms, better: bool) -> float:
    """H in the authors' form, from (reached, arm free, object free, stable)."""
    reached, arm_free, object_free, stable = terms
    if not reached:
        return 0.0
    return 0.25 * (arm_free + object_free + stable + (object_free and stable and better))


class MctsSampler:
    """SampleGoals guided by UCB1 over the AFR hierarchy.

    Args:
        checker: checks one sample.
        rng: chooses added children and samples poses.
    """

    def __init__(
        self,
        hierarchy: AfrHierarchy,
        checker: GoalChecker,
        settings: SamplerSettings,
        rng: np.random.Generator,
    ) -> None:
        self.count = SampleCount()
        self.tree = SearchTree(
            hierarchy,
            hierarchy.MIN_SAMPLE_DEPTH,
            settings.exploration,
            settings.max_nodes,
            rng,
        )
        self._check = (
            checker.check_batch if settings.reward == "checks_passed" else checker.check_all
        )
        self._settings = settings
        self._rng = rng

    def sample_goals(self, best: float, should_stop: Callable[[], bool]) -> list[Goal]:
        """Algorithm 2."""
        self.tree.raise_threshold(best)
        goals: list[Goal] = []
        left, wanted = self._settings.samples_per_call, self._settings.goals_per_call
        while left > 0 and len(goals) < wanted and not should_stop():
            nodes = self._select(min(left, self._settings.batch))
            outcome = self._check(self._draw(nodes), best, wanted - len(goals), should_stop)
            for n in nodes:
                self.tree.release(n)
            self._reward(nodes, outcome, best)
            self.count.add(outcome.verdicts)
            left -= len(outcome.verdicts)
            goals += outcome.goals
        return goals

    def _select(self, count: int) -> list[int]:
        """So many selections, each taking those before it for samples without reward."""
        nodes = []
        for _ in range(count):
            nodes.append(self.tree.select())
            self.tree.hold(nodes[-1])
        return nodes

    def _draw(self, nodes: list[int]) -> Draws:
        chosen = [self.tree[n] for n in nodes]
        drawn = [node.sample(self._rng) for node in chosen]
        return Draws(
            np.array([node.arm for node in chosen]),
            np.array([node.grasp for node in chosen]),
            np.array([node.face for node in chosen]),
            np.array([contact for contact, _ in drawn]),
            np.array([angle for _, angle in drawn]),
        )

    def _reward(self, nodes: list[int], outcome: Outcome, best: float) -> None:
        for k, (verdict, value) in enumerate(
            zip(outcome.verdicts.tolist(), outcome.values.tolist(), strict=True)
        ):
            reached = verdict == Verdict.FEASIBLE
            if self.tree.is_leaf(nodes[k]):
                reward, demoted = float(reached), 0.0
            elif outcome.terms is None:
                reward, demoted = checks_passed(verdict), checks_passed(verdict, better=False)
            else:
                reward = four_term(outcome.terms[k], better=value > best)
                demoted = four_term(outcome.terms[k], better=False)
            self.tree.update(nodes[k], reward, value, demoted)


class UniformSampler:
    """The ablation: arm, grasp and face uniformly, region by area, pose uniformly in it."""

    def __init__(
        self,
        hierarchy: AfrHierarchy,
        checker: GoalChecker,
        settings: SamplerSettings,
        rng: np.random.Generator,
    ) -> None:
        self.count = SampleCount()
        self._checker = checker
        self._settings = settings
        self._rng = rng
        self._faces = hierarchy.faces
        self._points = RegionPoints(hierarchy.regions)
        self._grasps = np.array(hierarchy.grasps_per_arm)
        self._arms = np.flatnonzero(self._grasps)
        areas = np.array([region.area for region in hierarchy.regions])
        self._shares = areas / areas.sum()

    def sample_goals(self, best: float, should_stop: Callable[[], bool]) -> list[Goal]:
        """Algorithm 2 with SelectAfrNode replaced by a uniform choice."""
        goals: list[Goal] = []
        left, wanted = self._settings.samples_per_call, self._settings.goals_per_call
        while left > 0 and len(goals) < wanted and not should_stop():
            draws = self._draw(min(left, self._settings.batch))
            outcome = self._checker.check_batch(draws, best, wanted - len(goals), should_stop)
            self.count.add(outcome.verdicts)
            left -= len(outcome.verdicts)
            goals += outcome.goals
        return goals

    def _draw(self, count: int) -> Draws:
        rng = self._rng
        arm = self._arms[rng.integers(len(self._arms), size=count)]
        regions = rng.choice(len(self._shares), size=count, p=self._shares)
        return Draws(
            arm,
            rng.integers(self._grasps[arm]),
            rng.integers(self._faces, size=count),
            self._points.sample(regions, rng),
            rng.uniform(0.0, FULL_TURN, size=count),
        )
