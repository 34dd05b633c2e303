"""Uniform sampling: the ablation that learns nothing."""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.scene.region_points import RegionPoints
from placement_planner_ros.core.search.hierarchy import FULL_TURN, AfrHierarchy
from placement_planner_ros.core.search.sampler import (
    BatchSampler,
    Draws,
    GoalChecker,
    Index,
    Outcome,
    SamplerSettings,
)
from placement_planner_ros.core.types import Array


class UniformPoses:
    """Draws from all pose sets Ŝ(r, f): the region by area, the face and the pose uniformly.

    Args:
        even_share: of the draws, in [0, 1]: from all regions alike instead of by area.

    Attributes:
        slopes: (regions, 2) of each.
    """

    def __init__(
        self, hierarchy: AfrHierarchy, rng: np.random.Generator, even_share: float = 0.0
    ) -> None:
        self._rng = rng
        self._faces = hierarchy.faces
        self._points = RegionPoints(hierarchy.regions)
        self.slopes = self._points.slopes
        areas = np.array([region.area for region in hierarchy.regions])
        self._shares = (1.0 - even_share) * areas / areas.sum() + even_share / max(len(areas), 1)

    def draw(self, count: int) -> tuple[Index, Index, Array, Array]:
        """Regions (count,), faces (count,), contacts (count, 3) and angles (count,)."""
        regions = self._rng.choice(len(self._shares), size=count, p=self._shares)
        contact = self._points.sample(regions, self._rng)
        angle = self._rng.uniform(0.0, FULL_TURN, size=count)
        return regions, self._rng.integers(self._faces, size=count), contact, angle


class UniformSampler(BatchSampler):
    """Algorithm 2 with SelectAfrNode replaced by a uniform choice, of arm and grasp too.

    Args:
        checker: checks samples.
        rng: draws them.
    """

    def __init__(
        self,
        hierarchy: AfrHierarchy,
        checker: GoalChecker,
        settings: SamplerSettings,
        rng: np.random.Generator,
    ) -> None:
        super().__init__(checker, settings)
        self._rng = rng
        self._poses = UniformPoses(hierarchy, rng)
        self._grasps = np.array(hierarchy.grasps_per_arm)
        self._arms = np.flatnonzero(self._grasps)

    def _draw(self, most: int, best: float) -> Draws:
        count = min(most, self._budget.batch)
        arm = self._arms[self._rng.integers(len(self._arms), size=count)]
        region, face, contact, angle = self._poses.draw(count)
        grasp = self._rng.integers(self._grasps[arm])
        return Draws(arm, grasp, face, contact, angle, self._poses.slopes[region])

    def _learn(self, outcome: Outcome, best: float) -> None:
        """Nothing is learned."""
