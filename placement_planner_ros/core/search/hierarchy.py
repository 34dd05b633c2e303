"""The AFR hierarchy: arm, grasp, placement face, placement region, then ever smaller cells.

The grasp is a further choice under the arm (the paper names it as an extension). Below a region a
node is a tuple (a, g, f, r, θ_min, θ_max); its children combine the up to four sub-regions with l
intervals of the angle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.search.cell_layout import PoseSets
from placement_planner_ros.core.settings import Settings, setting
from placement_planner_ros.core.types import FULL_TURN

Ranges = Sequence[tuple[float, float]]
"""Intervals of θ, each at most a full turn long, that share no turn."""
EVERY_TURN: Ranges = ((0.0, FULL_TURN),)
"""All turns."""


@dataclass(frozen=True, slots=True)
class HierarchySettings(Settings):
    """How finely the hierarchy divides a pose set Ŝ(r, f).

    Attributes:
        angle_intervals: l, intervals an angle range is split into.
        min_area: regions of at most this area are not split; where something better was missed the
            optimistic search goes on.
        min_angle: angle ranges of at most this length are not split by `mcts` and in proofs.
    """

    angle_intervals: int = setting(4, "[2, inf)")
    min_area: float = setting(1e-4, "(0, inf)", "m²")
    min_angle: float = setting(FULL_TURN / 256, "(0, inf)", "rad")


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


class AfrHierarchy:
    """Ch(n) of the AFR hierarchy.

    Args:
        grasps_per_arm: number of grasps of each arm.
        faces: number of placement faces |F|.
        regions: R.
        turns: in which θ a face may be placed on a region; in all unless given.
        middles: of each face x + iy, m, from the contact point to the middle of the box around the
            object at θ = 0; 0 unless given.

    Attributes:
        sets: of each face, the regions that it may be placed on and the ranges of θ there.
        usable: the faces that have any.
    """

    MIN_SAMPLE_DEPTH = 4
    """Arm, grasp, face and region are chosen from this depth on."""

    def __init__(
        self,
        grasps_per_arm: Sequence[int],
        faces: int,
        regions: Sequence[Region],
        settings: HierarchySettings,
        turns: Callable[[int, Region], Ranges] | None = None,
        middles: Sequence[complex] = (),
    ) -> None:
        self.grasps_per_arm = tuple(grasps_per_arm)
        self.faces = faces
        self.regions = tuple(regions)
        self.settings = settings
        of = turns or (lambda face, region: EVERY_TURN)
        rows = [
            (face, number, *ends)
            for face in range(faces)
            for number, region in enumerate(self.regions)
            for ends in of(face, region)
        ]
        self.sets = PoseSets(self.regions, rows, middles or [0j] * faces)
        self._rows = [np.flatnonzero(self.sets.face == face).tolist() for face in range(faces)]
        self.usable = tuple(face for face in range(faces) if self._rows[face] or not regions)
        self.root = AfrNode()
        self._arms = [arm for arm, grasps in enumerate(grasps_per_arm) if grasps > 0]
        self._split: dict[Region, tuple[Region, ...]] = {}

    def child_count(self, node: AfrNode) -> int:
        """|Ch(n)|; 0 for a leaf."""
        if node.arm is None:
            return len(self._arms)
        if node.grasp is None:
            return self.grasps_per_arm[node.arm]
        if node.face is None:
            return len(self.usable)
        if node.region is None:
            return len(self._rows[node.face])
        count = len(self._parts(node.region)) * self._pieces(node)
        return count if count > 1 else 0

    def child(self, node: AfrNode, index: int) -> AfrNode:
        """One of Ch(n), 0 ≤ index < child_count."""
        if node.arm is None:
            return replace(node, arm=self._arms[index])
        if node.grasp is None:
            return replace(node, grasp=index)
        if node.face is None:
            return replace(node, face=self.usable[index])
        if node.region is None:
            row = self._rows[node.face][index]
            region, low, high = self.regions[self.sets.region[row]], self.sets.low, self.sets.high
            return replace(node, region=region, angle_min=low[row, 2], angle_max=high[row, 2])
        # Which part of the region, and which interval of the angle.
        pieces = self._pieces(node)
        part, piece = divmod(index, pieces)
        length = (node.angle_max - node.angle_min) / pieces
        ends = node.angle_min + piece * length, node.angle_min + (piece + 1) * length
        return AfrNode(node.arm, node.grasp, node.face, self._parts(node.region)[part], *ends)

    def _parts(self, region: Region) -> tuple[Region, ...]:
        """r_1 … r_4, or the region itself where it is not to be split; each region once."""
        parts = self._split.get(region)
        if parts is None:
            large = region.area > self.settings.min_area
            parts = self._split[region] = region.split() if large else (region,)
        return parts

    def _pieces(self, node: AfrNode) -> int:
        length = node.angle_max - node.angle_min
        long = length > self.settings.min_angle * (1 + 1e-9)
        return self.settings.angle_intervals if long else 1
