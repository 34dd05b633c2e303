"""Positions of the body's points over cells of the pose sets Ŝ(r, f)."""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.objective.objective import PoseRanges
from placement_planner_ros.core.search.cell_layout import Cells, PoseSets
from placement_planner_ros.core.types import Array, upright


class PlacedCells:
    """Where cells (n,) put points of the body.

    A pose of a cell is T(R_n R_z(θ), c) · fT_o, so a point p of the face frame comes to lie within
    `turn` ‖p_xy‖ + the box of c about its place at the middle of the cell. The turn is about the
    normal of the cell's plane, and c lies in it: upwards they make less than `steep` of that.
    """

    def __init__(self, sets: PoseSets, cells: Cells) -> None:
        of = cells["set"]
        self.face, self.height, self.slope = sets.face[of], sets.z[of], sets.slope[of]
        self.plane, self.planes = sets.plane[of], sets.planes
        # The middle of each cell, and how far its points are from there.
        half = 0.5 * (cells["high"] - cells["low"])
        middle = cells["low"] + half
        self.half, self.half_turn = half[:, :2], np.minimum(half[:, 2], np.pi)
        self.contact = sets.contact_points(of, middle[:, :2])
        # The object's turn in the middle of the range, on the plane's slope.
        cos, sin = np.cos(middle[:, 2]), np.sin(middle[:, 2])
        self._turned = np.zeros((len(cells), 3, 3))
        self._turned[:, 0, 0] = self._turned[:, 1, 1] = cos
        self._turned[:, 1, 0], self._turned[:, 0, 1] = sin, -sin
        self._turned[:, 2, 2] = 1.0
        if self.slope.any():
            self._turned = upright(self.slope) @ self._turned
        # how far a point at distance 1 from the normal through c is from its middle at most
        self.turn = 2.0 * np.sin(0.5 * self.half_turn)
        # How much the plane rises over half a cell, and how steep it is.
        self.rise = (np.abs(self.slope) * self.half).sum(axis=1)
        rises = np.hypot(self.slope[:, 0], self.slope[:, 1])
        self.steep = rises / np.sqrt(1.0 + rises * rises)

    def poses(self, T_face_object: Array) -> Array:
        """(n, 4, 4) T_world_object at the middle of each cell, of fT_o (|F|, 4, 4)."""
        T = np.tile(np.eye(4), (len(self.face), 1, 1))
        T[:, :3, :3], T[:, :3, 3] = self._turned, self.contact
        return np.asarray(T @ T_face_object[self.face])

    def ranges(self, T_face_object: Array) -> PoseRanges:
        """The poses of each cell, of fT_o (|F|, 4, 4)."""
        origins = T_face_object[self.face, :3, 3][:, None]
        shift = np.linalg.norm(self.half, axis=1)
        aside = shift + self.strays(origins)[:, 0]
        return PoseRanges(
            self.poses(T_face_object),
            self.contact,
            self._turned[:, :, 2],
            shift,
            self.half_turn,
            self.rise,
            np.hypot(aside, self.rises(origins)[:, 0]),
        )

    def middles(self, points: Array) -> Array:
        """(n, m, 3) points (n, m, 3) of the face frame at the middle of each cell."""
        return np.asarray(points @ self._turned.transpose(0, 2, 1) + self.contact[:, None])

    def strays(self, points: Array) -> Array:
        """(n, m) m, how far turning takes each point from there at most."""
        return np.asarray(self.turn[:, None] * np.hypot(points[..., 0], points[..., 1]))

    def rises(self, points: Array) -> Array:
        """(n, m) m, how far up or down each point gets from there at most."""
        return np.asarray(self.rise[:, None] + self.steep[:, None] * self.strays(points))
