"""Convex covers on disk, for the next process: made once for each content of a mesh."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable

import numpy as np

from placement_planner_ros.core.body.convex_cover import Cover
from placement_planner_ros.core.body.mesh_components import Triangles
from placement_planner_ros.core.kept_files import Arrays, kept_arrays, version_of
from placement_planner_ros.core.types import Array

_CUTTER = (
    "convex_cover.py",
    "cover_store.py",
    "mesh_components.py",
    "mesh_pieces.py",
    "mesh_surroundings.py",
    "polytope.py",
)
"""Files that shape covers."""


def kept_cover(
    vertices: Array, triangles: Triangles, tolerance: float, make: Callable[[], Cover]
) -> Cover:
    """The cover of a mesh from disk, or made and kept there.

    Args:
        vertices: (n, 3) metres.
        triangles: (t, 3) rows of vertices.
        tolerance: metres that parts may reach beyond the mesh.
        make: makes the cover; what it raises ends it.
    """
    digest = hashlib.sha256(f"{_version()} {tolerance} {len(vertices)}".encode())
    digest.update(np.ascontiguousarray(vertices, np.float64).tobytes())
    digest.update(np.ascontiguousarray(triangles, np.int64).tobytes())
    kept = kept_arrays("convex covers", digest.digest(), lambda: _arrays(make()))
    parts = np.split(kept["vertices"], kept["first"][1:])
    return Cover(tuple(parts), float(kept["excess"]), bool(kept["closed"]))


@functools.cache
def _version() -> str:
    return version_of(__file__, _CUTTER)


def _arrays(cover: Cover) -> Arrays:
    counts = [len(part) for part in cover.parts]
    return {
        "vertices": np.concatenate(cover.parts),
        "first": np.cumsum([0, *counts[:-1]]),
        "excess": np.array(cover.excess),
        "closed": np.array(cover.closed),
    }
