"""An object that was placed: part of the environment until it is taken away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin
import trimesh

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.types import Array

SPACING = 0.004
"""Largest distance between neighbouring points on the surface, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class StandingObject:
    """A body where it stands.

    Attributes:
        points: (n, 3) on its surface, at most `SPACING` apart, planning frame.
    """

    body: Body
    T_world_object: pin.SE3
    points: Array

    @classmethod
    def at(cls, body: Body, T_world_object: pin.SE3) -> StandingObject:
        """The body at that pose."""
        vertices, _ = trimesh.remesh.subdivide_to_size(
            body.vertices, body.triangles, SPACING, max_iter=20
        )
        points = np.unique(np.round(vertices, 9), axis=0)
        T = T_world_object
        return cls(body, pin.SE3(T), np.asarray(points @ T.rotation.T + T.translation))

    def holds(self, points: Array, padding: float) -> npt.NDArray[np.bool_]:
        """Which of (n, 3) points lie in it, or at most `padding` metres outside of its facets."""
        lower, upper = self.points.min(axis=0) - padding, self.points.max(axis=0) + padding
        held = np.zeros(len(points), dtype=np.bool_)
        near = np.flatnonzero(((points >= lower) & (points <= upper)).all(axis=1))
        local = (points[near] - self.T_world_object.translation) @ self.T_world_object.rotation
        for part in self.body.parts:
            held[near] |= (local @ part.normals.T <= part.offsets + padding).all(axis=1)
        return held
