"""Collision geometry as convex sets: what every distance kernel works on.

A convex set is the hull of its vertices, dilated by a radius (a sphere is one dilated point, a
capsule two). Solid shapes are one set; a mesh (the robot model has already made convex ones into
polytopes) is the surface made of its triangles, one set each, as coal sees it. Curved shapes
without such a form (cylinder, cone, ellipsoid) are enclosed by a polytope, marked as not exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import coal
import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.types import Array, frozen_array

_SIDES = 32


@dataclass(frozen=True, slots=True, eq=False)
class ConvexSet:
    """The hull of `vertices`, dilated by `radius`.

    Attributes:
        vertices: (m, 3) metres.
        normals, offsets: (p, 3), (p,) face planes n·x ≤ d of the hull, merged; empty where it has
            no volume.
        radius: metres.
        exact: whether the set is the shape itself; if not, it contains it.
    """

    vertices: Array
    normals: Array
    offsets: Array
    radius: float = 0.0
    exact: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", frozen_array(self.vertices, (-1, 3)))
        object.__setattr__(self, "normals", frozen_array(self.normals, (-1, 3)))
        object.__setattr__(self, "offsets", frozen_array(self.offsets, (-1,)))


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """One collision geometry.

    Attributes:
        sets: the convex sets it is made of.
        solid: whether it is one solid set; otherwise the sets are the triangles of a surface.
    """

    sets: tuple[ConvexSet, ...]
    solid: bool


def polytope(vertices: Array, radius: float = 0.0, exact: bool = True) -> ConvexSet:
    """The hull of (m, 3) vertices with its merged face planes, remembered.

    Raises:
        QhullError: the vertices span no volume.
    """
    return _polytope(np.array(vertices, dtype=np.float64).tobytes(), radius, exact)


@lru_cache(maxsize=4096)
def _polytope(data: bytes, radius: float, exact: bool) -> ConvexSet:
    vertices = np.frombuffer(data).reshape(-1, 3)
    hull = ConvexHull(vertices)
    planes = merge_planes(hull.equations)
    return ConvexSet(vertices[np.sort(hull.vertices)], planes[:, :3], -planes[:, 3], radius, exact)


def merge_planes(equations: Array) -> Array:
    """Drop repeated rows (n, d) of qhull's (f, 4) facet equations; the outermost is kept."""
    _, first = np.unique(np.round(equations, 6), axis=0, return_index=True)
    return np.asarray(equations[np.sort(first)])


def shape_of(geometry: coal.CollisionGeometry, name: str) -> Shape:
    """The convex sets of a coal geometry, in its own frame.

    Args:
        geometry: primitive, Convex or BVH.
        name: the link's or geometry's name, for errors.

    Raises:
        RobotError: empty, not finite, without volume, or of a kind no robot link has.
    """
    if isinstance(geometry, coal.BVHModelBase):
        return _mesh_shape(geometry, name)
    radius = (
        float(geometry.getSweptSphereRadius()) if hasattr(geometry, "getSweptSphereRadius") else 0.0
    )
    none = np.zeros((0, 3)), np.zeros(0)
    if isinstance(geometry, coal.Sphere):
        _positive(name, geometry.radius)
        return _solid(ConvexSet(np.zeros((1, 3)), *none, geometry.radius + radius))
    if isinstance(geometry, coal.Capsule):
        _positive(name, geometry.radius)
        ends = np.array([[0, 0, -geometry.halfLength], [0, 0, geometry.halfLength]])
        return _solid(ConvexSet(ends, *none, geometry.radius + radius))
    exact = True
    if isinstance(geometry, coal.Box):
        vertices = np.array(np.meshgrid(*([-1, 1],) * 3)).reshape(3, -1).T * geometry.halfSide
    elif isinstance(geometry, coal.ConvexBase):
        vertices = np.array([geometry.point(i) for i in range(geometry.num_points)])
    elif isinstance(geometry, coal.Cylinder):
        rim = _circumscribed_polygon(geometry.radius)
        up = np.array([0.0, 0.0, geometry.halfLength])
        vertices = np.vstack([rim - up, rim + up])
        exact = False
    elif isinstance(geometry, coal.Cone):
        rim = _circumscribed_polygon(geometry.radius)
        up = np.array([0.0, 0.0, geometry.halfLength])
        vertices = np.vstack([rim - up, up])
        exact = False
    elif isinstance(geometry, coal.Ellipsoid):
        ball = trimesh.creation.icosphere(subdivisions=2)
        inscribed = np.min(np.einsum("ij,ij->i", ball.face_normals, ball.triangles_center))
        vertices = np.asarray(ball.vertices) / inscribed * geometry.radii
        exact = False
    else:
        raise RobotError(
            f"collision geometry of {name}",
            type(geometry).__name__,
            "use boxes, cylinders, spheres, capsules, cones, ellipsoids or meshes",
        )
    if not np.isfinite(vertices).all():
        raise RobotError(f"collision geometry of {name}", "not finite", "repair its numbers")
    try:
        return _solid(polytope(vertices, radius, exact))
    except (QhullError, ValueError) as error:
        raise RobotError(
            f"collision geometry of {name}",
            f"{len(vertices)} vertices without volume",
            "give every side a length above zero",
        ) from error


def triangle_mesh(geometry: coal.BVHModelBase) -> tuple[Array, np.ndarray]:
    """Vertices (n, 3) and triangles (t, 3) of a coal mesh."""
    vertices = np.array([geometry.vertex(i) for i in range(geometry.num_vertices)])
    rows = (geometry.tri_indices(i) for i in range(geometry.num_tris))
    triangles = np.array([[t[0], t[1], t[2]] for t in rows], dtype=np.int64)
    return vertices.reshape(-1, 3), triangles.reshape(-1, 3)


def _mesh_shape(geometry: coal.BVHModelBase, name: str) -> Shape:
    vertices, triangles = triangle_mesh(geometry)
    if not len(triangles) or not np.isfinite(vertices).all():
        raise RobotError(
            f"collision geometry of {name}",
            f"{len(triangles)} triangles",
            "the mesh is empty or has vertices that are not finite: repair the file",
        )
    corners = vertices[triangles]
    sides = corners[:, 1:] - corners[:, :1]
    corners = corners[np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) > 0.0]
    none = np.zeros((0, 3)), np.zeros(0)
    return Shape(tuple(ConvexSet(corner, *none) for corner in corners), solid=False)


def _solid(convex_set: ConvexSet) -> Shape:
    return Shape((convex_set,), solid=True)


def _circumscribed_polygon(radius: float) -> Array:
    angles = np.arange(_SIDES) * (2 * np.pi / _SIDES)
    rim = np.stack([np.cos(angles), np.sin(angles), np.zeros(_SIDES)], axis=1)
    return np.asarray(rim * (radius / np.cos(np.pi / _SIDES)))


def _positive(name: str, radius: float) -> None:
    if not (np.isfinite(radius) and radius > 0.0):
        raise RobotError(
            f"collision geometry of {name}", radius, "give a radius above zero, in metres"
        )
