"""Edges of the object's hull on which it may lean against a wall, and how it is turned there.

About an edge that is down and parallel to a wall the object can be turned from the one facet
beside the edge, on which it lies away from the wall, to the other. On the way it only comes nearer
to the wall: so how far the edge is from the wall says how the object is turned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from placement_planner_ros.core.types import Array, Index

SHORTEST_M = 0.01
"""m, length of the shortest edge that is looked at."""
MOST_EDGES = 32
"""Edges that are looked at, the longest, each with the wall on either side."""
SHARPEST_RAD = math.radians(3.0)
"""rad between the facets beside an edge, at least: less is one side of the object."""


@dataclass(frozen=True, slots=True, eq=False)
class LeanEdges:
    """Edges of the hull, each with the side on which the wall is, one a row.

    Attributes:
        corners: (k, 3) of the hull, in the object's frame, metres.
        references: (e, 3) the middles of the edges there.
        axes: (e, 3, 3) rows: away from the wall, along the edge, up, where the object lies on the
            facet away from the wall.
        greatest: (e,) rad that the object is turned by from there until it lies on the other facet.
    """

    corners: Array
    references: Array
    axes: Array
    greatest: Array

    def __len__(self) -> int:
        return len(self.references)

    def turns(self, edges: Index, distances: Array, tilts: Array) -> Array:
        """(n,) rad by which the object is turned where it touches the wall; NaN where it does not.

        Args:
            edges: (n,) rows of these.
            distances: (n,) of each, horizontally, from its wall, metres.
            tilts: (n,) rad by which that leans back.
        """
        # Corners away from the wall and up from the edge, as distances and angles.
        about = self.corners - self.references[edges, None]
        out, up = np.moveaxis(about @ self.axes[edges][:, [0, 2]].transpose(0, 2, 1), 2, 0)
        far, begins = np.hypot(out, up), np.arctan2(out, up)
        far[far < 1e-6] = np.nan  # the edge's own
        away = distances * np.cos(tilts)
        # Each corner comes to the wall at its own turn; the first is the one that touches.
        with np.errstate(invalid="ignore"):
            turns = tilts[:, None] + begins + np.arcsin(away[:, None] / far)
        first = np.where(np.isfinite(turns), turns, np.inf).min(axis=1, initial=np.inf)
        possible = (away > 0.0) & (first > 0.0) & (first < self.greatest[edges])
        return np.where(possible, first, np.nan)

    def rotations(self, edges: Index, turns: Array) -> Array:
        """(n, 3, 3) of the object, in axes away from the wall, along its foot and up."""
        turned = np.zeros((len(turns), 3, 3))
        turned[:, 0, 0] = turned[:, 2, 2] = np.cos(turns)
        turned[:, 2, 0] = np.sin(turns)
        turned[:, 0, 2] = -turned[:, 2, 0]
        turned[:, 1, 1] = 1.0
        return np.asarray(turned @ self.axes[edges])


def lean_edges(points: Array) -> LeanEdges:
    """Those of the hull of points (n, 3), the longest first."""
    hull = ConvexHull(points)
    normals, corners = hull.equations[:, :3], hull.points
    # Each two facets side by side, and the two corners that they share.
    facets = np.column_stack([np.repeat(np.arange(len(normals)), 3), hull.neighbors.ravel()])
    facets = facets[facets[:, 0] < facets[:, 1]]
    own, others = (hull.simplices[facets[:, k]] for k in (0, 1))
    shared = own[(own[:, :, None] == others[:, None]).any(axis=2)].reshape(-1, 2)
    along = corners[shared[:, 1]] - corners[shared[:, 0]]
    length = np.linalg.norm(along, axis=1)
    cosine = (normals[facets[:, 0]] * normals[facets[:, 1]]).sum(axis=1)
    greatest = np.arccos(np.clip(cosine, -1.0, 1.0))
    sharp = np.flatnonzero((length >= SHORTEST_M) & (greatest >= SHARPEST_RAD))
    # Each edge with the wall on either side: it lies on the first of two facets, and the second
    # faces the wall, so its normal points there.
    edges = np.repeat(sharp[np.argsort(-length[sharp], kind="stable")][:MOST_EDGES], 2)
    first = np.arange(len(edges)) % 2
    up = -normals[facets[edges, first]]
    along = along[edges] / length[edges, None]
    towards = (np.cross(along, up) * normals[facets[edges, 1 - first]]).sum(axis=1) > 0.0
    along[towards] *= -1.0
    return LeanEdges(
        corners[hull.vertices],
        corners[shared[edges]].mean(axis=1),
        np.stack([np.cross(along, up), along, up], axis=1),
        greatest[edges],
    )
