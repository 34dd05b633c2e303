"""Convex hulls that hold what they are made of in spite of rounding, and simpler ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from placement_planner_ros.core.types import Array

ROUNDING = 1e-6
"""Metres by which what a hull holds is inside it."""

_THIN = 5e-4
"""Metres: hulls are at least this thick to both sides of their middle."""

_PLAIN = 24
"""Vertices that are not worth having fewer of."""

_FLAT = 1e-3
"""Length of two unit normals' sum from which on it says a direction."""

_CANDIDATES = 4096
"""Planes that are considered for it at most; a subset holds it as well."""

_CUTS = 8
"""Planes by which a simpler hull is cut at once."""

_TELLING = np.array([1.0, np.pi, np.e**2, np.sqrt(3.0) * 7.0])
"""A plane's numbers times these tell it from others."""

_AT_ONCE = 4_000_000
"""Points times planes that are compared at once."""


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
    """The hull of points (n, 3), thickened where it is thin; it has neither rounding nor spare."""
    middle = points.mean(axis=0)
    axes = np.linalg.eigh((points - middle).T @ (points - middle))[1].T
    along = points @ axes.T
    for axis in axes[np.ptp(along, axis=0) < 2.0 * _THIN]:
        low, high = points - _THIN * axis, points + _THIN * axis
        points = np.concatenate([low, high])
    return _hull(points)


def _hull(points: Array) -> Polytope:
    hull = ConvexHull(points)
    # Facets of one plane come out alike; two of different planes do not, and were one left out, the
    # polytope would only be larger.
    _, rows = np.unique(hull.equations.round(9) @ _TELLING, return_index=True)
    return Polytope(points[hull.vertices], hull.equations[rows])


def simpler(polytope: Polytope, slack: float, most: int) -> Polytope:
    """One around it with fewer vertices, where there is.

    Args:
        slack: metres that its vertices may be outside any plane of the given one; more where
            there would be too many.
        most: vertices that it may have.
    """
    if len(polytope.vertices) <= _PLAIN:
        return polytope
    middle = polytope.vertices.mean(axis=0)
    vertices = polytope.vertices - middle
    candidates = _normals(vertices)
    if len(candidates) > _CANDIDATES:
        rng = np.random.default_rng(0)
        candidates = candidates[np.sort(rng.choice(len(candidates), _CANDIDATES, replace=False))]
    offsets = _reach(vertices, candidates)
    axes = np.linalg.eigh(vertices.T @ vertices)[1].T
    normals = np.concatenate([np.eye(3), -np.eye(3), axes, -axes])
    best = polytope
    cut: set[int] = set()
    while True:
        made = _cut_out(normals, _reach(vertices, normals))
        if len(made) > (most if len(vertices) > most else len(vertices)):
            break
        best = Polytope(made + middle, polytope.planes)
        beyond = made @ candidates.T - offsets
        worst = beyond.max(axis=1)
        if worst.max() <= max(slack, ROUNDING):
            break
        order = np.argsort(-worst)
        chosen = np.unique(beyond.argmax(axis=1)[order[worst[order] > slack]][:_CUTS])
        if not set(chosen.tolist()) - cut:  # only rounding is left
            break
        cut |= set(chosen.tolist())
        normals = np.concatenate([normals, candidates[chosen]])
    return best if best is polytope else _hull(best.vertices)


def _reach(vertices: Array, normals: Array) -> Array:
    """(k,) how far vertices (m, 3) reach along normals (k, 3)."""
    chunk = max(1, _AT_ONCE // len(vertices))
    rows = range(0, len(normals), chunk)
    return np.concatenate([(normals[r : r + chunk] @ vertices.T).max(axis=1) for r in rows])


def _normals(vertices: Array) -> Array:
    """(k, 3) of the hull's facets, and in the middle between those beside each edge and vertex."""
    hull = ConvexHull(vertices)
    facets = hull.equations[:, :3]
    edges = (facets[:, None] + facets[hull.neighbors]).reshape(-1, 3)
    corners = np.zeros_like(vertices)
    np.add.at(corners, hull.simplices.ravel(), np.repeat(facets, 3, axis=0))
    made = np.concatenate([facets, edges, corners])
    length = np.linalg.norm(made, axis=1)
    made = made[length > _FLAT] / length[length > _FLAT, None]
    return np.asarray(made[np.unique(made.round(6), axis=0, return_index=True)[1]])


def _cut_out(normals: Array, offsets: Array) -> Array:
    """Vertices (m, 3) of what has n · x <= offset for all normals (k, 3), offsets (k,) > 0."""
    dual = ConvexHull(normals / offsets[:, None]).equations
    points = dual[:, :3] / -dual[:, 3:]
    return np.asarray(points[np.unique(points.round(7), axis=0, return_index=True)[1]])


def grown(polytope: Polytope) -> Array:
    """Vertices (m, 3) of the same in larger, its planes moved outward by twice the rounding."""
    middle = polytope.vertices.mean(axis=0)
    depth = float(-(polytope.planes[:, :3] @ middle + polytope.planes[:, 3]).max())
    return np.asarray(middle + (polytope.vertices - middle) * (1.0 + 2.0 * ROUNDING / depth))


def holds(vertices: Array, points: Array) -> bool:
    """Whether the hull of vertices (m, 3) is proven to hold points (n, 3), with spare.

    Each edge of the facets has two, so that they form closed surfaces; as none of the vertices is
    outside any facet's plane, they surround a point within all planes once. The way from there to
    another point within all planes crosses no facet: this one is inside, too. Rounding keeps facets
    and vertices nearer to the planes than the points are.
    """
    try:
        hull = ConvexHull(vertices)
    except QhullError:
        return False
    corners = vertices[hull.simplices]
    normals, offsets = hull.equations[:, :3], hull.equations[:, 3]
    off_plane = np.einsum("fik,fk->fi", corners, normals) + offsets[:, None]
    _, shared = np.unique(
        np.sort(hull.simplices[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1),
        axis=0,
        return_counts=True,
    )
    middle = vertices.mean(axis=0)
    outside = (vertices @ normals.T + offsets).max()
    if max(np.abs(off_plane).max(), outside) > 0.1 * ROUNDING or (shared != 2).any():
        return False
    if (normals @ middle + offsets).max() > -ROUNDING or not _surrounds(corners - middle):
        return False
    chunk = max(1, _AT_ONCE // len(normals))
    return all(
        (points[row : row + chunk] @ normals.T + offsets).max() <= -0.5 * ROUNDING
        for row in range(0, len(points), chunk)
    )


def _surrounds(corners: Array) -> bool:
    """Whether the triangles (f, 3, 3), turned to face outward, surround the origin once."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    volume = np.abs(np.einsum("fk,fk->f", a, np.cross(b, c)))
    below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return bool(abs(2.0 * np.arctan2(volume, below).sum() - 4.0 * np.pi) < 1e-3)
