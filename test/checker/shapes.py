"""Convex solids and meshes as coal has them."""

from __future__ import annotations

import functools

import coal
import numpy as np
from scipy.spatial import ConvexHull

from .task import Array, Triangles


def convex(vertices: Array) -> coal.CollisionGeometry:
    """The convex hull of (n, 3) points, made once."""
    return _convex(np.ascontiguousarray(vertices, dtype=np.float64).tobytes())


@functools.lru_cache(maxsize=512)
def _convex(numbers: bytes) -> coal.CollisionGeometry:
    vertices = np.frombuffer(numbers).reshape(-1, 3)
    hull = ConvexHull(vertices)
    used, triangles = np.unique(hull.simplices, return_inverse=True)
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(len(hull.simplices), len(used))
    mesh.addVertices(vertices[used])
    for triangle in triangles.reshape(-1, 3):
        mesh.addTriangle(*vertices[used][triangle])
    mesh.endModel()
    mesh.buildConvexHull(True, "Qt")
    return mesh.convex


def corners_of(shape: coal.CollisionGeometry) -> Array:
    """(n, 3) points whose hull holds a shape."""
    if isinstance(shape, coal.ConvexBase):
        return np.array([shape.point(i) for i in range(shape.num_points)])
    shape.computeLocalAABB()
    box = np.stack([shape.aabb_local.min_, shape.aabb_local.max_])
    choice = np.array(np.meshgrid(*[(0, 1)] * 3)).reshape(3, -1)
    return np.column_stack([box[choice[k], k] for k in range(3)])


def as_convex(shape: coal.CollisionGeometry) -> coal.CollisionGeometry:
    """A convex mesh as a solid; any other shape as it is."""
    if not isinstance(shape, coal.BVHModelBase):
        return shape
    vertices, corners = mesh_of(shape)
    if np.linalg.matrix_rank(vertices - vertices[0], tol=1e-6) < 3:
        return shape
    hull = ConvexHull(vertices)
    middles = vertices[corners].mean(axis=1)
    few = 1 + len(middles) // 500  # most tell by a few
    room = 1 + 10_000_000 // len(hull.equations)
    parts = [middles[i : i + room] for i in range(0, len(middles), room)]
    for some in (middles[::few][:room], *parts):
        inside = -(some @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
        if inside.max() >= 1e-5:
            return shape
    return convex(vertices)


def mesh_of(shape: coal.BVHModelBase) -> tuple[Array, Triangles]:
    """Vertices (n, 3) and triangles (t, 3)."""
    rows = [shape.tri_indices(i) for i in range(shape.num_tris)]
    return np.array(shape.vertices()), np.array([[r[0], r[1], r[2]] for r in rows], dtype=int)
