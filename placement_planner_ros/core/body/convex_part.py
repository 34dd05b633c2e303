"""Convex polytopes: what collision checks take the object for, and whether a mesh is one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from placement_planner_ros.core.body.mesh import THINNEST_M, Triangles, read_only
from placement_planner_ros.core.body.mesh_components import equal_rows
from placement_planner_ros.core.body.polytope import HALF_SHEET_M, hull_around
from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.core.types import Array, frozen_array

MAX_FACETS = 6000
"""Facets, triangles of it, that the hull of what counts as convex may have; rounder things are
covered."""

MAX_FACETS_IN_CORNER = 200
"""Facets that may meet in a corner of it: coal takes no more than 254."""

CONVEX_TOLERANCE_M = 1e-3
"""m that the triangles of what counts as convex may lie beneath the facets of its hull; a hundredth
of its size where that is less."""

MAX_COMPARED = 100_000_000
"""Facets of a hull times triangles that are compared: 2 s; what has more counts as not convex."""


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

    @property
    def corners(self) -> Array:
        """(t, 3, 3) of its triangles."""
        return np.asarray(self.vertices[self.triangles])


def polytope_of(points: Array) -> ConvexPart:
    """The convex hull of (n, 3) points.

    Raises:
        QhullError: they have no volume.
    """
    return _part_of(ConvexHull(points))


def _part_of(hull: ConvexHull) -> ConvexPart:
    normals = hull.equations[:, :3]
    # Vertices that the hull has, and its triangles as rows of them.
    used, rows = np.unique(hull.simplices, return_inverse=True)
    vertices, triangles = hull.points[used], rows.reshape(-1, 3)
    corners = vertices[triangles]
    # Triangles are turned to face outward.
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", facing, normals) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    # Coplanar triangles come with equal equations, up to rounding, which cuts off no vertex.
    planes = normals[np.sort(equal_rows(np.round(hull.equations, 7))[0])]
    few = np.array_split(planes, 1 + len(planes) * len(vertices) // 2_000_000)
    offsets = np.concatenate([(each @ vertices.T).max(axis=1) for each in few])
    return ConvexPart(
        frozen_array(vertices), read_only(triangles), frozen_array(planes), frozen_array(offsets)
    )


def hull_of(vertices: Array) -> ConvexPart:
    """The hull of the whole object.

    Raises:
        ObjectError: it has no volume.
    """
    flat = ObjectError("object", "flat mesh", f"give it a thickness of more than {THINNEST_M:g} m")
    around = vertices - vertices.mean(axis=0)
    # Its thickness, along its thinnest axis.
    spread = np.linalg.eigh(around.T @ around)[1].T
    if np.min(np.ptp(around @ spread.T, axis=0)) < THINNEST_M:
        raise flat
    try:
        return polytope_of(vertices)
    except QhullError as error:
        raise flat from error


def convex_part(corners: Array, number: int, warnings: list[str]) -> ConvexPart | None:
    """A connected piece (t, 3, 3) that is its own hull; None where it is not convex.

    A flat piece that fills its outline is given a thickness, with a warning.
    """
    points = corners.reshape(-1, 3)
    # A convex piece is its hull.
    hull = hull_if_convex(corners)
    if hull is not None:
        return _part_of(hull)
    # A flat one that fills its outline is thickened.
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
    if np.ptp(points @ axes[2]) > 1e-9:
        return None
    try:
        outline = ConvexHull((points - points.mean(axis=0)) @ axes[:2].T).volume
    except QhullError:
        outline = 0.0  # a line
    if abs(_area_of(corners) - outline) > 1e-3 * outline:
        return None
    warnings.append(f"part {number} has no thickness: taken as {2e3 * HALF_SHEET_M:g} mm thick")
    return polytope_of(hull_around(points).vertices)


def hull_if_convex(corners: Array) -> ConvexHull | None:
    """The hull of triangles (t, 3, 3), where they cover it and each is along one of its facets."""
    try:
        hull = ConvexHull(corners.reshape(-1, 3))
    except QhullError:  # flat
        return None
    # Its triangles have the area of the hull, which has no more facets than can be used.
    facets = len(hull.simplices)
    if abs(_area_of(corners) - hull.area) > 1e-3 * hull.area or facets > MAX_FACETS:
        return None
    if np.bincount(hull.simplices.ravel()).max() > MAX_FACETS_IN_CORNER:
        return None
    equations = hull.equations.round(9)
    planes = equations[equal_rows(equations)[0]]
    if len(planes) * len(corners) > MAX_COMPARED:
        return None
    # Each triangle lies along one of the planes.
    tolerance = min(CONVEX_TOLERANCE_M, 0.01 * float(np.ptp(hull.points, axis=0).max()))
    for few in np.array_split(corners, 1 + len(corners) * len(planes) // 700_000):
        depth = -(few @ planes[:, :3].T + planes[:, 3])  # (triangles, corners, planes)
        if depth.max(axis=1).min(axis=1).max() > tolerance:
            return None
    return hull


def _area_of(corners: Array) -> float:
    """m² of triangles (t, 3, 3)."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return 0.5 * float(np.linalg.norm(across, axis=1).sum())
