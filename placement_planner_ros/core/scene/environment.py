"""What the planner knows about the surroundings: obstacles, placement regions and support."""

from __future__ import annotations

from dataclasses import dataclass

import numpy.typing as npt

from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet
from placement_planner_ros.core.scene.regions import (
    Region,
    RegionSettings,
    SupportMap,
    find_regions,
)
from placement_planner_ros.core.types import TargetVolume


@dataclass(frozen=True, slots=True, eq=False)
class Environment:
    """The preprocessed surroundings of one problem.

    Attributes:
        obstacles: the one obstacle set.
        regions: R, the placement regions in V, larger first.
        support: answers s(x), on every level surface, in V or not.
    """

    obstacles: ObstacleSet
    regions: tuple[Region, ...]
    support: SupportMap

    @classmethod
    def from_points(
        cls,
        points: npt.ArrayLike,
        volume: TargetVolume,
        grid: GridSettings | None = None,
        regions: RegionSettings | None = None,
        bounds: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    ) -> Environment:
        """Preprocess a cloud.

        Args:
            points: (n, 3) in the planning frame, metres; NaN where nothing was seen.
            volume: V.
            grid: GridSettings() unless given.
            regions: RegionSettings() unless given.
            bounds: lower and upper corner of the workspace; around the points unless given.

        Raises:
            CloudError: see `ObstacleSet.from_points`.
        """
        obstacles = ObstacleSet.from_points(points, grid, bounds)
        found, support = find_regions(obstacles, volume, regions)
        return cls(obstacles, found, support)
