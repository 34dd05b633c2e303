"""Convex polytopes: what collision checks take the object and its links for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from placement_planner_ros.core.body.mesh_components import Triangles, equal_rows
from placement_planner_ros.core.types import SINGLE_ROUNDING, Array, frozen_array, frozen_integers

SHEET_M = 1e-3
"""m that sheets are taken to be thick; dents less deep do not count."""

MAX_PARTS = 32
"""Parts that the cover of a mesh may have."""

MAX_VERTICES = 128
"""Vertices that a part may have, and facets in a corner of it: coal takes no more than 254."""


@dataclass(frozen=True, slots=True, eq=False)
class ConvexPart:
    """A convex polytope.

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
    hull = ConvexHull(points)
    # Vertices that the hull has, and its triangles as rows of them, turned to face outward.
    used, rows = np.unique(hull.simplices, return_inverse=True)
    vertices, triangles = points[used], rows.reshape(-1, 3)
    inward = (_area_vectors(vertices[triangles]) * hull.equations[:, :3]).sum(axis=1) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    # Coplanar triangles come with equal equations, up to rounding.
    planes = hull.equations[np.sort(equal_rows(hull.equations.round(7))[0])]
    return ConvexPart(
        frozen_array(vertices),
        frozen_integers(triangles),
        frozen_array(planes[:, :3]),
        frozen_array(-planes[:, 3]),
    )


def hull_if_convex(corners: Array) -> ConvexPart | None:
    """The hull of triangles (t, 3, 3), where they cover it and each is along one of its facets; it
    has no more vertices than a cover may have."""
    try:
        part = polytope_of(corners.reshape(-1, 3))
    except QhullError:  # flat
        return None
    if len(part.vertices) > MAX_PARTS * MAX_VERTICES:
        return None
    if np.bincount(part.triangles.ravel()).max() > MAX_VERTICES:
        return None
    # They have the same area.
    area, all_ = (np.linalg.norm(_area_vectors(c), axis=1).sum() for c in (corners, part.corners))
    if abs(area - all_) > 1e-3 * all_:
        return None
    # Each triangle lies along one of the planes.
    for few in np.array_split(corners, min(len(corners), len(part.normals))):
        depth = part.offsets - few @ part.normals.T  # (triangles, corners, planes)
        if depth.max(axis=1).min(axis=1).max() > SHEET_M:
            return None
    return part


def _area_vectors(corners: Array) -> Array:
    """(t, 3) normals of triangles (t, 3, 3), twice as long as their areas."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def hull_around(points: Array) -> ConvexPart:
    """The hull of points (n, 3), thickened where it is thinner than a sheet."""
    # Along axes that it is thin in, copies to both sides.
    middle = points.mean(axis=0)
    axes = np.linalg.eigh((points - middle).T @ (points - middle))[1].T
    along = points @ axes.T
    for axis in 0.5 * SHEET_M * axes[np.ptp(along, axis=0) < SHEET_M]:
        points = np.concatenate([points - axis, points + axis])
    return polytope_of(points)


def simpler_hull(part: ConvexPart, slack: float) -> ConvexPart:
    """One around it with fewer vertices, and no more than `MAX_VERTICES`.

    From a box on, planes of its facets are added where most is beyond one of them.

    Args:
        slack: metres that its vertices may be outside any plane of the given one; more where there
            would be too many.
    """
    middle = part.vertices.mean(axis=0)
    vertices, offsets = part.vertices - middle, part.offsets - part.normals @ middle
    normals, furthest, made = np.concatenate([np.eye(3), -np.eye(3)]), np.inf, vertices
    while furthest > max(slack, 2.0 * SINGLE_ROUNDING):
        # The corners that the planes so far leave: planes of the dual's hull.
        reach = (normals @ vertices.T).max(axis=1)
        dual = ConvexHull(normals / reach[:, None]).equations
        corners = dual[:, :3] / -dual[:, 3:]
        corners = corners[equal_rows(corners.round(7))[0]]
        if len(corners) > min(MAX_VERTICES, len(vertices)):
            if len(vertices) <= MAX_VERTICES:
                return part
            break
        # Planes that corners are furthest beyond, of those corners that are furthest out.
        made, beyond = corners, corners @ part.normals.T - offsets
        furthest = beyond.max()
        chosen = np.unique(beyond[beyond.max(axis=1) >= 0.5 * furthest].argmax(axis=1))
        normals = np.concatenate([normals, part.normals[chosen]])
    return hull_around(made + middle)


def grown_hull(part: ConvexPart) -> ConvexPart:
    """The same in larger, its planes moved outward by more than rounding."""
    middle = part.vertices.mean(axis=0)
    depth = float((part.offsets - part.normals @ middle).min())
    return polytope_of(middle + (part.vertices - middle) * (1.0 + 2.0 * SINGLE_ROUNDING / depth))
