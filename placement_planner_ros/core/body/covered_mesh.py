"""Pieces of an object that are not convex: their triangles, and convex parts that hold them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from placement_planner_ros.core.body.convex_cover import (
    Cover,
    convex_cover,
    cover_tolerance,
)
from placement_planner_ros.core.body.convex_part import read_only
from placement_planner_ros.core.body.mesh_components import Triangles, equal_rows
from placement_planner_ros.core.disk_cache import code_digest, digest_of, stored_result
from placement_planner_ros.core.types import Array, frozen_array

CoverMaker = Callable[[Array, Triangles, float], Cover]
"""Makes the cover of vertices (n, 3), triangles (t, 3), within a tolerance, metres."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class CoveredMesh:
    """All pieces of an object that are not convex.

    Attributes:
        vertices: (n, 3) metres.
        triangles: (t, 3) rows of vertices.
        cover: convex parts that together contain them; they only ever say what is free.
    """

    vertices: Array
    triangles: Triangles
    cover: Cover

    @classmethod
    def of(cls, corners: Array, make: CoverMaker) -> CoveredMesh:
        """Of their triangles (t, 3, 3)."""
        # Equal vertices of all pieces are one.
        points = corners.reshape(-1, 3)
        first, kind = equal_rows(points)
        vertices, triangles = points[first], kind.reshape(-1, 3)
        cover = make(vertices, triangles, cover_tolerance(vertices))
        return cls(frozen_array(vertices), read_only(triangles), cover)


def kept_cover(
    vertices: Array, triangles: Triangles, tolerance: float, make: CoverMaker = convex_cover
) -> Cover:
    """The cover of a mesh from disk, or made and kept there; `stoppable`.

    Args:
        vertices: (n, 3) metres.
        triangles: (t, 3) rows of vertices.
        tolerance: metres that parts may reach beyond the mesh.
        make: what it raises ends it.
    """
    key = digest_of(code_digest(__name__), vertices, triangles, tolerance)
    return stored_result("convex covers", key, lambda: make(vertices, triangles, tolerance))
