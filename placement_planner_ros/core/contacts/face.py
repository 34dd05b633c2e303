"""Faces of the object on level or sloping surfaces: the paper's contact class."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.placement_face import PlacementFace
from placement_planner_ros.core.collision.arm import CollisionSettings
from placement_planner_ros.core.collision.object import ObjectCollision
from placement_planner_ros.core.contacts.by_polygon import PolygonSupport
from placement_planner_ros.core.contacts.by_vertices import VertexSupport
from placement_planner_ros.core.contacts.support_settings import SupportSettings
from placement_planner_ros.core.objective.objective import moved_pose
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.search.hierarchy import EVERY_TURN, Ranges
from placement_planner_ros.core.types import Array, Contact, Index, Mask, Resting, Slope, upright
from placement_planner_ros.core.wishes.turns import Turns


class FaceContact:
    """Ŝ(r, f) of every face f and region r, with s(x) by the vertices or by the polygon.

    Args:
        collision: c_f(x)'s margin, and how far from the contact plane its support may lie.
        turns: the rules about how the object is turned; None without.

    Attributes:
        support: s(x).
        faces: F; with support by polygon, the foot of the centre of mass is their reference point.
    """

    def __init__(
        self,
        problem: Problem,
        footing: SupportSettings,
        collision: CollisionSettings,
        turns: Turns | None,
    ) -> None:
        by_polygon = footing.support == "polygon"
        rule = PolygonSupport if by_polygon else VertexSupport
        self.support: PolygonSupport | VertexSupport = rule(problem, footing)
        self.faces: tuple[PlacementFace, ...] = self.support.faces
        self.references = np.array([face.reference for face in self.faces]).reshape(-1, 3)
        self.frames = tuple(face.T_face_object for face in self.faces)
        self._turns = turns
        body = replace(problem.body, faces=self.faces)
        self._collision = ObjectCollision(
            body, problem.environment.obstacles, collision, overhangs=by_polygon
        )
        self._T_face_object = np.array([T.homogeneous for T in self.frames]).reshape(-1, 4, 4)

    @property
    def regions(self) -> tuple[Region, ...]:
        """R."""
        return self.support.regions

    def ranges(self, feature: int, region: Region) -> Ranges:
        """Every turn, or those that are asked for."""
        return EVERY_TURN if self._turns is None else self._turns.ranges(feature, region.slope)

    def poses(self, features: Index, points: Array, angles: Array, slopes: Array | None) -> Array:
        """(n, 4, 4) T(R_n R_z(θ), (x, y, z_r)) · fT_o of each, poses of Ŝ(r, f); on level ones R_n
        is the identity."""
        turned = np.zeros((len(features), 4, 4))
        turned[:, 0, 0] = turned[:, 1, 1] = np.cos(angles)
        turned[:, 1, 0] = np.sin(angles)
        turned[:, 0, 1] = -turned[:, 1, 0]
        turned[:, 2, 2] = turned[:, 3, 3] = 1.0
        turned[:, :3, 3] = points
        if slopes is not None and slopes.any():
            turned[:, :3, :3] = upright(slopes) @ turned[:, :3, :3]
        return np.asarray(turned @ self._T_face_object[features])

    def stable(self, T: Array, features: Index, slope: Slope) -> Mask:
        """(n,) s(x)."""
        return self.support.stable(T, features, slope)

    def held(self, T: Array, features: Index) -> Mask:
        """(n,) all: nothing is left of s(x)."""
        return np.ones(len(T), np.bool_)

    def free(self, T: Array, features: Index, heights: Array, raised: float, slope: Slope) -> Mask:
        """(n,) c_f(x), on the whole way straight down."""
        return self._collision.free_at(T, heights, raised, slope)

    def opening(self, feature: int) -> Array:
        """(3,) up."""
        return np.array([0.0, 0.0, 1.0])

    def moved(self, T_world_object: pin.SE3, contact: Contact, change: Array) -> pin.SE3:
        """The pose moved within its contact plane, and turned about its normal."""
        return moved_pose(T_world_object, change, contact.slope)

    def excluded(self, features: Index, heights: Array, low: Array, high: Array) -> Mask:
        """(n,) none: `SupportBound` judges them."""
        return np.zeros(len(features), np.bool_)

    def resting(self, T_world_object: pin.SE3, feature: int) -> Resting:
        """On v(f)."""
        face = self.faces[feature]
        normals = np.repeat(-(T_world_object.rotation @ face.normal)[None], len(face.vertices), 0)
        points = face.vertices @ T_world_object.rotation.T + T_world_object.translation
        friction = np.full(len(points), self.support.footing.friction)
        return Resting("face", "", points, normals, friction, np.zeros((0, 3)))

    def missing(self) -> None:
        """Nothing: a search over no region says so itself."""
