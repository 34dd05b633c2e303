"""Points beside the robot and what it holds: obstacles that belong to no surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import Array


@dataclass(frozen=True, slots=True, eq=False)
class NearPoints:
    """Points that may be the robot's by where they are, but need not.

    Nothing stands on them, and they do not count for clearance.

    Attributes:
        common: (k, 3) obstacles whatever is held, metres.
        of_grasps: (k, 3) by arm and grasp, obstacles where the object is held like that.
        left_out: how many points were taken for the robot's, or for those of what it holds.
    """

    common: Array = field(default_factory=lambda: np.zeros((0, 3)))
    of_grasps: Mapping[tuple[str, int], Array] = field(default_factory=dict)
    left_out: int = 0

    def within(self, lower: Array, upper: Array) -> NearPoints:
        """Those in the box of corners (3,)."""

        def inside(points: Array) -> Array:
            return points[((points >= lower) & (points <= upper)).all(axis=1)]

        of_grasps = {grasp: inside(points) for grasp, points in self.of_grasps.items()}
        return NearPoints(inside(self.common), of_grasps, self.left_out)


def laid_over(obstacles: ObstacleSet, points: Array) -> ObstacleSet:
    """The obstacle set with each of the points (k, 3) as an obstacle on which nothing stands."""
    if not len(points):
        return obstacles
    larger = obstacles.reaching(points.min(axis=0), points.max(axis=0))
    cells = np.floor((points - larger.origin) / larger.cell_size).astype(np.int32)
    cells = np.clip(cells, 0, np.array(larger.shape, np.int32) - 1)
    return larger.with_boxes(cells, points, points)
