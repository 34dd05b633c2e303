"""The grasped object in its own frame: convex parts, placement faces F, volume points B_o."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.spatial import QhullError

from placement_planner_ros.core.body.convex_part import ConvexPart, hull_if_convex, polytope_of
from placement_planner_ros.core.body.covered_mesh import CoveredMesh, CoverMaker, kept_cover
from placement_planner_ros.core.body.mesh import MAX_PIECES, checked_center, checked_mesh
from placement_planner_ros.core.body.mesh_components import Components, Triangles, equal_rows
from placement_planner_ros.core.body.placement_face import PlacementFace, placement_faces
from placement_planner_ros.core.body.settings import BodySettings
from placement_planner_ros.core.body.volume_points import center_of_union, volume_points
from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.core.types import SINGLE_ROUNDING, Array, frozen_array, frozen_integers


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Body:
    """The grasped object in its own frame.

    Attributes:
        solids: its connected pieces that are convex.
        mesh: all others, if there are any.
        faces: F, larger first.
        volume_points: (n, 3) B_o, voxel centres inside.
        center_of_mass: (3,).
        vertices, triangles: (m, 3), (t, 3) the mesh.
        warnings: what was not as expected, in words.
        rolling: how many faces are left out as the object could roll from them.
        assumed: what it is taken for, in words.
        flatness: how far what touches a face's plane may be from it, metres.
    """

    solids: tuple[ConvexPart, ...]
    mesh: CoveredMesh | None
    faces: tuple[PlacementFace, ...]
    volume_points: Array
    center_of_mass: Array
    vertices: Array
    triangles: Triangles
    warnings: tuple[str, ...]
    rolling: int = 0
    assumed: tuple[str, ...] = ()
    flatness: float = field(default_factory=lambda: BodySettings().flatness)

    @property
    def parts(self) -> tuple[ConvexPart, ...]:
        """Convex parts whose union holds the object: those that cover `mesh` hold more."""
        return self.solids if self.mesh is None else self.solids + self.mesh.cover.parts

    @classmethod
    def from_mesh(
        cls,
        vertices: npt.ArrayLike,
        triangles: npt.ArrayLike,
        center_of_mass: npt.ArrayLike | None = None,
        scale: float = 1.0,
        settings: BodySettings | None = None,
        cover: CoverMaker = kept_cover,
    ) -> Body:
        """Prepare the object for planning.

        Each connected piece of the mesh that is convex is taken for its hull; the others are what
        their triangles are, and get a convex cover, which takes some seconds the first time. A
        piece that is not closed is a sheet without an inside and without mass; where there is no
        other, the centre of mass is that of the hull of all.

        Args:
            vertices: (m, 3).
            triangles: (t, 3) indices of vertices.
            center_of_mass: (3,) in the mesh's frame and units; of uniform density unless given.
            scale: metres per unit of the mesh.
            cover: makes the cover of what is not convex.

        Raises:
            ObjectError: empty, not finite, bad indices, without volume, implausibly large or
                small, with more triangles (`mesh.MAX_TRIANGLES`) or pieces (`mesh.MAX_PIECES`) than
                can be planned with, or a centre of mass outside the hull.
        """
        settings = settings or BodySettings()
        # The mesh in metres, its hull and its connected pieces.
        points, faces = checked_mesh(vertices, triangles, scale, settings.max_extent)
        components = Components.of(points, faces, weld=False)
        if not components.closed.all():
            components = Components.of(points, faces)
        count = len(components.closed)
        if count > MAX_PIECES:
            what = f"an object may have {MAX_PIECES} connected pieces"
            raise ObjectError("object", f"{count} pieces", what)
        try:
            hull = polytope_of(points)
        except QhullError as error:
            raise ObjectError("object", "flat mesh", "give it a thickness") from error
        # Convex pieces, and all others; those that bound a solid, and sheets, which have no inside.
        convex: list[ConvexPart] = []
        others: list[Array] = []
        within: list[Array] = []
        open_: list[Array] = []
        for piece, closed in zip(components.pieces(), components.closed, strict=True):
            part = hull_if_convex(piece)
            if part is None:
                others.append(piece)
                (within if closed else open_).append(piece)
            else:
                convex.append(part)
                within.append(piece if closed else part.corners)
        none = np.zeros((0, 3, 3))
        solids, sheets = np.concatenate([none, *within]), np.concatenate([none, *open_])
        fault = "the mesh is not closed: it counts as a sheet without inside or mass"
        warnings = [fault] if open_ else []
        # Where the mass is: of any density it has its centre within the hull.
        size = 0.5 * settings.voxel_size
        if center_of_mass is not None:
            center, whose = checked_center(center_of_mass, scale), "as given"
        else:
            center, whose = center_of_union(solids, hull, size), "of uniform density"
            whose = "of its closed pieces alone" if open_ else whose
            if not (hull.normals @ center <= hull.offsets).all():  # also where it is NaN
                center, whose = center_of_union(hull.corners, hull, size), "of its hull"
        outside = float(np.max(hull.normals @ center - hull.offsets))
        if outside > SINGLE_ROUNDING:
            raise ObjectError(
                "`center_of_mass`",
                center.tolist(),
                f"lies {outside:.4g} m outside the object's hull; give it in the object's frame",
            )
        # F, without those that it could roll from, and a cover of all pieces that are not convex.
        found = placement_faces(points, center, settings)
        kept = tuple(face for face in found if settings.allow_rolling or not face.rolls)
        if not kept:
            warnings.append("the object has no face to stand on")
        mesh = None
        if others:
            # Equal vertices of all pieces are one.
            corners = np.concatenate(others).reshape(-1, 3)
            first, kind = equal_rows(corners)
            mesh = CoveredMesh.of(corners[first], kind.reshape(-1, 3), cover)
            warnings += filter(None, [mesh.coarse_in_words])
        return cls(
            solids=tuple(convex),
            mesh=mesh,
            faces=kept,
            volume_points=frozen_array(volume_points(solids, sheets, hull, settings)),
            center_of_mass=frozen_array(center),
            vertices=frozen_array(points),
            triangles=frozen_integers(faces),
            warnings=tuple(warnings),
            rolling=len(found) - len(kept),
            assumed=(
                _size_in_words(points, scale),
                f"centre of mass ({', '.join(f'{x:.4f}' for x in np.round(center, 4) + 0.0)}) "
                f"{whose}",
                f"{fault if open_ else 'closed'}, {_cover_in_words(components, convex, mesh)}",
                _rests_in_words(kept, len(found) - len(kept)),
            ),
            flatness=settings.flatness,
        )


def _size_in_words(points: Array, scale: float) -> str:
    size = " x ".join(f"{side:.4g}" for side in np.ptp(points, axis=0))
    unit = "its numbers taken as metres" if scale == 1.0 else f"`scale` {scale:g}"
    return f"{size} m, {unit}"


def _cover_in_words(
    components: Components, convex: list[ConvexPart], mesh: CoveredMesh | None
) -> str:
    parts = len(convex) + (0 if mesh is None else len(mesh.cover.parts))
    beyond = "" if mesh is None else f", up to {mesh.cover.excess:.2g} m beyond it"
    return f"pieces: {len(components.closed)}, convex parts: {parts}{beyond}"


def _rests_in_words(faces: tuple[PlacementFace, ...], left_out: int) -> str:
    rolling = sum(face.rolls for face in faces)
    words = f"rests: {len(faces)}" + (f", it could roll from {rolling} of them" if rolling else "")
    return words + (
        f"; left out, as it could roll: {left_out} (`allow_rolling`)" if left_out else ""
    )
