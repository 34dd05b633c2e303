"""Collision geometry as convex sets: what every distance kernel works on.

A convex set is the hull of its vertices, dilated by a radius (a sphere is one dilated point, a
capsule two). A mesh (the robot model has already made convex ones into polytopes) is covered by a
few sets that contain it, and has its triangles beside them. Curved shapes without such a form
(cylinder, cone, ellipsoid) are taken for a polytope that encloses them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import coal
import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from placement_planner_ros.core.collision.meshes import MeshTree
from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.types import Array, frozen_array

_ROUND_SIDES = 32


@dataclass(frozen=True, slots=True, eq=False)
class ConvexSet:
    """The hull of `vertices`, dilated by `radius`.

    Attributes:
        vertices: (m, 3) metres.
        normals, offsets: (p, 3), (p,) face planes n·x ≤ d of the hull, merged; empty where it has
            no volume.
        radius: metres.
    """

    vertices: Array
    normals: Array
    offsets: Array
    radius: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", frozen_array(self.vertices, (-1, 3)))
        object.__setattr__(self, "normals", frozen_array(self.normals, (-1, 3)))
        object.__setattr__(self, "offsets", frozen_array(self.offsets, (-1,)))


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Shape:
    """One collision geometry.

    Attributes:
        sets: the convex sets that together contain it.
        mesh: its triangles, where the sets are a cover.
    """

    sets: tuple[ConvexSet, ...]
    mesh: MeshTree | None = None


def convex_polytope(vertices: Array, radius: float = 0.0) -> ConvexSet:
    """The hull of (m, 3) vertices with its merged face planes, remembered.

    Raises:
        QhullError: the vertices span no volume.
    """
    return _made_polytope(np.array(vertices, dtype=np.float64).tobytes(), radius)


@lru_cache(maxsize=4096)
def _made_polytope(data: bytes, radius: float) -> ConvexSet:
    vertices = np.frombuffer(data).reshape(-1, 3)
    hull = ConvexHull(vertices)
    planes = merge_planes(hull.equations)
    return ConvexSet(vertices[np.sort(hull.vertices)], planes[:, :3], -planes[:, 3], radius)


def merge_planes(equations: Array) -> Array:
    """Drop repeated rows (n, d) of qhull's (f, 4) facet equations; the outermost is kept."""
    _, first = np.unique(np.round(equations, 6), axis=0, return_index=True)
    return np.asarray(equations[np.sort(first)])


def shape_of(geometry: coal.CollisionGeometry, name: str) -> Shape:
    """The convex set of a coal geometry, in its own frame.

    Args:
        geometry: primitive or Convex.
        name: the link's or geometry's name, for errors.

    Raises:
        RobotError: empty, not finite, without volume, or of a kind no robot link has.
    """
    radius = (
        float(geometry.getSweptSphereRadius()) if hasattr(geometry, "getSweptSphereRadius") else 0.0
    )
    # Round solids: a point or a segment with a radius.
    none = np.zeros((0, 3)), np.zeros(0)
    if isinstance(geometry, coal.Sphere):
        _require_positive(name, geometry.radius)
        return Shape((ConvexSet(np.zeros((1, 3)), *none, geometry.radius + radius),))
    if isinstance(geometry, coal.Capsule):
        _require_positive(name, geometry.radius)
        ends = np.array([[0, 0, -geometry.halfLength], [0, 0, geometry.halfLength]])
        return Shape((ConvexSet(ends, *none, geometry.radius + radius),))
    # Vertices of the others.
    if isinstance(geometry, coal.Box):
        vertices = np.array(np.meshgrid(*([-1, 1],) * 3)).reshape(3, -1).T * geometry.halfSide
    elif isinstance(geometry, coal.ConvexBase):
        vertices = np.array([geometry.point(i) for i in range(geometry.num_points)])
    elif isinstance(geometry, coal.Cylinder):
        rim = _circumscribed_polygon(geometry.radius)
        up = np.array([0.0, 0.0, geometry.halfLength])
        vertices = np.vstack([rim - up, rim + up])
    elif isinstance(geometry, coal.Cone):
        rim = _circumscribed_polygon(geometry.radius)
        up = np.array([0.0, 0.0, geometry.halfLength])
        vertices = np.vstack([rim - up, up])
    elif isinstance(geometry, coal.Ellipsoid):
        ball = trimesh.creation.icosphere(subdivisions=2)
        inscribed = np.min(np.einsum("ij,ij->i", ball.face_normals, ball.triangles_center))
        vertices = np.asarray(ball.vertices) / inscribed * geometry.radii
    else:
        raise RobotError(
            f"collision geometry of {name}",
            type(geometry).__name__,
            "use boxes, cylinders, spheres, capsules, cones, ellipsoids or meshes",
        )
    if not np.isfinite(vertices).all():
        raise RobotError(f"collision geometry of {name}", "not finite", "repair its numbers")
    try:
        return Shape((convex_polytope(vertices, radius),))
    except (QhullError, ValueError) as error:
        raise RobotError(
            f"collision geometry of {name}",
            f"{len(vertices)} vertices without volume",
            "give every side a length above zero",
        ) from error


def _circumscribed_polygon(radius: float) -> Array:
    angles = np.arange(_ROUND_SIDES) * (2 * np.pi / _ROUND_SIDES)
    rim = np.stack([np.cos(angles), np.sin(angles), np.zeros(_ROUND_SIDES)], axis=1)
    return np.asarray(rim * (radius / np.cos(np.pi / _ROUND_SIDES)))


def _require_positive(name: str, radius: float) -> None:
    if not (np.isfinite(radius) and radius > 0.0):
        raise RobotError(
            f"collision geometry of {name}", radius, "give a radius above zero, in metres"
        )
