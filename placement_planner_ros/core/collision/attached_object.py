"""The object as an arm has it, attached to the hand or placed, and what it is to collision checks:
convex pieces as they are, all others as triangles."""

from __future__ import annotations

from dataclasses import dataclass

import coal
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.body.covered_mesh import CoveredMesh
from placement_planner_ros.core.collision.shapes import ConvexSet, Shape, mesh_shape
from placement_planner_ros.core.robot.geometry import convex_geometry, triangle_geometry
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.robot.overlap import Overlaps
from placement_planner_ros.core.weak_cache import weak_lru_cache


@dataclass(frozen=True, slots=True, eq=False)
class AttachedObject:
    """The object moves with the hand.

    Attributes:
        grasp: index into the arm's grasps.
    """

    body: Body
    grasp: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class PlacedObject:
    """The object stands at x; to the arm it is an obstacle."""

    body: Body
    T_world_object: pin.SE3


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
    solids = [
        ObjectSolid(Shape((ConvexSet.of(part),)), convex_geometry(part)) for part in body.solids
    ]
    # What is a mesh, by its cover.
    if body.mesh is not None:
        surface = triangle_geometry(body.mesh.vertices, body.mesh.triangles)
        solids.append(ObjectSolid(mesh_shape(body.mesh), surface, body.mesh))
    return tuple(solids)


@weak_lru_cache("body", maxsize=4)
def object_overlaps(robot: Robot, body: Body) -> Overlaps:
    """How the robot's geometries overlap the object's solids, which follow them in number."""
    return Overlaps(robot, [(solid.geometry, solid.mesh) for solid in object_solids(body)])
