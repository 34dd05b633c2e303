"""Convex hulls that hold what they are made of in spite of rounding, and simpler ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from placement_planner_ros.core.types import Array

HALF_SHEET_M = 5e-4
"""m: hulls of flat things are at least this thick to both sides of their middle."""

HULL_SLACK_M = 2e-6
"""m by which parts reach beyond the hulls that they hold: more than rounding moves these."""

PLANES_AT_ONCE = 8
"""Planes by which a simpler hull is cut at once."""

PLANES_BETWEEN = 256
"""Directions, evenly, of planes beside those of the facets: 13° apart."""


@dataclass(frozen=True, slots=True, eq=False)
class Polytope:
    """A convex polytope.

    Attributes:
        vertices: (m, 3) metres.
        planes: (p, 4) normal n, outward, and d, with n · x + d <= 0 inside.
    """

    vertices: Array
    planes: Array


def hull_around(points: Array) -> Polytope:
    """The hull of points (n, 3), thickened where it is thin.

    Raises:
        QhullError: rounding leaves none.
    """
    # Along axes that it is thin in, copies to both sides.
    middle = points.mean(axis=0)
    axes = np.linalg.eigh((points - middle).T @ (points - middle))[1].T
    along = points @ axes.T
    for axis in axes[np.ptp(along, axis=0) < 2.0 * HALF_SHEET_M]:
        points = np.concatenate([points - HALF_SHEET_M * axis, points + HALF_SHEET_M * axis])
    hull = ConvexHull(points)
    return Polytope(points[hull.vertices], np.unique(hull.equations.round(9), axis=0))


def even_directions(count: int) -> Array:
    """(count, 3) unit vectors, evenly over half a sphere."""
    z = (np.arange(count) + 0.5) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    flat = np.sqrt(1.0 - z**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


def simpler_hull(polytope: Polytope, slack: float, most: int) -> Polytope:
    """One around it with fewer vertices, where there is.

    From a box on, planes along its facets, and in directions between them, are added where most is
    beyond one of them.

    Args:
        slack: metres that its vertices may be outside any plane of the given one; more where there
            would be too many.
        most: vertices that it may have.
    """
    # Directions of planes that may be added, and where these touch.
    middle = polytope.vertices.mean(axis=0)
    vertices = polytope.vertices - middle
    between = even_directions(PLANES_BETWEEN // 2)
    candidates = np.concatenate([polytope.planes[:, :3], between, -between])
    offsets = (candidates @ vertices.T).max(axis=1)
    normals, best = np.concatenate([np.eye(3), -np.eye(3)]), None
    while True:
        # The corners that the planes so far leave.
        reach = (normals @ vertices.T).max(axis=1)
        # Planes of the dual's hull are corners of what all planes leave.
        dual = ConvexHull(normals / reach[:, None]).equations
        made = dual[:, :3] / -dual[:, 3:]
        made = made[np.unique(made.round(7), axis=0, return_index=True)[1]]
        if len(made) > (most if len(vertices) > most else len(vertices)):
            break
        best = made
        # The planes that most of them are beyond, where too far.
        beyond = made @ candidates.T - offsets
        worst = beyond.max(axis=1)
        if worst.max() <= max(slack, HULL_SLACK_M):
            break
        chosen = np.argsort(-worst)[:PLANES_AT_ONCE]
        normals = np.concatenate([normals, candidates[np.unique(beyond[chosen].argmax(axis=1))]])
    return polytope if best is None else hull_around(best + middle)


def grown_hull(polytope: Polytope) -> Array:
    """Vertices (m, 3) of the same in larger, its planes moved outward by the slack."""
    middle = polytope.vertices.mean(axis=0)
    depth = float(-(polytope.planes[:, :3] @ middle + polytope.planes[:, 3]).max())
    return np.asarray(middle + (polytope.vertices - middle) * (1.0 + HULL_SLACK_M / depth))
