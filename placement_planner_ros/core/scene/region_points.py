"""Points on placement regions, many at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.scene.regions import ATTEMPTS, Region
from placement_planner_ros.core.types import Array


class RegionPoints:
    """`Region.sample` for any of several regions.

    Attributes:
        slopes: (regions, 2) of each.
    """

    def __init__(self, regions: Sequence[Region]) -> None:
        self._rectangles = np.concatenate([np.zeros((0, 4)), *(r.rectangles for r in regions)])
        self._diagonals = np.concatenate([np.zeros((0, 4)), *(r.diagonals for r in regions)])
        self._z = np.array([region.z for region in regions])
        self.slopes = np.array([region.slope for region in regions]).reshape(-1, 2)
        # of region k, from k to k + 1: how far its rectangles reach in the share of its surface
        ends = [k + region.share / region.share[-1] for k, region in enumerate(regions)]
        self._ends = np.concatenate([np.zeros(0), *ends])
        self._last = np.cumsum([len(end) for end in ends]) - 1

    def sample(self, picked: npt.NDArray[np.int64], rng: np.random.Generator) -> Array:
        """(n, 3) a point on each of the regions picked (n,), uniform by area."""
        points = np.empty((len(picked), 3))
        points[:, 2] = self._z[picked]
        refused = np.arange(len(picked))
        for _ in range(ATTEMPTS):
            region = picked[refused]
            pick, across, along = rng.random((3, len(refused)))
            row = np.minimum(self._ends.searchsorted(region + pick, "right"), self._last[region])
            x0, y0, x1, y1 = self._rectangles[row].T
            x, y = x0 + across * (x1 - x0), y0 + along * (y1 - y0)
            points[refused, 0], points[refused, 1] = x, y
            low_plus, high_plus, low_minus, high_minus = self._diagonals[row].T
            plus, minus = x + y, x - y
            stands = (low_plus <= plus) & (plus <= high_plus)
            stands &= (low_minus <= minus) & (minus <= high_minus)
            refused = refused[~stands]
            if len(refused) == 0:
                break
        points[:, 2] += (points[:, :2] * self.slopes[picked]).sum(axis=1)
        return points
