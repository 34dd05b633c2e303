"""The page's colours, in one place, so that legend and scene agree."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.types import Array

Rgb = tuple[int, int, int]

PLACED: Rgb = (30, 160, 60)
HELD: Rgb = (235, 120, 20)
START: Rgb = (120, 120, 130)
EARLIER: Rgb = (105, 60, 170)
STANDING: Rgb = (20, 130, 130)
VOLUME: Rgb = (217, 38, 140)
PATH: Rgb = (235, 120, 20)
OBSTACLES: Rgb = (150, 75, 60)
REGION: Rgb = (90, 140, 215)

_SCALE = np.array(
    [(0, 50, 120), (60, 80, 130), (110, 115, 125), (160, 150, 105), (215, 195, 85), (255, 232, 70)]
)
"""From the worst to the best, readable without telling red from green."""
_GREYS = np.linspace((125, 132, 145), (190, 196, 205), 64).round().astype(np.uint8)
"""Of points, from below to above."""


def css_colour(colour: Rgb) -> str:
    """As HTML has it."""
    return f"rgb({colour[0]},{colour[1]},{colour[2]})"


def scale_colours(shares: Array) -> npt.NDArray[np.uint8]:
    """(n, 3) colours of shares (n,) from 0, the worst, to 1, the best."""
    at = np.clip(shares, 0.0, 1.0) * (len(_SCALE) - 1)
    columns = [np.interp(at, np.arange(len(_SCALE)), column) for column in _SCALE.T]
    return np.column_stack(columns).round().astype(np.uint8)


def scale_css() -> str:
    """The scale as a CSS gradient, the worst at the left."""
    stops = ", ".join(css_colour((int(r), int(g), int(b))) for r, g, b in _SCALE)
    return f"linear-gradient(to right, {stops})"


def linear_colours(colour: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """(n, 3) colours as meshes with a colour for each vertex have them: in parts of the light."""
    return np.asarray((255.0 * (colour / 255.0) ** 2.2).round(), np.uint8)


def by_height(heights: Array) -> npt.NDArray[np.uint8]:
    """(n, 3) greys of points at heights (n,), m: darker below, so that things stand out."""
    if len(heights) == 0:
        return np.zeros((0, 3), np.uint8)
    low, high = np.percentile(heights[:: max(1, len(heights) // 1000)], [2, 98])
    share = np.clip((heights - low) / max(high - low, 1e-6), 0.0, 1.0)
    return _GREYS[(share * (len(_GREYS) - 1)).astype(np.uint8)]
