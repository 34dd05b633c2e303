"""Monte-Carlo tree search over the AFR hierarchy: Algorithms 2 and 3 with the rewards of H."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.search.sampler import (
    BatchSampler,
    Draws,
    GoalChecker,
    Outcome,
    SamplerSettings,
    Terms,
)
from placement_planner_ros.core.search.tree import SearchTree
from placement_planner_ros.core.settings import setting
from placement_planner_ros.core.types import Goal, Verdict

RewardName = Literal["checks_passed", "four_term"]


@dataclass(frozen=True, slots=True)
class MctsSettings(SamplerSettings):
    """Budgets, exploration and rewards.

    Attributes:
        batch: as in `SamplerSettings`. Each selection of a batch takes those before it for samples
            without reward; 1 is the paper's algorithm to the letter, where no goal
            ends a call early (`goals_per_call`).
        exploration: c of UCB1.
        reward: H, `checks_passed` (share of the ordered checks passed before the first failure)
            or `four_term` (the authors': mean of arm free, object free, stable, better; 0 without
            IK, and every check is made on every sample).
        max_nodes: bound on the tree's size.
    """

    batch: int = setting(64, "[1, inf)")
    exploration: float = setting(1.0, "[0, inf)")
    reward: RewardName = setting("checks_passed", choices=get_args(RewardName))
    max_nodes: int = setting(200_000, "[1, inf)")


def checks_passed(verdict: int, better: bool = True) -> float:
    """H(x, q, ξ_best) ∈ [0, 1]: the share of the ordered checks passed, the rules of users and
    ξ > ξ_best being one.

    Args:
        better: False for what it becomes once the sample no longer beats ξ_best.
    """
    passed = verdict if better else min(verdict, int(Verdict.NOT_BETTER))
    passed -= passed > Verdict.BREAKS_RULE
    return passed / (int(Verdict.FEASIBLE) - 1)


def four_term(terms: Terms, better: bool) -> float:
    """H in the authors' form, from (reached, arm free, object free, stable)."""
    reached, arm_free, object_free, stable = terms
    if not reached:
        return 0.0
    return 0.25 * (arm_free + object_free + stable + (object_free and stable and better))


class MctsSampler(BatchSampler):
    """SampleGoals guided by UCB1 over the AFR hierarchy.

    Args:
        checker: checks samples.
        rng: chooses added children and samples poses.

    Attributes:
        tree: G_s.
    """

    def __init__(
        self,
        hierarchy: AfrHierarchy,
        checker: GoalChecker,
        settings: MctsSettings,
        rng: np.random.Generator,
    ) -> None:
        super().__init__(checker, settings)
        if settings.reward == "four_term":
            self._check = checker.check_all
        self.tree = SearchTree(
            hierarchy, hierarchy.MIN_SAMPLE_DEPTH, settings.exploration, settings.max_nodes, rng
        )
        self._rng = rng
        self._selected: list[int] = []  # the nodes drawn from last

    def sample_goals(self, best: float, should_stop: Callable[[], bool]) -> list[Goal]:
        """Algorithm 2; first the rewards of samples that no longer beat `best` are set right."""
        self.tree.raise_threshold(best)
        return super().sample_goals(best, should_stop)

    def _draw(self, most: int, best: float) -> Draws:
        """A pose from each node that Algorithm 3 selects for the batch."""
        self._selected = []
        # Select and hold nodes, so that the next ones differ.
        for _ in range(min(most, self._budget.batch)):
            self._selected.append(self.tree.select())
            self.tree.hold(self._selected[-1])
        nodes = [self.tree[n] for n in self._selected]
        poses = [node.sample(self._rng) for node in nodes]
        return Draws(
            np.array([node.arm for node in nodes]),
            np.array([node.grasp for node in nodes]),
            np.array([node.face for node in nodes]),
            np.array([contact for contact, _ in poses]),
            np.array([angle for _, angle in poses]),
            np.array([node.region.slope for node in nodes if node.region is not None]),
        )

    def _learn(self, outcome: Outcome, best: float) -> None:
        """Update: Δr of each sample, to its node and the ancestors."""
        # Take back what was held, and add the rewards.
        for node in self._selected:
            self.tree.release(node)
        samples = zip(outcome.verdicts.tolist(), outcome.values.tolist(), strict=True)
        for k, (verdict, value) in enumerate(samples):
            if self.tree.is_leaf(self._selected[k]):
                reward, demoted = float(verdict == Verdict.FEASIBLE), 0.0
            elif outcome.terms is None:
                reward, demoted = checks_passed(verdict), checks_passed(verdict, better=False)
            else:
                reward = four_term(outcome.terms[k], better=value > best)
                demoted = four_term(outcome.terms[k], better=False)
            self.tree.update(self._selected[k], reward, value, demoted)
