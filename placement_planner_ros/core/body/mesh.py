"""The mesh a user gives: checked, and cut into its connected pieces."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.mesh_components import Components, Triangles, equal_rows
from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.core.types import Array

THINNEST_M = 1e-4
"""m: objects thinner than this have no volume to plan with."""

MAX_TRIANGLES, MAX_VERTICES = 300_000, 900_000
"""Triangles, and vertices, that an object may have; each triangle may have vertices of its own."""

FURTHEST_VERTEX_M = 100.0
"""m from a mesh's origin beyond which a vertex is a mistake."""

MAX_PIECES = 500
"""Connected pieces that an object may have."""

_CHECK = "look at its numbers and `scale`"
"""Said of sizes that no object has."""


def checked_mesh(
    vertices: npt.ArrayLike, triangles: npt.ArrayLike, scale: float, max_extent: float
) -> tuple[Array, Triangles]:
    """The mesh (m, 3) in metres and (t, 3), without the vertices that no triangle has.

    Raises:
        ObjectError: empty, too many triangles, not finite, bad indices, implausibly large or
            small, or further than `FURTHEST_VERTEX_M` from its origin.
    """
    if not (math.isfinite(scale) and scale > 0.0):
        raise ObjectError("`scale`", scale, "give a finite number above 0")
    try:
        points = np.array(vertices, dtype=np.float64)
        faces = np.array(triangles)
    except (TypeError, ValueError) as error:
        raise ObjectError("object", "mesh", "give numbers of shape (m, 3) and (t, 3)") from error
    # Shapes and indices.
    if points.size == 0 or faces.size == 0:
        raise ObjectError("object", f"{points.size // 3} vertices", "the mesh is empty")
    if points.ndim != 2 or points.shape[1] != 3:
        raise ObjectError("`vertices`", points.shape, "give shape (m, 3)")
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise ObjectError("`triangles`", faces.shape, "give shape (t, 3)")
    if not np.issubdtype(faces.dtype, np.integer):
        raise ObjectError("`triangles`", faces.dtype, "give integers")
    if faces.min() < 0 or faces.max() >= len(points):
        bad = int(faces.min()) if faces.min() < 0 else int(faces.max())
        raise ObjectError("`triangles`", bad, f"is no index of one of {len(points)} vertices")
    require_few(len(points), len(faces))
    # Of vertices that triangles have: finite numbers, and a size that objects have.
    kept, made = np.unique(faces.astype(np.int64), return_inverse=True)
    used = points[kept]
    bad = int((~np.isfinite(used).all(axis=1)).sum())
    if bad:
        raise ObjectError("`vertices`", f"{bad} of them NaN or infinite", "give finite numbers")
    with np.errstate(over="ignore"):
        across = float((used.max(axis=0) - used.min(axis=0)).max()) * scale
    if across > max_extent:
        millimetres = scale == 1.0 and 0.001 * across <= max_extent
        remedy = "a mesh in millimetres needs `scale` 0.001" if millimetres else _CHECK
        raise ObjectError(
            "object", f"{across:.4g} m across", f"is larger than {max_extent} m; {remedy}"
        )
    if across < 10.0 * THINNEST_M:
        least = f"is too small, less than {10.0 * THINNEST_M:g} m; {_CHECK}"
        raise ObjectError("object", f"{across:.4g} m across", least)
    away = float(np.abs(used).max()) * scale
    if away > FURTHEST_VERTEX_M:
        raise ObjectError(
            "`vertices`",
            f"{away:.4g} m from the origin",
            f"must lie within {FURTHEST_VERTEX_M:g} m of it",
        )
    return used * scale, made.reshape(-1, 3)


def require_few(vertices: int, triangles: int) -> None:
    """Refuse meshes too large to plan with.

    Raises:
        ObjectError: more triangles than `MAX_TRIANGLES`, or vertices than `MAX_VERTICES`.
    """
    limits = ("vertices", vertices, MAX_VERTICES), ("triangles", triangles, MAX_TRIANGLES)
    for name, count, most in limits:
        if count > most:
            raise ObjectError(
                f"`{name}`",
                f"{count} of them",
                f"an object may have {most}; simplify its mesh",
            )


def checked_center(center_of_mass: npt.ArrayLike, scale: float) -> Array:
    """The centre of mass (3,) in metres.

    Raises:
        ObjectError: not three finite numbers.
    """
    try:
        center = np.array(center_of_mass, dtype=np.float64) * scale
    except (TypeError, ValueError) as error:
        raise ObjectError("`center_of_mass`", center_of_mass, "give three numbers") from error
    if center.shape != (3,) or not np.isfinite(center).all():
        raise ObjectError("`center_of_mass`", center.tolist(), "give three finite numbers")
    return center


@dataclass(frozen=True, slots=True, eq=False)
class MeshPiece:
    """A connected piece of a mesh.

    Attributes:
        corners: (t, 3, 3) metres, of its triangles; outward where it is closed.
        closed: whether all its edges have as many triangles one way as the other.
    """

    corners: Array
    closed: bool


def connected_pieces(points: Array, triangles: Triangles) -> list[MeshPiece]:
    """The connected pieces of the mesh, facing outward where closed.

    Pieces that share no vertices are told apart even where they touch. Only what is not closed
    that way (every triangle with vertices of its own, as in STL files) has equal vertices merged;
    what has a front and a back everywhere, with nothing between them, counts once.

    Raises:
        ObjectError: there are more than `MAX_PIECES`.
    """
    # Fronts and backs of the same triangles count once.
    first, kind = equal_rows(np.sort(triangles, axis=1))
    twice = np.bincount(kind).min() > 1
    apart = Components.of(points, triangles[np.sort(first)] if twice else triangles, weld=False)
    # What is not closed as it is may be so with equal vertices merged.
    left = apart.corners[~apart.closed[apart.label]]
    pieces = [piece for piece in _pieces_of(apart) if piece.closed]
    if len(left):
        pieces += _pieces_of(
            Components.of(left.reshape(-1, 3), np.arange(left.size // 3).reshape(-1, 3))
        )
    if len(pieces) > MAX_PIECES:
        raise ObjectError(
            "object", f"{len(pieces)} pieces", f"an object may have {MAX_PIECES} connected pieces"
        )
    return pieces


def volumes_under(corners: Array) -> Array:
    """(t,) m³ of tetrahedra from the origin to triangles (t, 3, 3), negative where they face it."""
    a, b, c = np.ascontiguousarray(corners.transpose(1, 2, 0))
    across = b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]
    return np.asarray((a[0] * across[0] + a[1] * across[1] + a[2] * across[2]) / 6.0)


def _pieces_of(components: Components) -> list[MeshPiece]:
    # Triangles of one component after the other, closed ones outward.
    order = np.argsort(components.label, kind="stable")
    first = np.flatnonzero(np.diff(components.label[order]) != 0) + 1
    pieces = []
    for corners, closed in zip(
        np.split(components.corners[order], first), components.closed, strict=True
    ):
        inward = closed and volumes_under(corners - corners.mean(axis=(0, 1))).sum() < 0.0
        pieces.append(MeshPiece(corners[:, ::-1] if inward else corners, bool(closed)))
    return pieces


def read_only(triangles: npt.ArrayLike) -> Triangles:
    array = np.array(triangles, dtype=np.int64)
    array.setflags(write=False)
    return array
