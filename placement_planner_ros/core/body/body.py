"""The grasped object in its own frame: convex parts, placement faces F, volume points B_o."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.assumed import in_words
from placement_planner_ros.core.body.convex_cover import cover_tolerance
from placement_planner_ros.core.body.convex_part import ConvexPart, convex_part, hull_of
from placement_planner_ros.core.body.covered_mesh import CoveredMesh, CoverMaker, make_cover
from placement_planner_ros.core.body.holes import NO_HOLES, Holes, together, volume_of
from placement_planner_ros.core.body.mesh import (
    MeshPiece,
    Triangles,
    checked_center,
    checked_mesh,
    connected_pieces,
    read_only,
    volumes,
)
from placement_planner_ros.core.body.mesh_components import Components
from placement_planner_ros.core.body.placement_face import PlacementFace, offered, placement_faces
from placement_planner_ros.core.body.settings import BodySettings
from placement_planner_ros.core.body.volume_points import center_of_union, volume_points
from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.core.types import Array, frozen_array

_COARSE = 2.0
"""Times the tolerance beyond which a cover is told."""

_OPEN = "the mesh is not closed: it counts as a sheet without an inside"

_SURE = 0.02
"""Share of the object's size by which holes may move its centre of mass for it not to be taken from
the hull."""


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
        return self.solids if self.mesh is None else self.solids + self.mesh.parts

    @classmethod
    def from_mesh(
        cls,
        vertices: npt.ArrayLike,
        triangles: npt.ArrayLike,
        center_of_mass: npt.ArrayLike | None = None,
        scale: float = 1.0,
        settings: BodySettings | None = None,
        cover: CoverMaker = make_cover,
    ) -> Body:
        """Prepare the object for planning.

        Each connected piece of the mesh that is convex is taken for its hull; the others are what
        their triangles are, and get a convex cover, which takes some seconds the first time. A
        piece that is not closed is a sheet without an inside; where its holes could move the centre
        of mass far, that is the one of the hull of all.

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
        points, faces = checked_mesh(vertices, triangles, scale, settings.max_extent)
        hull = hull_of(points)
        warnings: list[str] = []
        pieces = connected_pieces(points, faces)
        parts = [convex_part(piece, number, warnings) for number, piece in enumerate(pieces)]
        surfaces = [_Surface.of(each, part) for each, part in zip(pieces, parts, strict=True)]
        fault = next((surface.fault for surface in surfaces if surface.fault), "")
        closed = np.concatenate([surface.closed for surface in surfaces])
        open_ = np.concatenate([surface.open for surface in surfaces])
        points_inside = volume_points(closed, open_, hull, settings, warnings)
        if center_of_mass is not None:
            center, whose = checked_center(center_of_mass, scale), "as given"
        else:
            center, whose = _center_of_mass(surfaces, hull, fault)
        if fault:
            warnings.append(f"{fault}; centre of mass {whose}")
        outside = float(np.max(hull.normals @ center - hull.offsets))
        if outside > 1e-6:
            raise ObjectError(
                "object.center_of_mass",
                center.tolist(),
                f"lies {outside:.4g} m outside the object's hull; give it in the object's frame",
            )
        found, rolling = offered(placement_faces(points, center, settings), settings, warnings)
        rest = [piece for piece, part in zip(pieces, parts, strict=True) if part is None]
        mesh = CoveredMesh.of(rest, cover) if rest else None
        if mesh is not None and mesh.cover.excess > _COARSE * cover_tolerance(mesh.vertices):
            warnings.append(
                f"its convex cover reaches {mesh.cover.excess:.3f} m beyond its mesh instead of "
                f"{cover_tolerance(mesh.vertices):g}, which slows down checks beside it; a simpler "
                "mesh has a closer one"
            )
        return cls(
            solids=tuple(part for part in parts if part is not None),
            mesh=mesh,
            faces=found,
            volume_points=frozen_array(points_inside),
            center_of_mass=frozen_array(center),
            vertices=frozen_array(points),
            triangles=read_only(faces),
            warnings=tuple(warnings),
            rolling=rolling,
            assumed=in_words(
                points,
                scale,
                center,
                whose=whose,
                fault=fault,
                pieces=len(pieces),
                parts=len(parts) if mesh is None else len(parts) - len(rest) + len(mesh.parts),
                faces=found,
                left_out=rolling,
                excess=0.0 if mesh is None else mesh.cover.excess,
            ),
            flatness=settings.flatness,
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    """The surface of a connected piece.

    Attributes:
        closed, open: (s, 3, 3), (t, 3, 3) corners of its triangles: those around a solid, outward,
            and those of sheets.
        holes: of the open ones.
        fault: what of the piece is not as expected, in words.
    """

    closed: Array
    open: Array
    holes: Holes
    fault: str

    @classmethod
    def of(cls, piece: MeshPiece, part: ConvexPart | None) -> _Surface:
        """Of a piece, and of its hull where it is convex."""
        none = np.zeros((0, 3, 3))
        if piece.solid:
            return cls(piece.corners, none, NO_HOLES, "")
        inward = "some triangles of the mesh face inward"
        if part is not None:
            cracks = "" if piece.watertight else "the mesh is not closed"
            return cls(part.vertices[part.triangles], none, NO_HOLES, cracks or inward)
        made = Components.of(piece.vertices, piece.triangles)
        solid = made.closed[made.label]
        closed, open_ = made.corners[solid], made.corners[~solid]
        if volume_of(closed) < 0.0:
            closed = closed[:, ::-1]
        if len(open_):
            holes = Holes.of(piece.vertices, piece.triangles[made.rows[~solid]])
            return cls(closed, open_, holes, _OPEN)
        return cls(closed, none, NO_HOLES, "" if volume_of(closed) > 0.0 else inward)

    @property
    def patched(self) -> Array:
        """(t, 3, 3) its triangles and those over its holes, outward."""
        made = np.concatenate([self.open, self.holes.patches])
        return np.concatenate([self.closed, made if volume_of(made) >= 0.0 else made[:, ::-1]])


def _center_of_mass(
    surfaces: Sequence[_Surface], hull: ConvexPart, fault: str
) -> tuple[Array, str]:
    """(3,) that of uniform density, and what it is taken from, in words.

    Args:
        fault: of the surfaces; what is not closed has no inside, but where its holes are small they
            hardly matter.
    """
    of_hull = _center_of(hull.vertices[hull.triangles]), "of its hull"
    if fault and {surface.fault for surface in surfaces} - {"", _OPEN}:
        return of_hull
    whole = np.concatenate([surface.patched for surface in surfaces])
    center = _center_of(whole)
    if len(surfaces) > 1 or not np.isfinite(center).all():
        # pieces may overlap, and so may one with itself: count what they share once
        center = center_of_union(whole, hull)
    if not float(np.max(hull.normals @ center - hull.offsets)) <= 0.0:
        return of_hull  # the surface crosses itself, and what it encloses cancels out
    if not fault:
        return center, "of uniform density"
    holes = together([surface.holes for surface in surfaces])
    off = holes.moves(center, volume_of(whole))
    if off > _SURE * float(np.linalg.norm(np.ptp(hull.vertices, axis=0))):
        return of_hull
    return center, (
        f"of uniform density, with {len(holes.radii)} holes closed: at most {off:.2g} m off where "
        "nothing bulges out of them by more than half their widths"
    )


def _center_of(corners: Array) -> Array:
    """(3,) the centre of what triangles (t, 3, 3) enclose."""
    middle = corners.mean(axis=(0, 1))
    around = corners - middle
    of_each = volumes(around)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(middle + of_each @ around.sum(axis=1) / (4.0 * of_each.sum()))
