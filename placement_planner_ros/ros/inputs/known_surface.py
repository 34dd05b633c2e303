"""The surface of something that is known exactly, as points where the robot can get to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from placement_planner_ros.core.types import Array
from placement_planner_ros.core.weak_cache import weak_lru_cache
from placement_planner_ros.ros.inputs.cloud_store import PointSet
from placement_planner_ros.ros.inputs.standing_object import surface_points

STEP = 0.25
"""m, steps in which the space grows that points are made in: few moves make them anew."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class KnownSurface:
    """Triangles (t, 3, 3) in the planning frame, metres."""

    corners: Array

    def within(self, lower: Array, upper: Array) -> PointSet:
        """What of it lies in a box of corners (3,), and a little around; remembered."""
        low, high = np.floor(lower / STEP) * STEP, np.ceil(upper / STEP) * STEP
        return _within(self, tuple(low.tolist()), tuple(high.tolist()))


@weak_lru_cache("surface", maxsize=2)
def _within(surface: KnownSurface, lower: tuple[float, ...], upper: tuple[float, ...]) -> PointSet:
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
