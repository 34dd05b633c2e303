"""From which side to look, so that little hides what matters."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from placement_planner_ros.core.types import Array
from placement_planner_ros.pictures.rendering import Image, Mesh, Viewpoint, render

_AZIMUTHS = np.deg2rad(np.arange(0.0, 360.0, 30.0))
_ELEVATIONS = np.deg2rad([25.0, 40.0])
_SMALL = (160, 120)
"""Pixels of the pictures in which views are compared."""
_BETTER = 0.01
"""Score by which a later view has to be better."""


def best_direction(points: Array, score: Callable[[Viewpoint], float]) -> tuple[float, float]:
    """Azimuth and elevation, rad, from which a small view of points (n, 3) has the highest score.

    Of those that are as good, the first: azimuths are in the order of the circle, so that the same
    is always shown from the same side.
    """
    best, direction = -np.inf, (0.0, 0.0)
    for elevation in _ELEVATIONS:
        for azimuth in _AZIMUTHS:
            found = score(Viewpoint.around(points, float(azimuth), float(elevation), *_SMALL))
            if found > best + _BETTER:
                best, direction = found, (float(azimuth), float(elevation))
    return direction


def seen_share(view: Viewpoint, behind: Image | None, before: Sequence[Mesh], thing: Mesh) -> float:
    """Share of the thing's pixels that nothing hides.

    Args:
        behind: what was rendered of that view already.
        before: what may hide it besides.
    """
    alone = render(view, [thing]).depth
    hiding = render(view, before, behind).depth
    covered = np.isfinite(alone)
    return float((alone < hiding)[covered].mean()) if covered.any() else 0.0
