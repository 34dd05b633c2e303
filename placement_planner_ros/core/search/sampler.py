"""SampleGoals (Algorithm 2): Monte-Carlo tree search and the uniform ablation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.search.hierarchy import AfrHierarchy, AfrNode
from placement_planner_ros.core.search.tree import SearchTree
from placement_planner_ros.core.types import Array, Goal, Verdict


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
    """

    samples_per_call: int = 200
    goals_per_call: int = 1
    exploration: float = 0.5
    reward: Literal["checks_passed", "four_term"] = "checks_passed"
    max_nodes: int = 200_000

    def __post_init__(self) -> None:
        if self.samples_per_call < 1 or self.goals_per_call < 1:
            raise ParameterError(
                "samples_per_call, goals_per_call",
                (self.samples_per_call, self.goals_per_call),
                "must be at least 1",
            )
        if self.reward not in ("checks_passed", "four_term"):
            raise ParameterError("reward", self.reward, "choose checks_passed or four_term")


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """What became of one sample.

    Attributes:
        verdict: the first check that failed, or FEASIBLE.
        value: ξ(x) where it was computed and beat ξ_best, else -inf.
        goal: the goal, where feasible.
        terms: (reached, arm free, object free, stable), where every check was made.
    """

    verdict: Verdict
    value: float = -np.inf
    goal: Goal | None = None
    terms: tuple[bool, bool, bool, bool] | None = None


class GoalChecker(Protocol):
    """Checks one sample against every constraint of the problem."""

    def check(self, node: AfrNode, contact: Array, angle: float, best: float) -> Sample:
        """Check pose (contact, θ) for the node's arm, grasp and face; cheap checks first."""
        ...

    def check_all(self, node: AfrNode, contact: Array, angle: float, best: float) -> Sample:
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

    def add(self, verdict: Verdict) -> None:
        """Count one sample."""
        self.samples += 1
        self.verdicts[verdict] += 1


class GoalSampler(Protocol):
    """SampleGoals with its state G_s."""

    count: SampleCount

    def sample_goals(self, best: float, should_stop: Callable[[], bool]) -> list[Goal]:
        """Goals better than `best`; ends at its budgets or when told to stop."""
        ...


def heuristic_reward(sample: Sample) -> float:
    """H(x, q, ξ_best) ∈ [0, 1] of a sample from a node that is no leaf."""
    if sample.terms is None:
        return int(sample.verdict) / int(Verdict.FEASIBLE)
    return _four_term(sample.terms, better=sample.value > -np.inf)


def demoted_reward(sample: Sample) -> float:
    """What H becomes for a sample that no longer beats ξ_best."""
    if sample.terms is None:
        return min(int(sample.verdict), int(Verdict.NOT_BETTER)) / int(Verdict.FEASIBLE)
    return _four_term(sample.terms, better=False)


def _four_term(terms: tuple[bool, bool, bool, bool], better: bool) -> float:
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
        self._check = checker.check if settings.reward == "checks_passed" else checker.check_all
        self._settings = settings
        self._rng = rng

    def sample_goals(self, best: float, should_stop: Callable[[], bool]) -> list[Goal]:
        """Algorithm 2."""
        self.tree.raise_threshold(best)
        goals: list[Goal] = []
        for _ in range(self._settings.samples_per_call):
            if len(goals) >= self._settings.goals_per_call or should_stop():
                break
            n = self.tree.select()
            node = self.tree[n]
            contact, angle = node.sample(self._rng)
            sample = self._check(node, contact, angle, best)
            self.count.add(sample.verdict)
            if self.tree.is_leaf(n):
                self.tree.update(n, float(sample.goal is not None), sample.value, 0.0)
            else:
                self.tree.update(n, heuristic_reward(sample), sample.value, demoted_reward(sample))
            if sample.goal is not None:
                goals.append(sample.goal)
        return goals


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
        self._hierarchy = hierarchy
        self._check = checker.check
        self._settings = settings
        self._rng = rng
        areas = np.array([region.area for region in hierarchy.regions])
        self._shares = areas / areas.sum()
        self._arms = [a for a, n in enumerate(hierarchy.grasps_per_arm) if n > 0]

    def sample_goals(self, best: float, should_stop: Callable[[], bool]) -> list[Goal]:
        """Algorithm 2 with SelectAfrNode replaced by a uniform choice."""
        goals: list[Goal] = []
        rng = self._rng
        for _ in range(self._settings.samples_per_call):
            if len(goals) >= self._settings.goals_per_call or should_stop():
                break
            arm = self._arms[rng.integers(len(self._arms))]
            node = AfrNode(
                arm=arm,
                grasp=int(rng.integers(self._hierarchy.grasps_per_arm[arm])),
                face=int(rng.integers(self._hierarchy.faces)),
                region=self._hierarchy.regions[rng.choice(len(self._shares), p=self._shares)],
            )
            contact, angle = node.sample(rng)
            sample = self._check(node, contact, angle, best)
            self.count.add(sample.verdict)
            if sample.goal is not None:
                goals.append(sample.goal)
        return goals
