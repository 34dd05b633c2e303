"""Uniform sampling: the ablation that learns nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.scene.regions import RegionPoints
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


@dataclass(frozen=True, slots=True, eq=False)
class UniformDraws:
    """Poses drawn from all pose sets, (n,) each.

    Attributes:
        region, face: indices.
        contact: (n, 3).
        angle: θ.
        low, high: ends of the range that θ was drawn from; numbers where that is the same of all.
    """

    region: Index
    face: Index
    contact: Array
    angle: Array
    low: Array | float = 0.0
    high: Array | float = FULL_TURN


class UniformPoses:
    """Draws from all pose sets Ŝ(r, f): the region by area, the face and the pose uniformly.

    Where turns are restricted, regions on which no face may be placed are left out, the face is
    one of those that may be, and θ uniform over the ranges that it may have there.

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
        self._ranges = _RangesByPair(hierarchy) if hierarchy.restricted else None
        self._points = RegionPoints(hierarchy.regions)
        self.slopes = self._points.slopes
        # Regions by their area, or with an even share; none where no face may be placed.
        areas = np.array([region.area for region in hierarchy.regions])
        even = np.full(len(areas), 1.0 / max(len(areas), 1))
        if self._ranges is not None:
            open_ = self._ranges.faces_of > 0
            areas, even = areas * open_, open_ / max(int(open_.sum()), 1)
        self._shares = (1.0 - even_share) * areas / (areas.sum() or 1.0) + even_share * even

    def draw(self, count: int) -> UniformDraws:
        """So many."""
        regions = self._rng.choice(len(self._shares), size=count, p=self._shares)
        contact = self._points.sample(regions, self._rng)
        angle = self._rng.uniform(0.0, FULL_TURN, size=count)
        if self._ranges is not None:
            share = self._rng.random(count)
            return self._ranges.drawn(regions, contact, share, angle / FULL_TURN)
        return UniformDraws(regions, self._rng.integers(self._faces, size=count), contact, angle)


class _RangesByPair:
    """The ranges of θ by region and face, as tables.

    Attributes:
        faces_of: (regions,) how many faces may be placed on each.
    """

    def __init__(self, hierarchy: AfrHierarchy) -> None:
        # Ranges of each pair of region and face.
        number = {region: k for k, region in enumerate(hierarchy.regions)}
        ranges: dict[tuple[int, int], list[tuple[float, float]]] = {}
        for face, sets in enumerate(hierarchy.pose_sets):
            for region, low, high in sets:
                ranges.setdefault((number[region], face), []).append((low, high))
        pairs = sorted(ranges)
        self.faces_of = np.bincount([r for r, _ in pairs], minlength=len(number))
        self._first = np.cumsum(self.faces_of) - self.faces_of
        self._face = np.array([face for _, face in pairs], dtype=np.int64)
        most = max(map(len, ranges.values()), default=1)
        # per pair, the ranges and how long those before each are together; without end where
        # there are no more
        self._low = np.zeros((len(pairs), most))
        self._before = np.full((len(pairs), most + 1), np.inf)
        for row, pair in enumerate(pairs):
            ends = np.array(ranges[pair])
            self._low[row, : len(ends)] = ends[:, 0]
            self._before[row, 0] = 0.0
            self._before[row, 1 : len(ends) + 1] = np.cumsum(ends[:, 1] - ends[:, 0])
        self._total = np.where(np.isfinite(self._before), self._before, 0.0).max(axis=1, initial=0)

    def drawn(
        self, regions: Index, contact: Array, face_share: Array, share: Array
    ) -> UniformDraws:
        """The faces and angles at shares (n,), in [0, 1), of those that regions (n,) allow."""
        # The face by its share, and the range that the angle's share falls into.
        row = self._first[regions] + (face_share * self.faces_of[regions]).astype(np.int64)
        at = share * self._total[row]
        which = (self._before[row] <= at[:, None]).sum(axis=1) - 1
        low, before = self._low[row, which], self._before[row, which]
        high = low + self._before[row, which + 1] - before
        return UniformDraws(regions, self._face[row], contact, low + at - before, low, high)


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
        drawn = self._poses.draw(count)
        grasp = self._rng.integers(self._grasps[arm])
        slope = self._poses.slopes[drawn.region]
        return Draws(arm, grasp, drawn.face, drawn.contact, drawn.angle, slope)

    def _learn(self, outcome: Outcome, best: float) -> None:
        """Nothing is learned."""
