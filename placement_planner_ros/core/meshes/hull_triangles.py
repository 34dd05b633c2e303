"""The convex hull of points as triangles."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from placement_planner_ros.core.types import Array


def hull_triangles(vertices: Array) -> Array:
    """(t, 3, 3) the hull of points (n, 3), wound counter-clockwise from outside."""
    hull = ConvexHull(vertices)
    corners = vertices[hull.simplices]
    sides = corners[:, 1:] - corners[:, :1]
    inward = (np.cross(sides[:, 0], sides[:, 1]) * hull.equations[:, :3]).sum(axis=1) < 0.0
    corners[inward] = corners[inward][:, ::-1]
    return np.asarray(corners)
