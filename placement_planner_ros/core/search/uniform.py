"""Uniform sampling: the ablation that learns nothing."""

from __future__ import annotations

from dataclasses import replace

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
from placement_planner_ros.core.types import Array, Index


class UniformPoses:
    """Draws from all pose sets Ŝ(r, f): the region by area, the face of those that may be placed on
    it, and the pose uniformly.

    Args:
        even_share: of the draws, in [0, 1]: from all regions alike instead of by area.
    """

    def __init__(
        self, hierarchy: AfrHierarchy, rng: np.random.Generator, even_share: float = 0.0
    ) -> None:
        self._rng = rng
        self._sets = sets = hierarchy.sets
        self._points = RegionPoints(hierarchy.regions)
        # Regions by their area, or with an even share; none where no face may be placed.
        areas = np.array([region.area for region in hierarchy.regions])
        is_open = np.bincount(sets.region, minlength=len(areas)) > 0
        shares = (1.0 - even_share) * areas * is_open / ((areas * is_open).sum() or 1.0)
        shares += even_share * is_open / max(int(is_open.sum()), 1)
        # Faces alike, and the ranges of θ of a face by their length.
        pair = sets.region * hierarchy.faces + sets.face
        pairs = np.unique(pair) // max(hierarchy.faces, 1)
        faces = np.bincount(pairs, minlength=len(areas))
        turns = sets.high[:, 2] - sets.low[:, 2]
        within = turns / np.bincount(pair, weights=turns)[pair] if len(sets) else turns
        self._ends = np.cumsum(shares[sets.region] / faces[sets.region] * within)

    def draw(self, count: int) -> tuple[Index, Array]:
        """(n,) pose sets, and (n, 3) places in them."""
        # A pose set by its share, a point on its region, a turn within its range.
        share, turn = self._rng.random((2, count))
        sets = self._ends.searchsorted(share * self._ends[-1], "right")
        places = self._points.sample(self._sets.region[sets], self._rng)
        low, high = self._sets.low[sets, 2], self._sets.high[sets, 2]
        places[:, 2] = low + turn * (high - low)
        return sets, places


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
        self._sets = hierarchy.sets
        self._poses = UniformPoses(hierarchy, rng)
        self._grasps = np.array(hierarchy.grasps_per_arm)
        self._arms = np.flatnonzero(self._grasps)

    def _draw(self, best: float) -> Draws:
        count = self._budget.batch
        arm = self._arms[self._rng.integers(len(self._arms), size=count)]
        draws = self._sets.draws(*self._poses.draw(count))
        return replace(draws, arm=arm, grasp=self._rng.integers(self._grasps[arm]))

    def _learn(self, outcome: Outcome, best: float) -> None:
        """Nothing is learned."""
