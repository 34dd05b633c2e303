"""Constraints on object poses: x in V, s(x), c_f(x), cheapest first."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.body.placement_face import PlacementFace
from placement_planner_ros.core.collision.arm import CollisionSettings
from placement_planner_ros.core.collision.object import ObjectCollision
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.types import Array, Verdict


def placement_pose(face: PlacementFace, contact: Array, angle: float) -> pin.SE3:
    """T(R_z(θ), (x, y, z_r)) · fT_o, a pose of Ŝ(r, f).

    Args:
        contact: (3,) position of the face's reference vertex.
        angle: θ, rad.
    """
    cos, sin = math.cos(angle), math.sin(angle)
    rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return pin.SE3(rotation, np.asarray(contact)) * face.T_face_object


class PoseConstraints:
    """V, s(x) and c_f(x) of one body in one environment.

    Args:
        problem: o, the environment and V.
        collision: c_f(x)'s margin, and how far below a vertex of v(f) its support may lie.
        edge_margin: what v(f) keeps from the end of its support, metres, see `SupportMap`.
        raise_height: the least height from which the body must come straight down, metres.
    """

    def __init__(
        self,
        problem: Problem,
        collision: CollisionSettings,
        edge_margin: float,
        raise_height: float,
    ) -> None:
        body, environment = problem.body, problem.environment
        self.problem = problem
        self.contact_tolerance = collision.contact_tolerance
        self.edge_margin = edge_margin
        self._body = body
        self._environment = environment
        self._volume = problem.volume
        self._collision = ObjectCollision(body, environment.obstacles, collision)
        self._raise_height = raise_height
        self._contacts = [face.vertices for face in body.faces]
        self._T_face_object = np.array([face.T_face_object.homogeneous for face in body.faces])

    def in_volume(self, T_world_object: pin.SE3, face: int) -> bool:
        """Whether the reference contact point lies in V, and horizontally the centre of mass."""
        reference = T_world_object.act(self._body.faces[face].vertices[0])
        center = T_world_object.act(self._body.center_of_mass)
        center[2] = reference[2]
        return bool(self._volume.contains(np.array([reference, center])).all())

    def stable(self, T_world_object: pin.SE3, face: int) -> bool:
        """s(x): every vertex of v(f) has support within the tolerance, not too near to its end.

        `verdicts` asks the same of many poses at once.
        """
        points = self._contacts[face] @ T_world_object.rotation.T
        points += T_world_object.translation
        support = self._environment.support
        return bool(support.supported(points, self.contact_tolerance, self.edge_margin).all())

    def free(
        self, T_world_object: pin.SE3, contact_height: float, raise_height: float | None = None
    ) -> bool:
        """c_f(x), on the whole way straight down from `raise_height` above; of many: `verdicts`."""
        height = self._raise_height if raise_height is None else raise_height
        return self._collision.free(T_world_object.homogeneous, contact_height, height)

    def verdict(self, T_world_object: pin.SE3, face: int, contact_height: float) -> Verdict:
        """The first constraint that fails, or FEASIBLE."""
        if not self.in_volume(T_world_object, face):
            return Verdict.OUTSIDE_VOLUME
        if not self.stable(T_world_object, face):
            return Verdict.UNSTABLE
        if not self.free(T_world_object, contact_height):
            return Verdict.COLLIDING
        return Verdict.FEASIBLE

    def verdicts(
        self, faces: npt.NDArray[np.int64], contacts: Array, angles: Array
    ) -> tuple[npt.NDArray[np.int64], Array]:
        """`placement_pose` and `verdict` of many poses at once.

        Args:
            faces: (n,) indices.
            contacts: (n, 3) positions of the faces' reference vertices.
            angles: (n,) θ, rad.

        Returns:
            (n,) verdicts and (n, 4, 4) poses T_world_object.
        """
        turned = np.zeros((len(faces), 4, 4))
        turned[:, 0, 0] = turned[:, 1, 1] = np.cos(angles)
        turned[:, 1, 0] = np.sin(angles)
        turned[:, 0, 1] = -turned[:, 1, 0]
        turned[:, 2, 2] = turned[:, 3, 3] = 1.0
        turned[:, :3, 3] = contacts
        T = turned @ self._T_face_object[faces]
        centers = T[:, :3, :3] @ self._body.center_of_mass + T[:, :3, 3]
        centers[:, 2] = contacts[:, 2]
        inside = self._volume.contains(contacts) & self._volume.contains(centers)
        result = np.full(len(faces), Verdict.OUTSIDE_VOLUME, dtype=np.int64)
        result[inside] = Verdict.UNSTABLE
        for face in np.unique(faces[inside]):
            rows = np.flatnonzero(inside & (faces == face))
            points = self._contacts[face] @ T[rows, :3, :3].transpose(0, 2, 1)
            points += T[rows, None, :3, 3]
            supported = self._environment.support.supported(
                points.reshape(-1, 3), self.contact_tolerance, self.edge_margin
            )
            result[rows[supported.reshape(len(rows), -1).all(axis=1)]] = Verdict.COLLIDING
        stable = np.flatnonzero(result == Verdict.COLLIDING)
        if len(stable):
            free = self._collision.free_at(T[stable], contacts[stable, 2], self._raise_height)
            result[stable[free]] = Verdict.FEASIBLE
        return result, T
