"""A mesh that is not convex: its triangles, and convex parts that hold them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from placement_planner_ros.core.body.convex_cover import Cover, convex_cover, cover_tolerance
from placement_planner_ros.core.body.mesh_components import Triangles
from placement_planner_ros.core.disk_cache import code_digest, digest_of, stored_result
from placement_planner_ros.core.types import Array, frozen_array, frozen_integers

CoverMaker = Callable[[Array, Triangles], Cover]
"""Makes the cover of vertices (n, 3) and triangles (t, 3)."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class CoveredMesh:
    """The mesh of a link, or all pieces of an object, that are not convex.

    Attributes:
        vertices: (n, 3) metres.
        triangles: (t, 3) rows of vertices.
        cover: convex parts that together contain them; they only ever say what is free.
    """

    vertices: Array
    triangles: Triangles
    cover: Cover

    @classmethod
    def of(cls, vertices: Array, triangles: Triangles, make: CoverMaker) -> CoveredMesh:
        """With the cover that is made of it."""
        return cls(frozen_array(vertices), frozen_integers(triangles), make(vertices, triangles))

    @property
    def coarse_in_words(self) -> str:
        """That the cover reaches further than twice its tolerance; '' where it does not."""
        tolerance = cover_tolerance(self.vertices)
        if self.cover.excess <= 2.0 * tolerance:
            return ""
        return (
            f"its convex cover reaches {self.cover.excess:.3f} m beyond its mesh instead of "
            f"{tolerance:g}, which slows down checks beside it; a simpler mesh has a closer one"
        )


def kept_cover(vertices: Array, triangles: Triangles, make: CoverMaker = convex_cover) -> Cover:
    """The cover of a mesh from disk, or made and kept there; `stoppable`.

    Args:
        vertices: (n, 3) metres.
        triangles: (t, 3) rows of vertices.
        make: what it raises ends it.
    """
    key = digest_of(code_digest(__name__), vertices, triangles)
    return stored_result("convex covers", key, lambda: make(vertices, triangles))
