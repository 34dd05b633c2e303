"""Collision geometry of links and objects as convex sets: what every distance kernel works on.

A convex set is the hull of its vertices, dilated by a radius (a sphere is one dilated point, a
capsule two). A mesh (the robot model has already made convex ones into polytopes) is covered by a
few sets that contain it, and has its triangles beside them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import coal
import numpy as np
import trimesh
from scipy.spatial import QhullError

from placement_planner_ros.core.body.convex_part import ConvexPart, polytope_of
from placement_planner_ros.core.body.covered_mesh import CoveredMesh
from placement_planner_ros.core.collision.meshes import MeshTree
from placement_planner_ros.core.disk_cache import code_digest, digest_of, stored_result
from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array, frozen_array


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

    @classmethod
    def of(cls, part: ConvexPart, radius: float = 0.0) -> ConvexSet:
        """A polytope, dilated by a radius, metres."""
        return cls(part.vertices, part.normals, part.offsets, radius)


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Shape:
    """One collision geometry.

    Attributes:
        sets: the convex sets that together contain it.
        mesh: its triangles, where the sets are a cover.
    """

    sets: tuple[ConvexSet, ...]
    mesh: MeshTree | None = None


@lru_cache(maxsize=4096)
def _convex_hull(data: bytes, radius: float) -> Shape:
    """The hull of vertices, dilated by a radius, metres: the same for copies of a robot."""
    return Shape((ConvexSet.of(polytope_of(np.frombuffer(data).reshape(-1, 3)), radius),))


def mesh_shape(mesh: CoveredMesh) -> Shape:
    """A mesh by its cover and its triangles, from disk, or made and kept there: trees over many
    triangles take seconds to make."""
    vertices, triangles, parts = mesh.vertices, mesh.triangles, mesh.cover.parts

    def make() -> Shape:
        return Shape(tuple(map(ConvexSet.of, parts)), MeshTree.of(vertices, triangles))

    corners = tuple(part.vertices for part in parts)
    key = digest_of(code_digest(__name__), vertices, triangles, corners)
    return stored_result("mesh shapes", key, make)


@lru_cache(maxsize=8)
def link_shapes(robot: Robot) -> tuple[Shape, ...]:
    """The shape of each of the robot's geometries.

    Raises:
        RobotError: a geometry is of an unknown kind.
    """
    links, things = robot.geometry_links, robot.geometry.geometryObjects
    return tuple(
        shape_of(thing.geometry, f"link {link}") if shape is None else shape
        for link, thing, shape in zip(links, things, _mesh_shapes(robot.meshes), strict=True)
    )


def shape_triangles(robot: Robot) -> list[Array]:
    """(t, 3, 3) triangles of each of the robot's geometries, in its own frame, metres.

    Raises:
        RobotError: a geometry is of an unknown kind.
    """
    links, things = robot.geometry_links, robot.geometry.geometryObjects
    return [
        _solid_triangles(thing.geometry, link) if mesh is None else mesh.vertices[mesh.triangles]
        for thing, link, mesh in zip(things, links, robot.meshes, strict=True)
    ]


def _solid_triangles(geometry: coal.CollisionGeometry, link: str) -> Array:
    """(t, 3, 3) triangles of a shape that is no mesh, metres."""
    if isinstance(geometry, coal.Sphere):
        return np.asarray(trimesh.creation.icosphere(4, geometry.radius).triangles)
    if isinstance(geometry, coal.Capsule):
        pill = trimesh.creation.capsule(2.0 * geometry.halfLength, geometry.radius, [64, 64])
        return np.asarray(pill.triangles) - (0.0, 0.0, pill.bounds.mean(axis=0)[2])
    return polytope_of(shape_of(geometry, link).sets[0].vertices).corners


@lru_cache(maxsize=8)
def _mesh_shapes(meshes: tuple[CoveredMesh | None, ...]) -> tuple[Shape | None, ...]:
    """The shape of each mesh: one for geometries that share it, and for copies of a robot."""
    made: dict[CoveredMesh | None, Shape | None] = {None: None}
    for mesh in meshes:
        if mesh is not None and mesh not in made:
            step("reading the shapes of links")
            made[mesh] = mesh_shape(mesh)
    return tuple(made[mesh] for mesh in meshes)


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
    else:
        raise RobotError(
            f"collision geometry of {name}",
            type(geometry).__name__,
            "use boxes, spheres, capsules or polytopes",
        )
    if not np.isfinite(vertices).all():
        raise RobotError(f"collision geometry of {name}", "not finite", "repair its numbers")
    try:
        return _convex_hull(vertices.tobytes(), radius)
    except (QhullError, ValueError) as error:
        raise RobotError(
            f"collision geometry of {name}",
            f"{len(vertices)} vertices without volume",
            "give every side a length above zero",
        ) from error


def _require_positive(name: str, radius: float) -> None:
    if not (np.isfinite(radius) and radius > 0.0):
        raise RobotError(
            f"collision geometry of {name}", radius, "give a radius above zero, in metres"
        )
