"""The grasped object in its own frame: convex parts, placement faces F, volume points B_o."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.convex_cover import coarse_cover_in_words, cover_tolerance
from placement_planner_ros.core.body.convex_part import ConvexPart, convex_part, hull_of
from placement_planner_ros.core.body.covered_mesh import CoveredMesh, CoverMaker, make_cover
from placement_planner_ros.core.body.holes import Holes
from placement_planner_ros.core.body.mesh import (
    Triangles,
    checked_center,
    checked_mesh,
    connected_pieces,
    read_only,
    volumes_under,
)
from placement_planner_ros.core.body.placement_face import (
    PlacementFace,
    offered_faces,
    placement_faces,
)
from placement_planner_ros.core.body.settings import BodySettings
from placement_planner_ros.core.body.volume_points import center_of_union, volume_points
from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.core.types import Array, frozen_array

CENTER_SHARE = 0.02
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
        # The mesh in metres, its hull and its connected pieces.
        points, faces = checked_mesh(vertices, triangles, scale, settings.max_extent)
        hull = hull_of(points)
        warnings: list[str] = []
        pieces = connected_pieces(points, faces)
        parts = [convex_part(piece.corners, n, warnings) for n, piece in enumerate(pieces)]
        # Pieces that bound a solid, and sheets, which have no inside.
        solids, sheets, fault = [np.zeros((0, 3, 3))], [np.zeros((0, 3, 3))], ""
        for piece, part in zip(pieces, parts, strict=True):
            if not piece.closed:
                fault = fault or "the mesh is not closed"
            if not piece.closed and part is None:
                fault = "the mesh is not closed: it counts as a sheet without an inside"
                sheets.append(piece.corners)
            else:
                solids.append(piece.corners if part is None or piece.closed else part.corners)
        # B_o, and where the mass is.
        closed, open_ = np.concatenate(solids), np.concatenate(sheets)
        points_inside = volume_points(closed, open_, hull, settings, warnings)
        if center_of_mass is not None:
            center, whose = checked_center(center_of_mass, scale), "as given"
        else:
            center, whose = _center_of_mass(closed, open_, len(pieces), hull)
        if fault:
            warnings.append(f"{fault}; centre of mass {whose}")
        # A body of any density has its centre of mass within its hull.
        outside = float(np.max(hull.normals @ center - hull.offsets))
        if outside > 1e-6:
            raise ObjectError(
                "`center_of_mass`",
                center.tolist(),
                f"lies {outside:.4g} m outside the object's hull; give it in the object's frame",
            )
        # F, and a cover of all pieces that are not convex.
        found, rolling = offered_faces(
            placement_faces(points, center, settings), settings, warnings
        )
        rest = [piece for piece, part in zip(pieces, parts, strict=True) if part is None]
        mesh = CoveredMesh.of(rest, cover) if rest else None
        if mesh is not None:
            coarse = coarse_cover_in_words(mesh.cover, cover_tolerance(mesh.vertices))
            warnings.extend([coarse] if coarse else [])
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
            assumed=(
                _size_in_words(points, scale),
                f"centre of mass ({', '.join(f'{x:.4f}' for x in np.round(center, 4) + 0.0)}) "
                f"{whose}",
                f"{fault or 'closed'}, {_cover_in_words(parts, mesh)}",
                _rests_in_words(found, rolling),
            ),
            flatness=settings.flatness,
        )


def _center_of_mass(
    closed: Array, open_: Array, pieces: int, hull: ConvexPart
) -> tuple[Array, str]:
    """(3,) that of uniform density, and what it is taken from, in words.

    What is not closed has no inside, but where its holes are small they hardly matter.

    Args:
        closed, open_: (s, 3, 3), (t, 3, 3) triangles around solids, outward, and of sheets.
    """
    # The triangles of sheets, patched and wound outward, belong to the rest.
    holes = Holes.of(open_) if len(open_) else None
    patched = np.concatenate([open_, holes.patches]) if holes else open_
    if _volume_in(patched) < 0.0:
        patched = patched[:, ::-1]
    whole = np.concatenate([closed, patched])
    # Pieces may overlap, and so may one with itself: what they share counts once.
    center = center_of_union(whole, hull) if pieces > 1 else _center_in(whole)
    # Also where it is NaN: what crosses itself may enclose nothing.
    if not float(np.max(hull.normals @ center - hull.offsets)) <= 0.0:
        center = center_of_union(whole, hull)
    if not float(np.max(hull.normals @ center - hull.offsets)) <= 0.0:
        return _center_in(hull.corners), "of its hull"  # it crosses itself, and cancels out
    if holes is None:
        return center, "of uniform density"
    # Where what the holes hide may move it far, the hull is as good a guess.
    off = holes.moves(center, _volume_in(whole))
    if off > CENTER_SHARE * float(np.linalg.norm(np.ptp(hull.vertices, axis=0))):
        return _center_in(hull.corners), "of its hull"
    return center, (
        f"of uniform density, with {len(holes.radii)} holes closed: at most {off:.2g} m off where "
        "nothing bulges out of them by more than half their widths"
    )


def _volume_in(corners: Array) -> float:
    """m³ that triangles (t, 3, 3) enclose."""
    return float(volumes_under(corners - corners.mean(axis=(0, 1))).sum()) if len(corners) else 0.0


def _center_in(corners: Array) -> Array:
    """(3,) the centre of what triangles (t, 3, 3) enclose; not finite where that is nothing."""
    middle = corners.mean(axis=(0, 1))
    around = corners - middle
    # Tetrahedra from the middle to each triangle, by their volumes.
    of_each = volumes_under(around)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(middle + of_each @ around.sum(axis=1) / (4.0 * of_each.sum()))


def _size_in_words(points: Array, scale: float) -> str:
    size = " x ".join(f"{side:.4g}" for side in np.ptp(points, axis=0))
    unit = "its numbers taken as metres" if scale == 1.0 else f"`scale` {scale:g}"
    return f"{size} m, {unit}"


def _cover_in_words(parts: list[ConvexPart | None], mesh: CoveredMesh | None) -> str:
    count = sum(part is not None for part in parts) + (0 if mesh is None else len(mesh.parts))
    words = f"{_in_number(len(parts), 'piece')} in {_in_number(count, 'convex part')}"
    if mesh is not None:
        reach = "reaches" if count == 1 else "reach"
        words += f" that {reach} up to {mesh.cover.excess:.2g} m beyond it"
    return words


def _rests_in_words(faces: tuple[PlacementFace, ...], left_out: int) -> str:
    rolling = sum(face.rolls for face in faces)
    words = _in_number(len(faces), "rest")
    if rolling:
        words += f", from {rolling} of which it could roll"
    if left_out:
        words += f", and {left_out} from which it could roll left out (`allow_rolling`)"
    return words


def _in_number(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
