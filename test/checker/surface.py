"""The surface that an object stands on, level or sloping."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull

from .task import Array, Solid, Task, Tolerances, world_vertices


def surface_normal(task: Task, T_world_object: Array, tolerances: Tolerances) -> Array:
    """(3,) up, along the normal of what an object at a pose (4, 4) stands on; z where that is
    level, and where it stands on nothing.

    Of the normals of all facets that face up and are not too steep, that along which the object's
    feet are nearest to such facets.
    """
    vertices, level = world_vertices(task, T_world_object), np.array([0.0, 0.0, 1.0])
    normals = [level]
    for solid in task.solids:
        for normal, _ in upward_facets(solid.vertices, tolerances.slope):
            if min(np.abs(normal - each).max() for each in normals) > 1e-6:
                normals.append(normal)
    best, least = level, np.inf
    for normal in normals:
        feet = feet_of(vertices, normal, tolerances)
        if len(feet) < 3 or np.linalg.matrix_rank(feet[1:] - feet[0], tol=1e-4) < 2:
            continue
        gap = max(gap_below(task.solids, foot, normal, tolerances) for foot in feet)
        if gap < least - 1e-4:
            best, least = normal, gap
    return best


def upward_facets(vertices: Array, steepest: float) -> list[tuple[Array, Array]]:
    """Unit normal (3,) and corners (k, 3) of the facets of a convex solid that face up, none
    steeper than that, rad."""
    vertices = np.asarray(vertices)
    found = []
    planes = np.unique(np.round(ConvexHull(vertices).equations, 7), axis=0)
    for plane in planes[planes[:, 2] >= np.cos(steepest)]:
        corners = vertices[np.abs(vertices @ plane[:3] + plane[3]) <= 1e-6]
        found.append((plane[:3] / np.linalg.norm(plane[:3]), corners))
    return found


def feet_of(vertices: Array, normal: Array, tolerances: Tolerances) -> Array:
    """(k, 3) the vertices that are lowest along a normal."""
    heights = vertices @ normal
    return np.unique(vertices[heights <= heights.min() + tolerances.flatness], axis=0)


def gap_below(
    solids: Sequence[Solid], point: Array, normal: Array, tolerances: Tolerances
) -> float:
    """Vertical distance between a point and the surface nearest in height that has that normal."""
    best = np.inf
    for solid in solids:
        for facet, corners in upward_facets(solid.vertices, tolerances.slope):
            if np.arccos(min(float(facet @ normal), 1.0)) > tolerances.lean:
                continue
            gap = abs(float((point - corners[0]) @ facet)) / float(facet[2])
            if len(corners) >= 3 and gap < best:
                hull = ConvexHull(corners[:, :2])
                if (hull.equations[:, :2] @ point[:2] + hull.equations[:, 2]).max() <= (
                    tolerances.edge
                ):
                    best = gap
    return best
