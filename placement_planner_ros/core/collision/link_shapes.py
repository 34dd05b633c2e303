"""The shapes of a robot's links."""

from __future__ import annotations

import functools

import coal
import numpy as np
import trimesh

from placement_planner_ros.core.body.convex_part import polytope_of
from placement_planner_ros.core.collision.mesh_shapes import kept_shape
from placement_planner_ros.core.collision.shapes import Shape, shape_of
from placement_planner_ros.core.robot.geometry import LinkCover
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array


@functools.lru_cache(maxsize=8)
def link_shapes(robot: Robot) -> tuple[Shape, ...]:
    """The shape of each of the robot's geometries.

    Raises:
        RobotError: a geometry is of an unknown kind.
    """
    links, things = robot.geometry_links, robot.geometry.geometryObjects
    meshes = _mesh_shapes(robot.covers)
    return tuple(
        shape_of(thing.geometry, f"link {link}") if shape is None else shape
        for link, thing, shape in zip(links, things, meshes, strict=True)
    )


@functools.lru_cache(maxsize=8)
def _mesh_shapes(covers: tuple[LinkCover | None, ...]) -> tuple[Shape | None, ...]:
    """The shape of each mesh: one for geometries that share it, and for copies of a robot."""
    made: dict[LinkCover, Shape] = {}
    for cover in covers:
        if cover is not None and cover not in made:
            step(f"reading the shape of link {cover.mesh.link}")
            mesh = cover.mesh
            made[cover] = kept_shape(cover, mesh.vertices, mesh.triangles)
    return tuple(None if cover is None else made[cover] for cover in covers)


def shape_triangles(robot: Robot) -> list[Array]:
    """(t, 3, 3) triangles of each of the robot's geometries, in its own frame, metres.

    Raises:
        RobotError: a geometry is of an unknown kind.
    """
    shapes = zip(
        robot.geometry.geometryObjects,
        robot.geometry_links,
        robot.covers,
        strict=True,
    )
    return [
        _solid_triangles(shape.geometry, link)
        if cover is None
        else cover.mesh.vertices[cover.mesh.triangles]
        for shape, link, cover in shapes
    ]


def _solid_triangles(geometry: coal.CollisionGeometry, link: str) -> Array:
    """(t, 3, 3) triangles of a shape that is no mesh, metres."""
    if isinstance(geometry, coal.Sphere):
        return np.asarray(trimesh.creation.icosphere(radius=geometry.radius).triangles)
    if isinstance(geometry, coal.Capsule):
        pill = trimesh.creation.capsule(2.0 * geometry.halfLength, geometry.radius)
        return np.asarray(pill.triangles) - (0.0, 0.0, pill.bounds.mean(axis=0)[2])
    return polytope_of(shape_of(geometry, link).sets[0].vertices).corners
