"""The page's colours, in one place, so that legend and scene agree."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.types import Array

Rgb = tuple[int, int, int]

LINK: Rgb = (200, 202, 208)
PLACED: Rgb = (30, 160, 60)
HELD: Rgb = (235, 120, 20)
STANDING: Rgb = (20, 130, 130)
VOLUME: Rgb = (217, 38, 140)
OBSTACLES: Rgb = (150, 75, 60)
REGION: Rgb = (90, 140, 215)
CONTACT: Rgb = (200, 30, 30)
WALL: Rgb = (128, 77, 180)

_GREYS = np.linspace((125, 132, 145), (190, 196, 205), 64).round().astype(np.uint8)
"""Of points, from below to above."""


def by_height(heights: Array) -> npt.NDArray[np.uint8]:
    """(n, 3) greys of points at heights (n,), m: darker below, so that things stand out."""
    if len(heights) == 0:
        return np.zeros((0, 3), np.uint8)
    low, high = np.percentile(heights[:: max(1, len(heights) // 1000)], [2, 98])
    share = np.clip((heights - low) / max(high - low, 1e-6), 0.0, 1.0)
    return _GREYS[(share * (len(_GREYS) - 1)).astype(np.uint8)]
