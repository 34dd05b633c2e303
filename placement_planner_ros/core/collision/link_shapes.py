"""The shapes of a robot's links; what meshes take long for is kept on disk."""

from __future__ import annotations

import functools
import hashlib

import numpy as np

from placement_planner_ros.core.collision.meshes import MeshTree
from placement_planner_ros.core.collision.shapes import (
    ConvexSet,
    Shape,
    covered_mesh,
    shape_of,
)
from placement_planner_ros.core.kept_files import Arrays, kept_arrays, version_of
from placement_planner_ros.core.robot.geometry import LinkCover
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.stopping import step

_MAKERS = ("link_shapes.py", "meshes.py", "shapes.py", "../body/mesh_components.py")
"""Files that shape trees of triangles and the planes of parts."""

_TREE = ("boxes", "turned", "leaves", "corners", "closed", "components")


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
            made[cover] = _kept_shape(cover)
    return tuple(None if cover is None else made[cover] for cover in covers)


def _kept_shape(cover: LinkCover) -> Shape:
    """The shape of a mesh from disk, or made and kept there."""
    mesh = cover.mesh
    digest = hashlib.sha256(f"{_version()} {len(mesh.vertices)}".encode())
    for array in (mesh.vertices, mesh.triangles, *cover.parts):
        digest.update(f"{len(array)}".encode() + np.ascontiguousarray(array).tobytes())
    kept = kept_arrays("link shapes", digest.digest(), lambda: _arrays(cover))
    tree = MeshTree(digest=kept["digest"].tobytes(), **{name: kept[name] for name in _TREE})
    vertices = np.split(kept["vertices"], kept["first_vertex"])
    planes = np.split(kept["planes"], kept["first_plane"])
    sets = (
        ConvexSet(v, p[:, :3], p[:, 3], inner_scale=0.0)
        for v, p in zip(vertices, planes, strict=True)
    )
    return Shape(tuple(sets), tree, cover.excess)


@functools.cache
def _version() -> str:
    return version_of(__file__, _MAKERS)


def _arrays(cover: LinkCover) -> Arrays:
    shape = covered_mesh(cover, cover.mesh.vertices, cover.mesh.triangles)
    assert shape.mesh is not None
    sets = shape.sets
    return {
        **{name: getattr(shape.mesh, name) for name in _TREE},
        "digest": np.frombuffer(shape.mesh.digest, np.uint8),
        "vertices": np.vstack([each.vertices for each in sets]),
        "planes": np.vstack([np.column_stack([each.normals, each.offsets]) for each in sets]),
        "first_vertex": np.cumsum([len(each.vertices) for each in sets])[:-1],
        "first_plane": np.cumsum([len(each.offsets) for each in sets])[:-1],
    }
