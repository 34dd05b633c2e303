"""The object as collision checks see it: convex pieces as they are, all others as triangles."""

from __future__ import annotations

from dataclasses import dataclass

import coal

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.body.convex_part import ConvexPart
from placement_planner_ros.core.body.covered_mesh import CoveredMesh
from placement_planner_ros.core.collision.mesh_shapes import kept_shape
from placement_planner_ros.core.collision.shapes import ConvexSet, Shape
from placement_planner_ros.core.robot.geometry import convex_geometry, triangle_geometry
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.robot.overlap import Overlaps, link_meshes
from placement_planner_ros.core.weak_cache import weak_lru_cache


@dataclass(frozen=True, eq=False)
class ObjectSolid:
    """A piece of the object, in its frame.

    Attributes:
        shape: for the kernels.
        geometry: for coal, to which a mesh is a surface.
        mesh: None where it is convex.
    """

    shape: Shape
    geometry: coal.CollisionGeometry
    mesh: CoveredMesh | None = None


@weak_lru_cache("body", maxsize=1)
def object_solids(body: Body) -> tuple[ObjectSolid, ...]:
    """The convex pieces, each for itself, and all others together."""
    solids = []
    # A solid for each convex piece.
    for part in body.solids:
        solids.append(ObjectSolid(Shape((part_set(part),)), convex_geometry(part)))
    # What is a mesh, by its cover.
    if body.mesh is not None:
        shape = kept_shape(body.mesh.cover, body.mesh.vertices, body.mesh.triangles)
        surface = triangle_geometry(body.mesh.vertices, body.mesh.triangles)
        solids.append(ObjectSolid(shape, surface, body.mesh))
    return tuple(solids)


@weak_lru_cache("body", maxsize=4)
def object_overlaps(robot: Robot, body: Body) -> Overlaps:
    """How the robot's geometries overlap the object's solids, which follow them in number."""
    links = [thing.geometry for thing in robot.geometry.geometryObjects]
    solids = object_solids(body)
    meshes = [*link_meshes(robot), *(solid.mesh for solid in solids)]
    return Overlaps([*links, *(solid.geometry for solid in solids)], meshes)


def part_set(part: ConvexPart) -> ConvexSet:
    """A part of the object; planes that stand for several facets are moved out to hold it."""
    offsets = (part.vertices @ part.normals.T).max(axis=0)
    return ConvexSet(part.vertices, part.normals, offsets)
