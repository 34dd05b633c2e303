"""The surface that an object stands on, level or sloping."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from .task import Array, Solid, Task, Tolerances, world_vertices


@dataclass(frozen=True, slots=True, eq=False)
class Facet:
    """A facet of a convex solid that faces up.

    Attributes:
        normal: (3,) unit.
        point: (3,) of its plane.
        sides: (k, 3) what is inside its outline seen from above: a x + b y + c <= 0 for each row.
    """

    normal: Array
    point: Array
    sides: Array

    def gaps(self, points: Array, edge: float) -> Array:
        """(n,) vertical distance of points (n, 3); inf beside the outline, by more than `edge`."""
        gaps = np.abs((points - self.point) @ self.normal) / self.normal[2]
        beside = (points[:, :2] @ self.sides[:, :2].T + self.sides[:, 2]).max(axis=1)
        return np.where(beside <= edge, gaps, np.inf)


def surface_normal(task: Task, T_world_object: Array, tolerances: Tolerances) -> Array:
    """(3,) up, along the normal of what an object at a pose (4, 4) stands on; z where that is
    level, and where it stands on nothing.

    Of the normals of all facets that face up and are not too steep, that along which the object's
    feet are nearest to such facets.
    """
    vertices = world_vertices(task, T_world_object)
    normals = normals_of(task, tolerances)
    best, least = normals[0], np.inf
    for normal in normals:
        feet = feet_of(vertices, normal, tolerances)
        if len(feet) < 3 or np.linalg.matrix_rank(feet[1:] - feet[0], tol=1e-4) < 2:
            continue
        gap = float(gaps_below(task.solids, feet, normal, tolerances).max())
        if gap < least - 1e-4:
            best, least = normal, gap
    return best


def normals_of(task: Task, tolerances: Tolerances) -> list[Array]:
    """(3,) z, and the normals of all facets that face up and are not too steep."""
    normals = [np.array([0.0, 0.0, 1.0])]
    for solid in task.solids:
        for facet in upward_facets(solid, tolerances.slope):
            if min(np.abs(facet.normal - each).max() for each in normals) > 1e-6:
                normals.append(facet.normal)
    return normals


def upward_facets(solid: Solid, steepest: float) -> tuple[Facet, ...]:
    """The facets of a convex solid that face up, none steeper than that, rad."""
    return _upward_facets(np.asarray(solid.vertices, np.float64).tobytes(), steepest)


@functools.lru_cache(maxsize=4096)
def _upward_facets(vertex_bytes: bytes, steepest: float) -> tuple[Facet, ...]:
    vertices = np.frombuffer(vertex_bytes).reshape(-1, 3)
    found = []
    planes = np.unique(np.round(ConvexHull(vertices).equations, 7), axis=0)
    for plane in planes[planes[:, 2] >= np.cos(steepest)]:
        corners = vertices[np.abs(vertices @ plane[:3] + plane[3]) <= 1e-6]
        if len(corners) >= 3:
            normal = plane[:3] / np.linalg.norm(plane[:3])
            found.append(Facet(normal, corners[0], ConvexHull(corners[:, :2]).equations))
    return tuple(found)


def feet_of(vertices: Array, normal: Array, tolerances: Tolerances) -> Array:
    """(k, 3) the vertices that are lowest along a normal."""
    heights = vertices @ normal
    return np.unique(vertices[heights <= heights.min() + tolerances.flatness], axis=0)


def gaps_below(
    solids: Sequence[Solid], points: Array, normal: Array, tolerances: Tolerances
) -> Array:
    """(n,) vertical distance of points (n, 3) from the surface nearest in height that has that
    normal; inf where there is none."""
    best = np.full(len(points), np.inf)
    for solid in solids:
        for facet in upward_facets(solid, tolerances.slope):
            if np.arccos(min(float(facet.normal @ normal), 1.0)) <= tolerances.lean:
                best = np.minimum(best, facet.gaps(points, tolerances.edge))
    return best
