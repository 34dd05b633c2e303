"""The grasped object in its own frame: convex parts, placement faces F, volume points B_o."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh

from placement_planner_ros.core.body.convex_part import ConvexPart, hull_of, part_of
from placement_planner_ros.core.body.mesh import (
    Triangles,
    checked_center,
    checked_mesh,
    connected_pieces,
    read_only,
)
from placement_planner_ros.core.body.placement_face import PlacementFace, placement_faces
from placement_planner_ros.core.body.settings import BodySettings
from placement_planner_ros.core.body.volume_points import volume_points
from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.core.types import Array, frozen_array


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """The grasped object in its own frame.

    Attributes:
        parts: convex parts whose union holds the object.
        faces: F, larger first.
        volume_points: (n, 3) B_o, voxel centres inside.
        center_of_mass: (3,).
        vertices, triangles: (m, 3), (t, 3) the mesh.
        warnings: what was not as expected, in words.
    """

    parts: tuple[ConvexPart, ...]
    faces: tuple[PlacementFace, ...]
    volume_points: Array
    center_of_mass: Array
    vertices: Array
    triangles: Triangles
    warnings: tuple[str, ...]

    @classmethod
    def from_mesh(
        cls,
        vertices: npt.ArrayLike,
        triangles: npt.ArrayLike,
        center_of_mass: npt.ArrayLike | None = None,
        scale: float = 1.0,
        settings: BodySettings | None = None,
    ) -> Body:
        """Prepare the object for planning.

        Each connected piece of the mesh becomes a convex part: itself where it is convex, else its
        hull, which is on the safe side. Where a piece is not closed, or some of its triangles face
        inward, B_o and the centre of mass are those of the hull of all.

        Args:
            vertices: (m, 3).
            triangles: (t, 3) indices of vertices.
            center_of_mass: (3,) in the mesh's frame and units; of uniform density unless given.
            scale: metres per unit of the mesh.

        Raises:
            ObjectError: empty, not finite, bad indices, without volume, implausibly large or
                small, with more triangles (`mesh.MAX_TRIANGLES`), pieces (`mesh.MAX_PIECES`) or
                hull facets (`convex_part.MAX_FACETS`) than can be planned with, or a centre of mass
                outside the hull.
        """
        settings = settings or BodySettings()
        points, faces = checked_mesh(vertices, triangles, scale, settings.max_extent)
        hull = hull_of(points[np.unique(faces)])
        warnings: list[str] = []
        pieces = connected_pieces(points, faces)
        parts = tuple(part_of(piece, number, warnings) for number, piece in enumerate(pieces))
        solids = pieces
        fault = _no_solid(pieces)
        if fault:
            warnings.append(f"{fault}: volume and centre of mass are its hull's")
            solids = [trimesh.Trimesh(hull.vertices, hull.triangles, process=False)]
        surface = np.concatenate([np.asarray(solid.triangles) for solid in solids])
        points_inside = volume_points(surface, hull, settings, warnings)
        if center_of_mass is not None:
            center = checked_center(center_of_mass, scale)
        elif len(solids) == 1 and np.isfinite(solids[0].center_mass).all():
            center = np.asarray(solids[0].center_mass)
        else:  # pieces may overlap, and so may one with itself: count what they share once
            center = points_inside.mean(axis=0)
        outside = float(np.max(hull.normals @ center - hull.offsets))
        if outside > 1e-6:
            raise ObjectError(
                "object.center_of_mass",
                center.tolist(),
                f"lies {outside:.4g} m outside the object's hull; give it in the object's frame",
            )
        found = placement_faces(hull, center, settings)
        if not found:
            warnings.append("the object has no face to stand on")
        return cls(
            parts=parts,
            faces=found,
            volume_points=frozen_array(points_inside),
            center_of_mass=frozen_array(center),
            vertices=frozen_array(points),
            triangles=read_only(faces),
            warnings=tuple(warnings),
        )


def _no_solid(pieces: list[trimesh.Trimesh]) -> str:
    """Why the pieces' own volume cannot be told, in words; empty where it can."""
    if not all(piece.is_watertight for piece in pieces):
        return "the mesh is not closed"
    if not all(piece.is_winding_consistent for piece in pieces):
        return "some triangles of the mesh face inward"
    return ""
