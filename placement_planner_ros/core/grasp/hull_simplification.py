"""A hull of few corners in place of one of many, and how far that one reaches out of it."""

from __future__ import annotations

import itertools

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from placement_planner_ros.core.types import Array

_SIMPLE_HULL_CORNERS = 32
"""Hulls of so many corners are left as they are."""
_AROUND = np.array([d for d in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
"""(26, 3) directions, by the principal axes, whose furthest corners are taken first: by other axes
those of a thin lens may all lie on its rim, in one plane."""


def few_corners(corners: Array, tolerance: float) -> tuple[Array, float]:
    """Some of the corners of a hull, and what the others are away from the hull of these.

    Of the corners that are further away than the tolerance the furthest beyond each facet is
    taken, until there are none.

    Args:
        corners: (m, 3) of a convex polytope, metres.
        tolerance: metres.

    Returns:
        (k, 3), and metres: enlarged by that, their hull contains all corners.

    Raises:
        QhullError: the corners span no volume.
    """
    if len(corners) <= _SIMPLE_HULL_CORNERS:
        return corners, 0.0
    # Start from the corners that lie furthest in directions along the principal axes.
    axes = np.linalg.svd(corners - corners.mean(axis=0), full_matrices=False)[2]
    taken = np.unique((corners @ (_AROUND @ axes).T).argmax(axis=0))
    while True:
        # How far each corner lies beyond each facet of the hull so far.
        hull = ConvexHull(corners[taken])
        beyond = corners @ hull.equations[:, :3].T + hull.equations[:, 3]
        # what is next to a point outside lies on a facet that is seen from there
        point, facet = np.nonzero(beyond > 0.0)
        triangles = hull.points[hull.simplices[facet]]
        nearest = trimesh.triangles.closest_point(triangles, corners[point])
        away = np.full(len(corners), np.inf)
        # Corners inside are not away at all.
        away[beyond.max(axis=1) <= 0.0] = 0.0
        # fmin: next to a triangle of no area is NaN, which tells nothing
        np.fmin.at(away, point, np.linalg.norm(nearest - corners[point], axis=1))
        away[taken] = 0.0
        # Those too far away: the furthest beyond each facet joins the hull.
        lacking = np.flatnonzero(away > tolerance)
        if not len(lacking):
            return corners[taken], float(away.max())
        furthest = lacking[beyond[lacking].argmax(axis=0)]
        taken = np.union1d(taken, furthest[beyond[lacking].max(axis=0) > 0.0])
