"""Where the page looks from at first: so that nothing hides what matters."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from placement_planner_ros.core.types import Array

FIELD_OF_VIEW = np.deg2rad(40.0)
"""From the lower to the upper edge of the picture, rad."""
_AZIMUTHS = np.deg2rad(np.arange(0.0, 360.0, 15.0))
_ELEVATIONS = np.deg2rad([32.0, 41.0, 50.0, 60.0])
_ASIDE, _USUAL = np.deg2rad([30.0, 50.0])
"""The azimuth from the robot's front, and the elevation, from which things look usual, rad."""
_SIGHT_RADIUS_M = 0.035
"""From a line of sight, within which a point hides what is behind."""
_COST_PER_RAD = 0.1
"""Share that may be hidden more in a view that is a radian nearer to the usual one."""


def first_view(matter: Array, also: Array, hiders: Array, base: Array) -> tuple[Array, Array]:
    """Eye (3,) and middle (3,) of the view in which most of what matters is seen, and that looks
    most usual of those.

    Args:
        matter: (n, 3) points that matter, as those in V.
        also: (l, 3) points that shall be in the picture, too, as the object in the hand.
        hiders: (m, 3) points on robot and scene.
        base: (3,) where the robot stands: seen from across, it faces the eye.
    """
    shown = np.vstack([matter, also])
    middle = 0.5 * (shown.min(axis=0) + shown.max(axis=0))
    radius = 0.5 * float(np.linalg.norm(np.ptp(shown, axis=0)))
    # 0.6 m at least, and 1.3 times as far as the ball around all just fits
    distance = max(1.3 * radius / np.tan(FIELD_OF_VIEW / 2.0), 0.6)
    tree = cKDTree(hiders) if len(hiders) else None
    front = np.arctan2(*(middle - base)[1::-1])
    usual = _unit_direction(front + _ASIDE, _USUAL)
    views = []
    for elevation in _ELEVATIONS:
        for azimuth in _AZIMUTHS:
            direction, hidden = _unit_direction(azimuth, elevation), 0.0
            eye = middle + distance * direction
            if tree is not None:
                lines = matter + np.linspace(0.06, 0.9, 28)[:, None, None] * (eye - matter)
                away, _ = tree.query(lines, distance_upper_bound=_SIGHT_RADIUS_M)
                hidden = float(np.isfinite(away).any(axis=0).mean())
            cost = hidden + _COST_PER_RAD * np.arccos(np.clip(direction @ usual, -1.0, 1.0))
            views.append((cost, eye))
    return min(views, key=lambda view: view[0])[1], middle


def _unit_direction(azimuth: float, elevation: float) -> Array:
    """(3,) towards an eye there, angles in rad."""
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
