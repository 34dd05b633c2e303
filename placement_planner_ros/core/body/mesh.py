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


def checked_mesh(
    vertices: npt.ArrayLike, triangles: npt.ArrayLike, scale: float, max_extent: float
) -> tuple[Array, Triangles]:
    """The mesh (m, 3) in metres and (t, 3).

    Raises:
        ObjectError: empty, not finite, bad indices, or implausibly large or small.
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
    used = points[np.unique(faces)]
    if not np.isfinite(used).all():
        raise ObjectError("object.vertices", "NaN or infinite", "give finite numbers")
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
    return points * scale, faces.astype(np.int64)


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
    """
    found = _connected(points, triangles)
    closed = [piece for piece in found if piece.is_watertight]
    left = [piece for piece in found if not piece.is_watertight]
    if left:
        corners = np.concatenate([piece.triangles.reshape(-1, 3) for piece in left])
        merged = trimesh.Trimesh(
            corners, np.arange(len(corners)).reshape(-1, 3), process=False, validate=False
        )
        merged.merge_vertices()
        merged.update_faces(merged.nondegenerate_faces())
        closed += _connected(np.asarray(merged.vertices), np.asarray(merged.faces))
    for piece in closed:
        if piece.is_watertight and piece.volume < 0.0:
            piece.invert()
    return closed


def _connected(points: Array, triangles: Triangles) -> list[trimesh.Trimesh]:
    """The pieces of the mesh whose triangles share vertices."""
    graph = coo_matrix(
        (
            np.ones(2 * len(triangles), dtype=np.int8),
            (triangles[:, [0, 0]].ravel(), triangles[:, [1, 2]].ravel()),
        ),
        shape=(len(points), len(points)),
    )
    label = connected_components(graph, directed=False)[1][triangles[:, 0]]
    pieces = []
    for number in np.unique(label):
        piece = trimesh.Trimesh(points, triangles[label == number], process=False)
        piece.remove_unreferenced_vertices()
        pieces.append(piece)
    return pieces


def read_only(triangles: npt.ArrayLike) -> Triangles:
    array = np.array(triangles, dtype=np.int64)
    array.setflags(write=False)
    return array
