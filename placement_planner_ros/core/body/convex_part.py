"""Convex polytopes: what collision checks take the object for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from placement_planner_ros.core.body.mesh import THINNEST, Triangles, read_only
from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.core.types import Array, frozen_array

_SHEET = 0.0005
"""Parts without thickness are thickened by this to every side, metres."""

MAX_FACETS = 6000
"""Facets, triangles of it, that the hull of an object or of one of its pieces may have."""


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


def _polytope(points: Array) -> ConvexPart:
    """The convex hull of (n, 3) points.

    Raises:
        QhullError: they have no volume.
        ObjectError: it has more than `MAX_FACETS`.
    """
    hull = ConvexHull(points)
    if len(hull.simplices) > MAX_FACETS:
        raise ObjectError(
            "object",
            f"a convex hull of {len(hull.simplices)} facets",
            f"it may have {MAX_FACETS}; simplify the mesh where it is round",
        )
    # coplanar triangles come with equal equations, up to rounding
    normals = hull.equations[:, :3]
    used, index = np.unique(hull.simplices, return_inverse=True)
    triangles = index.reshape(-1, 3)
    vertices = hull.points[used]
    corners = vertices[triangles]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", facing, normals) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    _, first = np.unique(np.round(hull.equations, 7), axis=0, return_index=True)
    planes = normals[np.sort(first)]
    offsets = np.max(vertices @ planes.T, axis=0)  # no vertex is cut off by rounding
    return ConvexPart(
        frozen_array(vertices), read_only(triangles), frozen_array(planes), frozen_array(offsets)
    )


def hull_of(vertices: Array) -> ConvexPart:
    """The hull of the whole object.

    Raises:
        ObjectError: it has no volume, or too many facets.
    """
    flat = ObjectError("object", "flat mesh", "has no volume; give it a thickness")
    spread = np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)[2]
    if np.min(np.ptp(vertices @ spread.T, axis=0)) < THINNEST:
        raise flat
    try:
        return _polytope(vertices)
    except QhullError as error:
        raise flat from error


def part_of(piece: trimesh.Trimesh, number: int, warnings: list[str]) -> ConvexPart:
    """A connected piece's hull, with a warning where that is more than the piece."""
    vertices = np.asarray(piece.vertices)
    try:
        part = _polytope(vertices)
    except QhullError:
        warnings.append(f"part {number} has no thickness: taken as {2 * _SHEET * 1e3:g} mm thick")
        corners = _SHEET * np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
        return _polytope((vertices[:, None] + corners).reshape(-1, 3))
    if piece.is_watertight and piece.is_winding_consistent:
        filled = trimesh.Trimesh(part.vertices, part.triangles, process=False).volume
        if filled - piece.volume > 0.01 * filled:
            warnings.append(f"part {number} is not convex: its hull stands for it")
    return part
