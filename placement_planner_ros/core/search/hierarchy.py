"""The AFR hierarchy: arm, grasp, placement face, placement region, then ever smaller cells.

The grasp is a further choice under the arm (the paper names it as an extension). Below a region a
node is a tuple (a, g, f, r, θ_min, θ_max); its children combine the up to four sub-regions with l
intervals of the angle.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.types import Array

FULL_TURN = 2.0 * math.pi


@dataclass(frozen=True, slots=True)
class HierarchySettings:
    """How finely the hierarchy divides a pose set Ŝ(r, f).

    Attributes:
        angle_intervals: l, intervals an angle range is split into.
        min_area: regions of at most this area are not split, m².
        min_angle: angle ranges of at most this length are not split, rad.
    """

    angle_intervals: int = 4
    min_area: float = 1e-4
    min_angle: float = FULL_TURN / 256

    def __post_init__(self) -> None:
        if self.angle_intervals < 2:
            raise ParameterError("angle_intervals", self.angle_intervals, "must be at least 2")
        if not (self.min_area > 0.0 and self.min_angle > 0.0):
            raise ParameterError(
                "min_area, min_angle", (self.min_area, self.min_angle), "must be above zero"
            )


@dataclass(frozen=True, slots=True, eq=False)
class AfrNode:
    """A node of the hierarchy; what is not chosen yet is None.

    Attributes:
        arm: index of the arm a.
        grasp: index of the grasp under that arm.
        face: index of the placement face f.
        region: the placement region r or a part of it.
        angle_min, angle_max: the range [θ_min, θ_max), rad.
    """

    arm: int | None = None
    grasp: int | None = None
    face: int | None = None
    region: Region | None = None
    angle_min: float = 0.0
    angle_max: float = FULL_TURN

    def sample(self, rng: np.random.Generator) -> tuple[Array, float]:
        """A contact point (3,) uniform over the region and an angle θ uniform over the range."""
        assert self.region is not None
        return self.region.sample(rng), rng.uniform(self.angle_min, self.angle_max)


class AfrHierarchy:
    """Ch(n) of the AFR hierarchy.

    Args:
        grasps_per_arm: number of grasps of each arm.
        faces: number of placement faces |F|.
        regions: R.
    """

    MIN_SAMPLE_DEPTH = 4
    """Arm, grasp, face and region are chosen from this depth on."""

    def __init__(
        self,
        grasps_per_arm: Sequence[int],
        faces: int,
        regions: Sequence[Region],
        settings: HierarchySettings,
    ) -> None:
        self.grasps_per_arm = tuple(grasps_per_arm)
        self.faces = faces
        self.regions = tuple(regions)
        self.settings = settings
        self.root = AfrNode()

    def children(self, node: AfrNode) -> list[AfrNode]:
        """The children of a node; none for a leaf."""
        if node.arm is None:
            return [replace(node, arm=a) for a, n in enumerate(self.grasps_per_arm) if n > 0]
        if node.grasp is None:
            return [replace(node, grasp=g) for g in range(self.grasps_per_arm[node.arm])]
        if node.face is None:
            return [replace(node, face=f) for f in range(self.faces)]
        if node.region is None:
            return [replace(node, region=r) for r in self.regions]
        return self._subdivide(node, node.region)

    def _subdivide(self, node: AfrNode, region: Region) -> list[AfrNode]:
        settings = self.settings
        regions: Sequence[Region] = (region,)
        if region.area > settings.min_area:
            regions = region.split()
        length = node.angle_max - node.angle_min
        pieces = settings.angle_intervals if length > settings.min_angle * (1 + 1e-9) else 1
        if len(regions) == 1 and pieces == 1:
            return []
        bounds = np.linspace(node.angle_min, node.angle_max, pieces + 1)
        return [
            replace(node, region=part, angle_min=float(low), angle_max=float(high))
            for part in regions
            for low, high in itertools.pairwise(bounds)
        ]
