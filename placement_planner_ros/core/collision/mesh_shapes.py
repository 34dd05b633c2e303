"""Shapes of meshes, kept on disk: trees over many triangles take seconds to make."""

from __future__ import annotations

import functools
import hashlib

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.convex_cover import Cover
from placement_planner_ros.core.collision.meshes import MeshTree
from placement_planner_ros.core.collision.shapes import ConvexSet, Shape, covered_mesh
from placement_planner_ros.core.kept_files import Arrays, kept_arrays, version_of
from placement_planner_ros.core.types import Array

_MAKERS = ("mesh_shapes.py", "meshes.py", "shapes.py", "../body/mesh_components.py")
"""Files that shape trees of triangles and the planes of parts."""

_TREE = ("boxes", "turned", "leaves", "corners", "closed", "components")


def kept_shape(cover: Cover, vertices: Array, triangles: npt.NDArray[np.int64]) -> Shape:
    """The shape of a mesh of vertices (n, 3) and triangles (t, 3) with a cover of it, from disk, or
    made and kept there."""
    digest = hashlib.sha256(f"{_version()} {len(vertices)}".encode())
    for array in (vertices, triangles, *cover.parts):
        digest.update(f"{len(array)}".encode() + np.ascontiguousarray(array).tobytes())

    def make() -> Arrays:
        return _arrays(covered_mesh(cover, vertices, triangles))

    kept = kept_arrays("mesh shapes", digest.digest(), make)
    tree = MeshTree(digest=kept["digest"].tobytes(), **{name: kept[name] for name in _TREE})
    points = np.split(kept["vertices"], kept["first_vertex"])
    planes = np.split(kept["planes"], kept["first_plane"])
    sets = (
        ConvexSet(v, p[:, :3], p[:, 3], inner_scale=0.0)
        for v, p in zip(points, planes, strict=True)
    )
    return Shape(tuple(sets), tree, cover.excess)


@functools.cache
def _version() -> str:
    return version_of(__file__, _MAKERS)


def _arrays(shape: Shape) -> Arrays:
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
