"""The shapes of a robot's links."""

from __future__ import annotations

import functools

from placement_planner_ros.core.collision.mesh_shapes import kept_shape
from placement_planner_ros.core.collision.shapes import Shape, shape_of
from placement_planner_ros.core.robot.geometry import LinkCover
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.stopping import step


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
