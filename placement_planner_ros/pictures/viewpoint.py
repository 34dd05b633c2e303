"""From which side to look, so that little hides what matters."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from placement_planner_ros.core.types import Array

_AZIMUTHS = np.deg2rad(np.arange(0.0, 360.0, 15.0))
_ELEVATIONS = np.deg2rad([32.0, 41.0, 50.0, 60.0])
_ASIDE, _USUAL = np.deg2rad([30.0, 50.0])
"""The azimuth from the robot's front, and the elevation, from which things look usual, rad."""
_SIGHT_RADIUS_M = 0.035
"""From a line of sight, within which a point hides what is behind."""
_COST_PER_RAD = 0.1
"""Share that may be hidden more in a view that is a radian nearer to the usual one."""


def best_direction(
    matter: Array, hiders: Array, base: Array, distance: float
) -> tuple[float, float]:
    """Azimuth and elevation, rad, from which most is seen, and that look most usual of those.

    Args:
        matter: (n, 3) points that matter, as those in V.
        hiders: (m, 3) points on robot and scene, 2 cm apart or less.
        base: (3,) where the robot stands: seen from across, it faces the eye.
        distance: of the eye from the middle of what matters, metres.
    """
    middle = 0.5 * (matter.min(axis=0) + matter.max(axis=0))
    tree = cKDTree(hiders) if len(hiders) else None
    front = np.arctan2(*(middle - base)[1::-1])
    usual = unit_direction(front + _ASIDE, _USUAL)
    views = []
    for elevation in _ELEVATIONS:
        for azimuth in _AZIMUTHS:
            direction, hidden = unit_direction(azimuth, elevation), 0.0
            if tree is not None:
                to_eye = middle + distance * direction - matter
                lines = matter + np.linspace(0.06, 0.9, 28)[:, None, None] * to_eye
                away, _ = tree.query(lines, distance_upper_bound=_SIGHT_RADIUS_M)
                hidden = float(np.isfinite(away).any(axis=0).mean())
            off = np.arccos(np.clip(direction @ usual, -1.0, 1.0))
            views.append((hidden + _COST_PER_RAD * off, float(azimuth), float(elevation)))
    return min(views)[1:]


def unit_direction(azimuth: float, elevation: float) -> Array:
    """(3,) towards an eye there, angles in rad."""
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
