"""Constraints on object poses: x in V, s(x), c_f(x), cheapest first."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.body.placement_face import PlacementFace
from placement_planner_ros.core.body.rests import GRAVITY, TIPPING_ENERGY
from placement_planner_ros.core.collision.arm import CollisionSettings
from placement_planner_ros.core.collision.object import ObjectCollision
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.types import LEVEL, Array, Slope, Verdict, upright

_LEANS = 0.025
"""Of the surface under an object against its contact plane, at most; 1.4 degrees."""
_NOISY = 1.0
"""Times the noise of the points that heights at two ends of an object may differ by."""


def placement_pose(
    face: PlacementFace, contact: Array, angle: float, slope: Slope = LEVEL
) -> pin.SE3:
    """T(R_n R_z(θ), (x, y, z_r)) · fT_o, a pose of Ŝ(r, f); on a level region R_n is the identity.

    Args:
        contact: (3,) position of the face's reference vertex.
        angle: θ, rad.
        slope: of the region, along whose normal R_n turns the object.
    """
    cos, sin = math.cos(angle), math.sin(angle)
    rotation = upright(slope) @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return pin.SE3(rotation, np.asarray(contact)) * face.T_face_object


def in_one_plane(points: Array, gaps: Array, noise: float) -> npt.NDArray[np.bool_]:
    """(n,) whether what carries objects does not lean against the plane that they are to stand on.

    The plane fitted to the surface under the vertices leans against it by `_LEANS` at most, or by
    what noise makes of so short a distance: on steps, and on surfaces that slope differently, the
    object would come to stand otherwise than it was placed.

    Args:
        points: (n, k, 3) vertices.
        gaps: (n, k) m, how far the surface is above each.
        noise: m that heights may be off by.
    """
    xy = points[..., :2] - points[..., :2].mean(axis=1, keepdims=True)
    spread = np.einsum("nki,nkj->nij", xy, xy)
    falls = np.einsum("nki,nk->ni", xy, gaps - gaps.mean(axis=1, keepdims=True))
    lean = np.linalg.norm(np.linalg.solve(spread, falls[..., None])[..., 0], axis=1)
    narrowest = 2.0 * np.sqrt(np.linalg.eigvalsh(spread)[:, 0] / points.shape[1])
    return np.asarray(lean <= _LEANS + noise / narrowest)


def stays(corners: Array) -> npt.NDArray[np.bool_]:
    """(n,) whether bodies stay that stand on polygons, as firmly as a rest on level ground does.

    The centre of mass lies inside along gravity, and to tip over any edge it would have to be
    lifted by what `TIPPING_ENERGY` does: about an edge of direction e, from which it lies at w, it
    goes up to |w| √(1 - e_z²).

    Args:
        corners: (n, k, 3) of each polygon in boundary order, seen from the centre of mass, z up.
    """
    edges = np.roll(corners, -1, axis=1) - corners
    edges /= np.maximum(np.linalg.norm(edges, axis=2, keepdims=True), 1e-12)
    across = edges[..., 0] * corners[..., 1] - edges[..., 1] * corners[..., 0]
    inside = (across < 0.0).all(axis=1) | (across > 0.0).all(axis=1)
    away = (corners * edges).sum(axis=2, keepdims=True) * edges - corners
    highest = np.linalg.norm(away, axis=2) * np.sqrt(1.0 - edges[..., 2] ** 2)
    lifted = (highest - away[..., 2]).min(axis=1)
    return np.asarray(inside & (GRAVITY * lifted >= TIPPING_ENERGY))


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

    def stable(self, T_world_object: pin.SE3, face: int, slope: Slope = LEVEL) -> bool:
        """s(x): every vertex of v(f) has support within the tolerance, not too near to its end.

        What carries them lies in one plane, and on a slope the object must not tip, either.
        `verdicts` asks the same of many poses at once.
        """
        return bool(self._stable(T_world_object.homogeneous[None], face, slope)[0])

    def free(
        self,
        T_world_object: pin.SE3,
        contact_height: float,
        raise_height: float | None = None,
        slope: Slope = LEVEL,
    ) -> bool:
        """c_f(x), on the whole way straight down from `raise_height` above; of many: `verdicts`."""
        height = self._raise_height if raise_height is None else raise_height
        return self._collision.free(T_world_object.homogeneous, contact_height, height, slope)

    def verdict(
        self, T_world_object: pin.SE3, face: int, contact_height: float, slope: Slope = LEVEL
    ) -> Verdict:
        """The first constraint that fails, or FEASIBLE."""
        if not self.in_volume(T_world_object, face):
            return Verdict.OUTSIDE_VOLUME
        if not self.stable(T_world_object, face, slope):
            return Verdict.UNSTABLE
        if not self.free(T_world_object, contact_height, slope=slope):
            return Verdict.COLLIDING
        return Verdict.FEASIBLE

    def verdicts(
        self,
        faces: npt.NDArray[np.int64],
        contacts: Array,
        angles: Array,
        slopes: Array | None = None,
    ) -> tuple[npt.NDArray[np.int64], Array]:
        """`placement_pose` and `verdict` of many poses at once.

        Args:
            faces: (n,) indices.
            contacts: (n, 3) positions of the faces' reference vertices.
            angles: (n,) θ, rad.
            slopes: (n, 2) of the planes that they stand on; level unless given.

        Returns:
            (n,) verdicts and (n, 4, 4) poses T_world_object.
        """
        turned = np.zeros((len(faces), 4, 4))
        turned[:, 0, 0] = turned[:, 1, 1] = np.cos(angles)
        turned[:, 1, 0] = np.sin(angles)
        turned[:, 0, 1] = -turned[:, 1, 0]
        turned[:, 2, 2] = turned[:, 3, 3] = 1.0
        turned[:, :3, 3] = contacts
        sloping = slopes is not None and bool(slopes.any())
        if slopes is not None and sloping:
            turned[:, :3, :3] = upright(slopes) @ turned[:, :3, :3]
        T = turned @ self._T_face_object[faces]
        centers = T[:, :3, :3] @ self._body.center_of_mass + T[:, :3, 3]
        centers[:, 2] = contacts[:, 2]
        inside = self._volume.contains(contacts) & self._volume.contains(centers)
        result = np.full(len(faces), Verdict.OUTSIDE_VOLUME, dtype=np.int64)
        if slopes is None or not sloping:
            self._judge(T, faces, contacts[:, 2], np.flatnonzero(inside), LEVEL, result)
            return result, T
        for slope in np.unique(slopes[inside], axis=0):
            rows = np.flatnonzero(inside & (slopes == slope).all(axis=1))
            heights = contacts[:, 2] - contacts[:, :2] @ slope
            self._judge(T, faces, heights, rows, (float(slope[0]), float(slope[1])), result)
        return result, T

    def _judge(
        self,
        T: Array,
        faces: npt.NDArray[np.int64],
        heights: Array,
        rows: npt.NDArray[np.int64],
        slope: Slope,
        result: npt.NDArray[np.int64],
    ) -> None:
        """Write the verdicts of those rows of poses T (n, 4, 4) in V that stand on one slope.

        Args:
            heights: (n,) z of their contact planes at x = y = 0, metres.
        """
        result[rows] = Verdict.UNSTABLE
        for face in np.unique(faces[rows]):
            on = rows[faces[rows] == face]
            result[on[self._stable(T[on], int(face), slope)]] = Verdict.COLLIDING
        stable = rows[result[rows] == Verdict.COLLIDING]
        if len(stable):
            free = self._collision.free_at(T[stable], heights[stable], self._raise_height, slope)
            result[stable[free]] = Verdict.FEASIBLE

    def _stable(self, T: Array, face: int, slope: Slope) -> npt.NDArray[np.bool_]:
        """(n,) `stable` of poses (n, 4, 4)."""
        points = self._contacts[face] @ T[:, :3, :3].transpose(0, 2, 1)
        points += T[:, None, :3, 3]
        gaps = self._environment.support_of(slope).gaps(
            points.reshape(-1, 3), self.contact_tolerance, self.edge_margin
        )
        gaps = gaps.reshape(len(T), -1)
        stable = np.asarray(np.isfinite(gaps).all(axis=1))
        noise = _NOISY * self._environment.measured.noise
        stable[stable] = in_one_plane(points[stable], gaps[stable], noise)
        if slope != LEVEL:
            centers = T[:, :3, :3] @ self._body.center_of_mass + T[:, :3, 3]
            stable &= stays(points - centers[:, None])
        return stable
