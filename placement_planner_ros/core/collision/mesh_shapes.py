"""Shapes of meshes, kept on disk: trees over many triangles take seconds to make."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.convex_cover import Cover
from placement_planner_ros.core.collision.meshes import MeshTree
from placement_planner_ros.core.collision.shapes import Shape, convex_polytope
from placement_planner_ros.core.disk_cache import code_digest, digest_of, stored_result
from placement_planner_ros.core.types import Array


def kept_shape(cover: Cover, vertices: Array, triangles: npt.NDArray[np.int64]) -> Shape:
    """The shape of a mesh of vertices (n, 3) and triangles (t, 3) with a cover of it, from disk, or
    made and kept there."""
    parts = tuple(part.vertices for part in cover.parts)
    key = digest_of(code_digest(__name__), vertices, triangles, parts)
    return stored_result("mesh shapes", key, lambda: covered_mesh(cover, vertices, triangles))


def covered_mesh(cover: Cover, vertices: Array, triangles: npt.NDArray[np.int64]) -> Shape:
    """A mesh of vertices (n, 3) and triangles (t, 3) with a cover of it."""
    sets = tuple(convex_polytope(part.vertices) for part in cover.parts)
    return Shape(sets, MeshTree.of(vertices, triangles))
