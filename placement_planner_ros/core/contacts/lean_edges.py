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

from placement_planner_ros.core.types import Array

SHORTEST_M = 0.01
"""m, length of the shortest edge that is looked at."""
MOST_EDGES = 32
"""Edges that are looked at, the longest, each with the wall on either side."""
SHARPEST_RAD = math.radians(3.0)
"""rad between the facets beside an edge, at least: less is one side of the object."""


@dataclass(frozen=True, slots=True, eq=False)
class LeanEdge:
    """An edge of the hull, with the side on which the wall is.

    Attributes:
        axes: (3, 3) rows in the object's frame: away from the wall, along the edge, up, where the
            object lies on the facet away from the wall.
        reference: (3,) the middle of the edge.
        length: m.
        greatest: rad that the object is turned by from there until it lies on the other facet.
        profile: (k, 2) corners of the hull, away from the wall and up from the edge, m.
    """

    axes: Array
    reference: Array
    length: float
    greatest: float
    profile: Array

    def turns(self, distance: Array, tilt: float) -> Array:
        """(n,) rad by which the object is turned where it touches the wall; NaN where it does not.

        Args:
            distance: (n,) of the edge, horizontally, from a wall with that tilt, metres.
        """
        away = np.asarray(distance, dtype=np.float64)[:, None] * math.cos(tilt)
        far = np.hypot(self.profile[:, 0], self.profile[:, 1])
        begins = np.arctan2(self.profile[:, 0], self.profile[:, 1])
        # Each corner comes to the wall at its own turn; the first is the one that touches.
        with np.errstate(invalid="ignore", divide="ignore"):
            turns = tilt + begins + np.arcsin(away / far)
        first = np.where(np.isfinite(turns), turns, np.inf).min(axis=1)
        possible = (away[:, 0] > 0.0) & (first > 0.0) & (first < self.greatest)
        return np.where(possible, first, np.nan)

    def rotations(self, turns: Array) -> Array:
        """(n, 3, 3) of the object, in axes away from the wall, along its foot and up."""
        cos, sin, none, one = (
            np.cos(turns),
            np.sin(turns),
            np.zeros(len(turns)),
            np.ones(len(turns)),
        )
        rows = [[cos, none, -sin], [none, one, none], [sin, none, cos]]
        return np.asarray(np.moveaxis(np.array(rows), 2, 0) @ self.axes)


def lean_edges(points: Array) -> tuple[LeanEdge, ...]:
    """Those of the hull of points (n, 3), the longest first."""
    hull = ConvexHull(points)
    normals, corners = hull.equations[:, :3], hull.points
    found = []
    for facet, beside in enumerate(hull.neighbors):
        for other in beside[beside > facet]:
            shared = np.intersect1d(hull.simplices[facet], hull.simplices[other])
            length = float(np.linalg.norm(corners[shared[1]] - corners[shared[0]]))
            greatest = math.acos(float(np.clip(normals[facet] @ normals[other], -1.0, 1.0)))
            if length >= SHORTEST_M and greatest >= SHARPEST_RAD:
                found.append((length, greatest, shared, (facet, other)))
    found.sort(key=lambda each: -each[0])
    vertices = corners[hull.vertices]
    return tuple(
        _edge(corners[shared], normals[list(order)], greatest, vertices)
        for _, greatest, shared, sides in found[:MOST_EDGES]
        for order in (sides, sides[::-1])
    )


def _edge(ends: Array, normals: Array, greatest: float, vertices: Array) -> LeanEdge:
    """The edge with the object lying on the first of the facets of these normals (2, 3)."""
    reference, length = ends.mean(axis=0), float(np.linalg.norm(ends[1] - ends[0]))
    up, along = -normals[0], (ends[1] - ends[0]) / length
    # The other facet faces the wall: its normal points there.
    if np.cross(along, up) @ normals[1] > 0.0:
        along = -along
    axes = np.stack([np.cross(along, up), along, up])
    profile = (vertices - reference) @ axes[[0, 2]].T
    off_edge = np.hypot(profile[:, 0], profile[:, 1]) > 1e-6
    return LeanEdge(axes, reference, length, greatest, profile[off_edge])
