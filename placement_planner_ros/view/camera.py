"""From where the page looks at first: so that nothing hides what matters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from placement_planner_ros.core.types import Array

FIELD_OF_VIEW = np.deg2rad(40.0)
"""From the lower to the upper edge of the picture, rad."""
_ROOM = 1.3
"""How far the eye is away, of the distance from which the ball around all just fits."""
_AZIMUTHS = np.deg2rad(np.arange(0.0, 360.0, 15.0))
_ELEVATIONS = np.deg2rad([32.0, 41.0, 50.0, 60.0])
_ALONG = np.linspace(0.06, 0.9, 28)
_NEAR = 0.035
"""m from a line of sight within which a point hides what is behind."""
_SIGHTS = 60
"""Points that are looked at."""
_OBSTACLE = 0.35
"""How much a thing of the scene hides, of what the robot does: it is drawn as loose points."""
_FAR = 0.15
"""How much a view from behind the robot costs, of what one costs in which all is hidden; and one
that is a radian too high or too low."""
_ASIDE, _USUAL = np.deg2rad([30.0, 50.0])
"""The azimuth from the robot's front, and the elevation, from which things look usual, rad."""


@dataclass(frozen=True, slots=True, eq=False)
class FirstView:
    """How the page looks at first.

    Attributes:
        eye: (3,) from where.
        at: (3,) at what.
        hidden: share of what matters that things of the scene hide.
    """

    eye: Array
    at: Array
    hidden: float

    def before(self, points: Array, boxes: Array) -> npt.NDArray[np.bool_]:
        """Which of the points (n, 3) stand between the eye and boxes (k, 2, 3), in none of them."""
        found = np.zeros(len(points), bool)
        inside = np.zeros(len(points), bool)
        for lower, upper in boxes:
            enters, leaves = np.full(len(points), -np.inf), np.full(len(points), np.inf)
            for axis in range(3):  # as numpy is slow over rows of three
                way = points[:, axis] - self.eye[axis]
                way[np.abs(way) < 1e-9] = 1e-9
                one = (lower[axis] - self.eye[axis]) / way
                other = (upper[axis] - self.eye[axis]) / way
                np.maximum(enters, np.minimum(one, other), out=enters)
                np.minimum(leaves, np.maximum(one, other), out=leaves)
            found |= (enters < leaves) & (leaves > 1.0)
            inside |= (enters <= 1.0) & (leaves >= 1.0)
        return found & ~inside


def first_view(
    matter: Array, also: Array, robot: Array, obstacles: Array, base: Array
) -> FirstView:
    """From where most of what matters is seen.

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
    best, best_cost = FirstView(middle + distance, middle, 0.0), np.inf
    for elevation in _ELEVATIONS:
        for azimuth in _AZIMUTHS:
            direction = np.array([np.cos(elevation) * np.cos(azimuth),
                                  np.cos(elevation) * np.sin(azimuth),
                                  np.sin(elevation)])  # fmt: skip
            eye = middle + distance * direction
            lines = looked_at + _ALONG[:, None, None] * (eye - looked_at)
            cost = hidden = 0.0
            for tree, weight in hiders:
                away, _ = tree.query(lines, distance_upper_bound=_NEAR)
                hidden = float(np.isfinite(away).any(axis=0).mean())
                cost += weight * hidden
            cost += _FAR * (1.0 - np.cos(azimuth - front - _ASIDE)) / 2.0
            cost += _FAR * abs(elevation - _USUAL)
            if cost < best_cost:
                best_cost = cost
                best = FirstView(eye, middle, hidden if len(obstacles) else 0.0)
    return best
