"""Surfaces that are known exactly: markers', furniture's, and those of objects that were placed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import trimesh

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.types import Array, Mask
from placement_planner_ros.core.weak_cache import weak_lru_cache
from placement_planner_ros.ros.inputs.cloud_store import PointSet
from placement_planner_ros.ros.inputs.self_filter import Outline

STEP_M = 0.25
"""In which the space grows that points are made in: few moves make them anew."""
SPACING_M = 0.004
"""Largest distance between neighbouring points on a surface."""
SAME_M = 1e-5
"""Points are the same within it; things are at most some metres long, which fits in 21 bits."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class KnownSurface:
    """Triangles (t, 3, 3) in the planning frame, metres."""

    corners: Array

    def within(self, lower: Array, upper: Array) -> PointSet:
        """What of it lies in a box of corners (3,), and a little around; remembered."""
        # on a coarse grid, so that a box that moves a little asks for the same points
        low, high = np.floor(lower / STEP_M) * STEP_M, np.ceil(upper / STEP_M) * STEP_M
        return _within(self, tuple(low.tolist()), tuple(high.tolist()))


@dataclass(frozen=True, slots=True, eq=False)
class PlacedBody:
    """A body that was put down, and the surface that it has there."""

    body: Body
    T_world_object: pin.SE3
    surface: KnownSurface

    @classmethod
    def at(cls, body: Body, T_world_object: pin.SE3) -> PlacedBody:
        """The body at that pose."""
        T = pin.SE3(T_world_object)
        corners = body.vertices[body.triangles] @ T.rotation.T + T.translation
        return cls(body, T, KnownSurface(corners))

    def holds(self, points: Array, padding: float) -> Mask:
        """Which of (n, 3) points lie in it, or at most `padding` metres from its surface."""
        return ~Outline.of_object(self.body, self.T_world_object, padding).outside(points)


@weak_lru_cache("surface", maxsize=2)
def _within(surface: KnownSurface, lower: tuple[float, ...], upper: tuple[float, ...]) -> PointSet:
    # cut by the six planes of the box, where any of it lies beyond
    vertices = surface.corners.reshape(-1, 3)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    for axis in range(3):
        for corner, side in ((lower, 1.0), (upper, -1.0)):
            if not (side * (vertices[:, axis] - corner[axis]) >= 0.0).all() and len(faces):
                vertices, faces, _ = trimesh.intersections.slice_faces_plane(
                    vertices, faces, side * np.eye(3)[axis], np.array(corner)
                )
    if not len(faces):
        return PointSet(np.zeros((0, 3)), placed=True)
    return PointSet(surface_points(vertices[faces]), placed=True)


def surface_points(corners: Array) -> Array:
    """(n, 3) points on triangles (t, 3, 3), at most `SPACING_M` apart.

    On each, rows along its longest edge, as far apart that no place is farther from a point than
    0.7 of that. To divide triangles by four until they are small made a
    box of 2 m 17 s of work and 2.7 GB.
    """
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    # how many steps along the longest edge, and rows across it
    length, last = edges.max(axis=1), edges.argmax(axis=1)
    sides = corners[:, 1:] - corners[:, :1]
    height = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / np.maximum(length, SAME_M)
    along = np.ceil(np.maximum(length, SAME_M) / SPACING_M).astype(np.int64)
    across = np.maximum(np.ceil(height / (0.7 * SPACING_M)), 1).astype(np.int64)
    turned = (last[:, None] + (2, 0, 1)) % 3  # the longest edge first
    found = []
    # all triangles of the same steps at once
    for n, m in np.unique(np.column_stack([along, across]), axis=0).tolist():
        rows = np.flatnonzero((along == n) & (across == m))
        found.append((_lattice(n, m) @ corners[rows[:, None], turned[rows]]).reshape(-1, 3))
    points = np.vstack(found)
    # edges are shared by two triangles: each point once
    x, y, z = ((points - points.min(axis=0)) / SAME_M).astype(np.int64).T
    _, first = np.unique((x << 42) + (y << 21) + z, return_index=True)
    return points[first]


def _lattice(along: int, across: int) -> Array:
    """(k, 3) shares of a triangle's corners: rows of `along` steps on its first edge, fewer where
    it is narrower."""
    rows = []
    for v in np.arange(across + 1) / across:
        u = np.linspace(0.0, 1.0 - v, int(np.ceil(along * (1.0 - v))) + 1)
        rows.append(np.column_stack([1.0 - v - u, u, np.full(len(u), v)]))
    return np.vstack(rows)
