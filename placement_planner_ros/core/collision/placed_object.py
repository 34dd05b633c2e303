"""An object that stands in the world, moved within the arrays of `arrays`.

Fixed bodies are laid out in world coordinates once and for all; a placed object is the one whose
pose changes from placement to placement.
"""

from __future__ import annotations

import itertools

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.collision.arrays import (
    BODY_FIRST_SET,
    SET_FIRST_NODE,
    SET_FIRST_VERTEX,
    SET_MESH,
    ArmScratch,
    FlatArm,
)
from placement_planner_ros.core.types import Array


class PlacedObjectRows:
    """The rows of one fixed body, and where they are.

    But for its planes: these are asked for of bodies against boxes, and this one meets none.

    Args:
        flat, scratch: written to by `move`.
        name: of the object among the bodies; in `flat` it stands at the world's origin.
    """

    def __init__(self, flat: FlatArm, scratch: ArmScratch, name: str) -> None:
        # Rows of the object's sets, spheres and vertices.
        body = [b.name for b in flat.bodies].index(name)
        arrays = flat.arrays
        sets = slice(*arrays.bodies[body : body + 2, BODY_FIRST_SET].tolist())
        nodes, vertices = (
            slice(*arrays.sets[[sets.start, sets.stop], column].tolist())
            for column in (SET_FIRST_NODE, SET_FIRST_VERTEX)
        )
        # Tables whose points move with the object, and the boxes around its sets.
        self._groups = [
            [arrays.vertices[vertices], scratch.vertices[vertices]],
            [arrays.node_spheres[nodes, :3]],
            [scratch.set_spheres[sets, :3]],
            [t[body : body + 1, :3] for t in (arrays.body_spheres, scratch.body_spheres)],
        ]
        self._bounds = scratch.bounds[sets]
        self._radius = arrays.radius[sets, None]
        self._first = arrays.sets[sets, SET_FIRST_VERTEX] - vertices.start
        used = np.unique(arrays.sets[sets, SET_MESH])
        self._mesh_frames = [arrays.mesh_frames[mesh] for mesh in used[used >= 0].tolist()]
        # All points in the object's own frame, one below the other.
        ends = np.cumsum([0] + [len(group[0]) for group in self._groups])
        self._rows = [slice(a, b) for a, b in itertools.pairwise(ends.tolist())]
        self._points: Array = np.vstack([group[0] for group in self._groups])

    def move(self, T_world_object: pin.SE3) -> None:
        """Put the object elsewhere: some 20 µs."""
        R, p = T_world_object.rotation, T_world_object.translation
        # Every point where it is now.
        points = self._points @ R.T + p
        for group, rows in zip(self._groups, self._rows, strict=True):
            for table in group:
                table[:] = points[rows]
        for frame in self._mesh_frames:  # in the object's own frame
            frame[:] = T_world_object.homogeneous
        # Boxes around the sets.
        corners = points[self._rows[0]]
        self._bounds[:, :3] = np.minimum.reduceat(corners, self._first) - self._radius
        self._bounds[:, 3:] = np.maximum.reduceat(corners, self._first) + self._radius
