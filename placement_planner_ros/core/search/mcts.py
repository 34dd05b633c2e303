"""Monte-Carlo tree search over the AFR hierarchy: Algorithms 2 and 3 with the rewards of H."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.scene.regions import RegionPoints
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.search.sampler import (
    BatchSampler,
    Draws,
    GoalChecker,
    Outcome,
    SamplerSettings,
)
from placement_planner_ros.core.search.tree import SearchTree
from placement_planner_ros.core.settings import setting
from placement_planner_ros.core.types import Verdict


@dataclass(frozen=True, slots=True)
class MctsSettings(SamplerSettings):
    """Budgets and exploration.

    Attributes:
        batch: as in `SamplerSettings`. Each selection of a batch takes those before it for samples
            without reward; 1 is the paper's algorithm to the letter, but for the level of
            grasps and where no goal ends a call early (`goals_per_call`).
        exploration: c of UCB1.
        max_nodes: bound on the tree's size.
    """

    exploration: float = setting(1.0, "[0, inf)")
    max_nodes: int = setting(200_000, "[1, inf)")


def checks_passed(verdict: int) -> float:
    """H(x, q, ξ_best) ∈ [0, 1]: the share of the ordered checks passed, the rules of users and
    ξ > ξ_best being one."""
    passed = verdict - (verdict > Verdict.BREAKS_RULE)
    return passed / (int(Verdict.FEASIBLE) - 1)


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
        self.tree = SearchTree(hierarchy, settings.exploration, settings.max_nodes, rng)
        self._rng = rng
        self._selected: list[int] = []  # the nodes drawn from last

    def _draw(self, best: float) -> Draws:
        """A pose from each node that Algorithm 3 selects for the batch."""
        # Each counts as visited once it is selected; its reward comes with its verdict.
        self._selected = []
        for _ in range(self._budget.batch):
            self._selected.append(self.tree.select())
            self.tree.update(self._selected[-1], 1, 0.0)
        nodes = [self.tree.nodes[n] for n in self._selected]
        regions = [node.region for node in nodes if node.region is not None]
        low, high = np.array([(node.angle_min, node.angle_max) for node in nodes]).T
        return Draws(
            np.array([node.arm for node in nodes]),
            np.array([node.grasp for node in nodes]),
            np.array([node.face for node in nodes]),
            RegionPoints(regions).sample(np.arange(len(nodes)), self._rng),
            self._rng.uniform(low, high),
            np.array([region.slope for region in regions]),
        )

    def _learn(self, outcome: Outcome, best: float) -> None:
        """Update: Δr of each sample, to its node and the ancestors."""
        for node, verdict in zip(self._selected, outcome.verdicts.tolist(), strict=True):
            # A leaf is rewarded where it is feasible, others by the checks passed.
            feasible = float(verdict == Verdict.FEASIBLE)
            leaf = self.tree.is_leaf(node)
            self.tree.update(node, 0, feasible if leaf else checks_passed(verdict))
