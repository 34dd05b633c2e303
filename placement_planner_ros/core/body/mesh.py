"""The mesh a user gives: checked, and cut into its connected pieces."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.core.types import Array

Triangles = npt.NDArray[np.int64]

THINNEST = 1e-4
"""Objects thinner than this have no volume to plan with, metres."""

MAX_TRIANGLES = 300_000
"""Triangles, and vertices, that an object may have."""

FAR = 100.0
"""Metres from a mesh's origin beyond which a vertex is a mistake."""

MAX_PIECES = 500
"""Connected pieces that an object may have."""


def checked_mesh(
    vertices: npt.ArrayLike, triangles: npt.ArrayLike, scale: float, max_extent: float
) -> tuple[Array, Triangles]:
    """The mesh (m, 3) in metres and (t, 3), without the vertices that no triangle has.

    Raises:
        ObjectError: empty, too many triangles, not finite, bad indices, implausibly large or
            small, or further than `FAR` from its origin.
    """
    if not (math.isfinite(scale) and scale > 0.0):
        raise ObjectError("object.scale", scale, "give a finite number above 0")
    try:
        points = np.array(vertices, dtype=np.float64)
        faces = np.array(triangles)
    except (TypeError, ValueError) as error:
        raise ObjectError("object", "mesh", "give numbers of shape (m, 3) and (t, 3)") from error
    if points.size == 0 or faces.size == 0:
        raise ObjectError("object", f"{points.size // 3} vertices", "the mesh is empty")
    if points.ndim != 2 or points.shape[1] != 3:
        raise ObjectError("object.vertices", points.shape, "give shape (m, 3)")
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise ObjectError("object.triangles", faces.shape, "give shape (t, 3)")
    if not np.issubdtype(faces.dtype, np.integer):
        raise ObjectError("object.triangles", faces.dtype, "give integers")
    if faces.min() < 0 or faces.max() >= len(points):
        bad = int(faces.min()) if faces.min() < 0 else int(faces.max())
        raise ObjectError("object.triangles", bad, f"is no index of one of {len(points)} vertices")
    require_few(len(points), len(faces))
    kept, inverse = np.unique(faces, return_inverse=True)
    used = points[kept]
    bad = int((~np.isfinite(used).all(axis=1)).sum())
    if bad:
        raise ObjectError(
            "object.vertices", f"{bad} of them NaN or infinite", "give finite numbers"
        )
    extents = (used.max(axis=0) - used.min(axis=0)) * scale
    if extents.max() > max_extent:
        raise ObjectError(
            "object",
            f"{extents.max():.4g} m across",
            f"is larger than {max_extent} m; a mesh in millimetres needs object.scale 0.001",
        )
    if extents.max() < 10.0 * THINNEST:
        raise ObjectError(
            "object", f"{extents.max():.4g} m across", "is too small; check object.scale"
        )
    away = float(np.abs(used).max()) * scale
    if away > FAR:
        raise ObjectError(
            "object.vertices", f"{away:.4g} m from the origin", f"must lie within {FAR:g} m of it"
        )
    return used * scale, inverse.reshape(faces.shape).astype(np.int64)


def require_few(vertices: int, triangles: int) -> None:
    """Refuse meshes too large to plan with.

    Raises:
        ObjectError: more vertices or triangles than `MAX_TRIANGLES`.
    """
    for name, count in (("vertices", vertices), ("triangles", triangles)):
        if count > MAX_TRIANGLES:
            raise ObjectError(
                f"object.{name}",
                f"{count} of them",
                f"an object may have {MAX_TRIANGLES}; simplify its mesh",
            )


def checked_center(center_of_mass: npt.ArrayLike, scale: float) -> Array:
    """The centre of mass (3,) in metres.

    Raises:
        ObjectError: not three finite numbers.
    """
    try:
        center = np.array(center_of_mass, dtype=np.float64) * scale
    except (TypeError, ValueError) as error:
        raise ObjectError("object.center_of_mass", center_of_mass, "give three numbers") from error
    if center.shape != (3,) or not np.isfinite(center).all():
        raise ObjectError("object.center_of_mass", center.tolist(), "give three finite numbers")
    return center


def connected_pieces(points: Array, triangles: Triangles) -> list[trimesh.Trimesh]:
    """The connected pieces of the mesh, facing outward where closed.

    Pieces that share no vertices are told apart even where they touch. Only what is not closed
    that way (every triangle with vertices of its own, as in STL files) has equal vertices merged.

    Raises:
        ObjectError: there are more than `MAX_PIECES`.
    """
    groups, closed = _connected(points, triangles)
    pieces = _pieces(points, [g for g, whole in zip(groups, closed, strict=True) if whole])
    left = [g for g, whole in zip(groups, closed, strict=True) if not whole]
    if left:
        corners = points[np.concatenate(left)].reshape(-1, 3)
        merged = trimesh.Trimesh(
            corners, np.arange(len(corners)).reshape(-1, 3), process=False, validate=False
        )
        merged.merge_vertices()
        merged.update_faces(merged.nondegenerate_faces())
        vertices = np.asarray(merged.vertices)
        pieces += _pieces(vertices, _connected(vertices, np.asarray(merged.faces))[0])
    if len(pieces) > MAX_PIECES:
        raise ObjectError(
            "object", f"{len(pieces)} pieces", f"an object may have {MAX_PIECES} connected pieces"
        )
    for piece in pieces:
        if piece.is_watertight and piece.is_winding_consistent:
            corners = np.asarray(piece.triangles)
            if volumes(corners - corners.mean(axis=(0, 1))).sum() < 0.0:
                piece.invert()
    return pieces


def volumes(corners: Array) -> Array:
    """(t,) m³ of tetrahedra from the origin to triangles (t, 3, 3), negative where they face it."""
    a, b, c = np.ascontiguousarray(corners.transpose(1, 2, 0))
    across = b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]
    return np.asarray((a[0] * across[0] + a[1] * across[1] + a[2] * across[2]) / 6.0)


def _connected(points: Array, triangles: Triangles) -> tuple[list[Triangles], list[bool]]:
    """The triangles of each piece that shares vertices, and whether that piece is closed."""
    graph = coo_matrix(
        (
            np.ones(2 * len(triangles), dtype=np.int8),
            (triangles[:, [0, 0]].ravel(), triangles[:, [1, 2]].ravel()),
        ),
        shape=(len(points), len(points)),
    )
    label = connected_components(graph, directed=False)[1][triangles[:, 0]]
    order = np.argsort(label, kind="stable")
    first = np.flatnonzero(np.diff(label[order], prepend=-1))
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    keys = edges[:, 0] * len(points) + edges[:, 1]
    _, edge, sharing = np.unique(keys, return_inverse=True, return_counts=True)
    whole = (sharing[edge].reshape(-1, 3) == 2).all(axis=1)
    closed = np.logical_and.reduceat(whole[order], first) if len(first) else whole
    return np.split(triangles[order], first[1:]), closed.tolist()


def _pieces(points: Array, groups: list[Triangles]) -> list[trimesh.Trimesh]:
    pieces = []
    for triangles in groups[: MAX_PIECES + 1]:  # the one more is what they are refused for
        used, index = np.unique(triangles, return_inverse=True)
        pieces.append(trimesh.Trimesh(points[used], index.reshape(-1, 3), process=False))
    return pieces


def read_only(triangles: npt.ArrayLike) -> Triangles:
    array = np.array(triangles, dtype=np.int64)
    array.setflags(write=False)
    return array
