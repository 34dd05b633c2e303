"""From where the page looks at first: so that nothing hides what matters."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from placement_planner_ros.core.types import Array

FIELD_OF_VIEW = np.deg2rad(40.0)
"""From the lower to the upper edge of the picture, rad."""
_ROOM = 1.15
"""How far the eye is away, of the distance from which the ball around all just fits."""
_AZIMUTHS = np.deg2rad(np.arange(0.0, 360.0, 15.0))
_ELEVATIONS = np.deg2rad([32.0, 42.0, 55.0])
_ALONG = np.linspace(0.06, 0.9, 28)
_NEAR = 0.035
"""m from a line of sight within which a point hides what is behind."""
_SIGHTS = 60
"""Points that are looked at."""
_OBSTACLE = 0.35
"""How much a thing of the scene hides, of what the robot does: it is drawn as loose points."""
_FAR = 0.15
"""How much of a line's share of hidden points a view straight from behind the robot costs."""


def first_view(
    matter: Array, also: Array, robot: Array, obstacles: Array, base: Array
) -> tuple[Array, Array]:
    """From where most of what matters is seen, (3,), and what to look at, (3,).

    Args:
        matter: (n, 3) points that matter, as those in V.
        also: (l, 3) points that shall be in the picture, too, as the object in the hand.
        robot: (m, 3) points on the robot.
        obstacles: (k, 3) points on the scene.
        base: (3,) where the robot stands: seen from across, it faces the eye.
    """
    shown = np.vstack([matter, also])
    middle = 0.5 * (shown.min(axis=0) + shown.max(axis=0))
    radius = 0.5 * float(np.linalg.norm(shown.max(axis=0) - shown.min(axis=0)))
    distance = max(_ROOM * radius / np.tan(FIELD_OF_VIEW / 2.0), 0.6)
    looked_at = matter[:: max(1, len(matter) // _SIGHTS)]
    hiders = [(cKDTree(points), weight) for points, weight in ((robot, 1.0), (obstacles, _OBSTACLE))
              if len(points)]  # fmt: skip
    outwards = middle - base
    front = np.arctan2(outwards[1], outwards[0])
    best, best_cost = middle + distance, np.inf
    for elevation in _ELEVATIONS:
        for azimuth in _AZIMUTHS:
            direction = np.array([np.cos(elevation) * np.cos(azimuth),
                                  np.cos(elevation) * np.sin(azimuth),
                                  np.sin(elevation)])  # fmt: skip
            eye = middle + distance * direction
            lines = looked_at + _ALONG[:, None, None] * (eye - looked_at)
            cost = 0.0
            for tree, weight in hiders:
                away, _ = tree.query(lines, distance_upper_bound=_NEAR)
                cost += weight * float(np.isfinite(away).any(axis=0).mean())
            # Where little is hidden either way: from the side, so that ways and heights are seen.
            cost += _FAR * abs(np.cos(azimuth - front - np.deg2rad(50.0)) - 1.0) / 2.0
            if cost < best_cost:
                best, best_cost = eye, cost
    return np.asarray(best), middle
