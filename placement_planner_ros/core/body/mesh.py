"""The mesh a user gives: checked, and cut into its connected pieces."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from placement_planner_ros.core.body.mesh_components import alike
from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.core.types import Array

Triangles = npt.NDArray[np.int64]

THINNEST = 1e-4
"""Objects thinner than this have no volume to plan with, metres."""

MAX_TRIANGLES, MAX_VERTICES = 300_000, 900_000
"""Triangles, and vertices, that an object may have; each triangle may have vertices of its own."""

FAR = 100.0
"""Metres from a mesh's origin beyond which a vertex is a mistake."""

MAX_PIECES = 500
"""Connected pieces that an object may have."""

_MERGED = 1e-8
"""Metres within which vertices of a surface that is not closed are one."""

_CHECK = "look at its numbers and object.scale"
"""Said of sizes that no object has."""

_WAY = 1 << 32
"""More than an edge has triangles."""


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
    kept, made = used_rows(faces.astype(np.int64), len(points))
    used = points[kept]
    bad = int((~np.isfinite(used).all(axis=1)).sum())
    if bad:
        raise ObjectError(
            "object.vertices", f"{bad} of them NaN or infinite", "give finite numbers"
        )
    with np.errstate(over="ignore"):
        across = float((used.max(axis=0) - used.min(axis=0)).max()) * scale
    if across > max_extent:
        millimetres = scale == 1.0 and 0.001 * across <= max_extent
        remedy = "a mesh in millimetres needs object.scale 0.001" if millimetres else _CHECK
        raise ObjectError(
            "object", f"{across:.4g} m across", f"is larger than {max_extent} m; {remedy}"
        )
    if across < 10.0 * THINNEST:
        least = f"is too small, less than {10.0 * THINNEST:g} m; {_CHECK}"
        raise ObjectError("object", f"{across:.4g} m across", least)
    away = float(np.abs(used).max()) * scale
    if away > FAR:
        raise ObjectError(
            "object.vertices", f"{away:.4g} m from the origin", f"must lie within {FAR:g} m of it"
        )
    return used * scale, made


def require_few(vertices: int, triangles: int) -> None:
    """Refuse meshes too large to plan with.

    Raises:
        ObjectError: more triangles than `MAX_TRIANGLES`, or vertices than `MAX_VERTICES`.
    """
    limits = ("vertices", vertices, MAX_VERTICES), ("triangles", triangles, MAX_TRIANGLES)
    for name, count, most in limits:
        if count > most:
            raise ObjectError(
                f"object.{name}",
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
        raise ObjectError("object.center_of_mass", center_of_mass, "give three numbers") from error
    if center.shape != (3,) or not np.isfinite(center).all():
        raise ObjectError("object.center_of_mass", center.tolist(), "give three finite numbers")
    return center


@dataclass(frozen=True, slots=True, eq=False)
class MeshPiece:
    """A connected piece of a mesh.

    Attributes:
        vertices: (n, 3) metres.
        triangles: (t, 3) rows of vertices.
        watertight: whether every edge has two triangles.
        solid: whether these agree, too, on which side is outside; they face outward then.
    """

    vertices: Array
    triangles: Triangles
    watertight: bool
    solid: bool

    @property
    def corners(self) -> Array:
        """(t, 3, 3) of its triangles."""
        return np.asarray(self.vertices[self.triangles])


def connected_pieces(points: Array, triangles: Triangles) -> list[MeshPiece]:
    """The connected pieces of the mesh, facing outward where closed.

    Pieces that share no vertices are told apart even where they touch. Only what is not closed
    that way (every triangle with vertices of its own, as in STL files) has equal vertices merged;
    what has a front and a back everywhere, with nothing between them, counts once.

    Raises:
        ObjectError: there are more than `MAX_PIECES`.
    """
    groups = _connected(points, triangles)
    pieces = _pieces(points, [group for group in groups if group.watertight])
    left = [group.triangles for group in groups if not group.watertight]
    if left:
        corners = points[np.concatenate(left)]
        first, vertex = alike((corners.reshape(-1, 3) / _MERGED).round())
        faces = vertex.reshape(-1, 3)
        whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
        merged = corners.reshape(-1, 3)[first]
        for group in _connected(merged, faces[whole]):
            once = _once(group)
            same = len(once) == len(group.triangles)
            pieces += _pieces(merged, [group] if same else _connected(merged, once))
    if len(pieces) > MAX_PIECES:
        raise ObjectError(
            "object", f"{len(pieces)} pieces", f"an object may have {MAX_PIECES} connected pieces"
        )
    return pieces


def volumes(corners: Array) -> Array:
    """(t,) m³ of tetrahedra from the origin to triangles (t, 3, 3), negative where they face it."""
    a, b, c = np.ascontiguousarray(corners.transpose(1, 2, 0))
    across = b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]
    return np.asarray((a[0] * across[0] + a[1] * across[1] + a[2] * across[2]) / 6.0)


@dataclass(frozen=True, slots=True)
class _Group:
    """Triangles (t, 3) that are connected, and what `MeshPiece` says of them."""

    triangles: Triangles
    watertight: bool
    agreeing: bool


def _connected(points: Array, triangles: Triangles) -> list[_Group]:
    """The triangles of each piece that shares vertices."""
    if not len(triangles):
        return []
    count = len(points)
    starts, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    # Adds up, for each edge, its triangles, and in higher bits those one way less the other way.
    way = np.sign(ends - starts) * _WAY + 1
    edges = coo_matrix((way, (np.minimum(starts, ends), np.maximum(starts, ends))), (count, count))
    graph = edges.tocsr()
    pieces, label = connected_components(graph, directed=False)
    label = label.astype(np.int64)
    of_edge = np.repeat(label, np.diff(graph.indptr))
    watertight, agreeing = np.ones((2, pieces), np.bool_)
    watertight[of_edge[graph.data % _WAY != 2]] = False
    agreeing[of_edge[graph.data // _WAY != 0]] = False
    of_triangle = label[triangles[:, 0]]
    order = np.argsort(of_triangle, kind="stable")
    first = np.flatnonzero(np.diff(of_triangle[order], prepend=-1))
    return [
        _Group(group, bool(watertight[k]), bool(agreeing[k]))
        for group, k in zip(
            np.split(triangles[order], first[1:]), of_triangle[order][first].tolist(), strict=True
        )
    ]


def _once(group: _Group) -> Triangles:
    """Of a surface that has all its triangles twice, as a front and a back or the same again, the
    first of each; else all of them."""
    if group.watertight:
        return group.triangles
    corners = np.sort(group.triangles, axis=1)
    _, first, count = np.unique(corners, axis=0, return_index=True, return_counts=True)
    return group.triangles[np.sort(first)] if count.min() > 1 else group.triangles


def _pieces(points: Array, groups: list[_Group]) -> list[MeshPiece]:
    pieces = []
    for group in groups[: MAX_PIECES + 1]:  # the one more is what they are refused for
        used, triangles = used_rows(group.triangles, len(points))
        vertices = points[used]
        solid = group.watertight and group.agreeing
        if solid:
            corners = vertices[triangles]
            if volumes(corners - corners.mean(axis=(0, 1))).sum() < 0.0:
                triangles = triangles[:, ::-1]
        pieces.append(MeshPiece(vertices, triangles, group.watertight, solid))
    return pieces


def used_rows(triangles: Triangles, count: int) -> tuple[Triangles, Triangles]:
    """The vertices of triangles (t, 3), of `count`, in their order, and the triangles as rows of
    these."""
    if 3 * len(triangles) < count:  # a small part of many
        used, rows = np.unique(triangles, return_inverse=True)
        return used, rows.reshape(-1, 3)
    wanted = np.zeros(count, np.bool_)
    wanted[triangles] = True
    return np.flatnonzero(wanted), (np.cumsum(wanted) - 1)[triangles]


def read_only(triangles: npt.ArrayLike) -> Triangles:
    array = np.array(triangles, dtype=np.int64)
    array.setflags(write=False)
    return array
