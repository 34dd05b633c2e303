"""Convex polytopes: what collision checks take the object for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from placement_planner_ros.core.body.mesh import (
    THINNEST,
    MeshPiece,
    Triangles,
    read_only,
    used_rows,
)
from placement_planner_ros.core.body.mesh_components import alike
from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.core.types import Array, frozen_array

_SHEET = 0.0005
"""Parts without thickness are thickened by this to every side, metres."""

MAX_FACETS = 6000
"""Facets, triangles of it, that the hull of a piece may have that counts as convex; rounder ones
are covered."""

CONVEX_TOLERANCE, CONVEX_SHARE = 1e-3, 0.01
"""Metres, and share of its size, that a piece's triangles may lie beneath the facets of its hull
where it counts as convex."""

_CONVEX_AREA = 1e-3
"""Share by which the area of such a piece may differ from that of its hull."""

MOST_AROUND = 200
"""Facets that meet in a corner of what counts as convex: coal takes no more than 254."""

_MOST_COMPARED = 100_000_000
"""Facets of a hull times triangles of its piece that are compared; a piece with more counts as not
convex."""

_MOST_MOVED = 2_000_000
"""Vertices of a hull times its planes that are compared, for none to be cut off by rounding."""

_ROUNDING = 1e-9
"""Metres by which planes are moved out where there are more."""

_AT_ONCE = 2_000_000
"""Points times planes that are compared at once."""


@dataclass(frozen=True, slots=True, eq=False)
class ConvexPart:
    """A convex polytope in the object frame.

    Attributes:
        vertices: (m, 3), metres.
        triangles: (t, 3) int, counter-clockwise from outside.
        normals, offsets: (p, 3), (p,), the points with normals @ x <= offsets; coplanar triangles
            share one.
    """

    vertices: Array
    triangles: Triangles
    normals: Array
    offsets: Array


def polytope_of(points: Array) -> ConvexPart:
    """The convex hull of (n, 3) points.

    Raises:
        QhullError: they have no volume.
    """
    return _polytope(ConvexHull(points))


def hull_triangles(points: Array) -> Array:
    """(t, 3, 3) the hull of points (n, 3), wound counter-clockwise from outside.

    Raises:
        QhullError: they have no volume.
    """
    hull = polytope_of(points)
    return np.asarray(hull.vertices[hull.triangles])


def _polytope(hull: ConvexHull) -> ConvexPart:
    # coplanar triangles come with equal equations, up to rounding
    normals = hull.equations[:, :3]
    used, triangles = used_rows(hull.simplices.astype(np.int64), len(hull.points))
    vertices = hull.points[used]
    corners = vertices[triangles]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", facing, normals) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    first, _ = alike(np.round(hull.equations, 7))
    planes = normals[np.sort(first)]
    offsets = -hull.equations[np.sort(first), 3] + _ROUNDING
    if len(vertices) * len(planes) <= _MOST_MOVED:  # no vertex is cut off by rounding
        chunk = max(1, _AT_ONCE // len(vertices))
        rows = range(0, len(planes), chunk)
        offsets = np.concatenate([(planes[r : r + chunk] @ vertices.T).max(axis=1) for r in rows])
    return ConvexPart(
        frozen_array(vertices), read_only(triangles), frozen_array(planes), frozen_array(offsets)
    )


def hull_of(vertices: Array) -> ConvexPart:
    """The hull of the whole object.

    Raises:
        ObjectError: it has no volume.
    """
    flat = ObjectError("object", "flat mesh", f"give it a thickness of more than {THINNEST:g} m")
    around = vertices - vertices.mean(axis=0)
    spread = np.linalg.eigh(around.T @ around)[1].T
    if np.min(np.ptp(around @ spread.T, axis=0)) < THINNEST:
        raise flat
    try:
        return _polytope(ConvexHull(vertices))
    except QhullError as error:
        raise flat from error


def convex_part(piece: MeshPiece, number: int, warnings: list[str]) -> ConvexPart | None:
    """A connected piece that is its own hull; None where it is not convex.

    A flat piece that fills its outline is given a thickness, with a warning.
    """
    vertices, corners = piece.vertices, piece.corners
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * float(np.linalg.norm(across, axis=1).sum())
    try:
        hull = ConvexHull(vertices)
    except QhullError:
        if not _fills_outline(vertices, area):
            return None
        warnings.append(f"part {number} has no thickness: taken as {2 * _SHEET * 1e3:g} mm thick")
        around = _SHEET * np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
        return polytope_of((vertices[:, None] + around).reshape(-1, 3))
    if abs(area - hull.area) > _CONVEX_AREA * hull.area or len(hull.simplices) > MAX_FACETS:
        return None
    if np.bincount(hull.simplices.ravel()).max() > MOST_AROUND:
        return None
    return _polytope(hull) if _is_on_hull(corners, across, hull) else None


def _is_on_hull(corners: Array, across: Array, hull: ConvexHull) -> bool:
    """Whether every triangle of corners (t, 3, 3) and normals (t, 3) lies along a facet."""
    equations = hull.equations.round(9)
    planes = equations[alike(equations)[0]]
    size = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    tolerance = min(CONVEX_TOLERANCE, CONVEX_SHARE * size)
    # Nearly always along one that faces as it does, if it is along any.
    length = np.linalg.norm(across, axis=1)
    facing = across / np.where(length > 0.0, length, 1.0)[:, None]
    normals = cKDTree(planes[:, :3])
    for way in (1.0, -1.0):
        _, nearest = normals.query(way * facing)
        plane = planes[nearest]
        depth = -(np.einsum("tik,tk->ti", corners, plane[:, :3]) + plane[:, 3:])
        left = depth.max(axis=1) > tolerance
        corners, facing = corners[left], facing[left]
        if not len(corners):
            return True
    if len(planes) * len(corners) > _MOST_COMPARED:
        return False
    chunk = max(1, _AT_ONCE // (3 * len(planes)))
    for row in range(0, len(corners), chunk):
        depth = -(corners[row : row + chunk] @ planes[:, :3].T + planes[:, 3])
        if depth.max(axis=1).min(axis=1).max() > tolerance:
            return False
    return True


def _fills_outline(vertices: Array, area: float) -> bool:
    """Whether a flat piece of (m, 3) vertices is as large as the convex outline of it."""
    axes = np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)[2]
    try:
        outline = ConvexHull((vertices - vertices.mean(axis=0)) @ axes[:2].T)
    except QhullError:
        return True  # a line
    return bool(abs(area - outline.volume) <= _CONVEX_AREA * outline.volume)
