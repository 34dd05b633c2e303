"""The terms that weighted objectives and requirements are made of: those that are told by the pose.

Larger is better, in each one's own unit; a weighted objective adds them in units of their `scale`.
"""

from __future__ import annotations

import math
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull, QhullError

from placement_planner_ros.core.body.contact_points import contact_points
from placement_planner_ros.core.objective.clearance import Clearance
from placement_planner_ros.core.objective.objective import ObjectiveContext, PoseRanges
from placement_planner_ros.core.objective.supporting_faces import SupportingFaces, padded_rows
from placement_planner_ros.core.scene.clearance_table import CAP
from placement_planner_ros.core.types import Array, Index


class Term(Protocol):
    """One thing that a placement is judged by."""

    @property
    def scale(self) -> float:
        """The difference, in its unit, that counts as 1."""
        ...

    @property
    def ends(self) -> tuple[float, float]:
        """Values that it is never below and never above."""
        ...

    @property
    def expensive(self) -> bool:
        """Whether it is asked only where the others do not settle it."""
        ...

    def values(self, T_world_object: Array) -> Array:
        """(n,) at poses (n, 4, 4)."""
        ...


@runtime_checkable
class SlowTerm(Protocol):
    """A term that is known to change little from a pose to those around it."""

    def around(self, ranges: PoseRanges, rough: bool = False) -> tuple[Array, Array]:
        """(n,) what it is not below and (n,) not above at any pose of each range; about, where that
        will do."""
        ...


def term_ends(term: Term, ranges: PoseRanges, rough: bool = False) -> tuple[Array, Array]:
    """(n,) what any term is not below and (n,) not above at any pose of each range."""
    if isinstance(term, SlowTerm):
        return term.around(ranges, rough)
    return np.full(len(ranges.T), term.ends[0]), np.full(len(ranges.T), term.ends[1])


class ClearanceTerm(Clearance):
    """clearance: C(x), the mean distance d_S of the object from what stands around it, metres."""

    scale: ClassVar = 0.1
    ends: ClassVar = (0.0, CAP)
    expensive: ClassVar = True


class Near:
    """near: minus the distance of the object's origin from that of `near_pose`, metres."""

    scale: ClassVar = 0.1
    ends: ClassVar = (-math.inf, 0.0)
    expensive: ClassVar = False

    def __init__(self, context: ObjectiveContext) -> None:
        self._target = np.array(context.wishes.near_pose[:3])

    def values(self, T_world_object: Array) -> Array:
        """(n,) at poses (n, 4, 4)."""
        away = T_world_object[:, :3, 3] - self._target
        return np.asarray(-np.sqrt((away * away).sum(axis=1)))

    def around(self, ranges: PoseRanges, rough: bool = False) -> tuple[Array, Array]:
        """(n,) each, by the distance that is left."""
        middle = self.values(ranges.T)
        return middle - ranges.away, np.minimum(middle + ranges.away, 0.0)


class Turn:
    """turn: minus the angle by which the object is turned from `near_pose`, radians."""

    scale: ClassVar = 0.5
    ends: ClassVar = (-math.pi, 0.0)
    expensive: ClassVar = False

    def __init__(self, context: ObjectiveContext) -> None:
        x, y, z, w = context.wishes.near_pose[3:]
        self._target = pin.Quaternion(w, x, y, z).normalized().toRotationMatrix()

    def values(self, T_world_object: Array) -> Array:
        """(n,) at poses (n, 4, 4)."""
        apart = T_world_object[:, :3, :3] - self._target  # ‖R - S‖ = 2 √2 sin(angle / 2)
        chord = np.sqrt((apart * apart).sum(axis=(1, 2)) / 8.0)
        return np.asarray(-2.0 * np.arcsin(np.minimum(chord, 1.0)))

    def around(self, ranges: PoseRanges, rough: bool = False) -> tuple[Array, Array]:
        """(n,) each, by the angle that is left."""
        middle = self.values(ranges.T)
        return middle - ranges.turn, np.minimum(middle + ranges.turn, 0.0)


class High:
    """high: z of the middle of the side that the object stands on, metres."""

    scale: ClassVar = 0.1
    ends: ClassVar = (-math.inf, math.inf)
    expensive: ClassVar = False

    def __init__(self, context: ObjectiveContext) -> None:
        self._standing = SupportingFaces(context)
        self._size = float(np.linalg.norm(np.ptp(context.body.vertices, axis=0)))

    def values(self, T_world_object: Array) -> Array:
        """(n,) at poses (n, 4, 4)."""
        middle = self._standing.middles[self._standing.at(T_world_object).face]
        up = (T_world_object[:, 2, :3] * middle).sum(axis=1)
        return np.asarray(up + T_world_object[:, 2, 3])

    def around(self, ranges: PoseRanges, rough: bool = False) -> tuple[Array, Array]:
        """(n,) each; what it stands on may be away from its reference point, too, on a slope."""
        middle = self.values(ranges.T)
        off = ranges.rise + np.where(ranges.rise > 0.0, self._size, 0.0)
        return middle - off, middle + off


class Stance:
    """stance: the angle, in the direction that takes the least, by which the object may be tipped
    from how it stands before it falls, radians.

    With `support: polygon` over the hull of what is supported, else over all of v(f).
    """

    scale: ClassVar = 0.2
    ends: ClassVar = (-0.5 * math.pi, 0.5 * math.pi)

    def __init__(self, context: ObjectiveContext) -> None:
        self._standing = SupportingFaces(context)
        self._environment = context.environment
        self._tolerance = context.contact_tolerance
        self.expensive = context.support == "polygon"
        self._contacts: list[tuple[Array, pin.SE3]] = []
        rotations, heights, hulls = [], [], []
        for face in context.body.faces:
            # The face's frame, its origin below the centre of mass.
            over = face.over(context.body.center_of_mass)
            T = over.T_face_object
            rotations.append(T.rotation)
            heights.append(float(T.act(context.body.center_of_mass)[2]))
            feet = (face.vertices @ T.rotation.T + T.translation)[:, :2]
            # What of the object touches, where support decides.
            if self.expensive:
                feet = contact_points(context.body, over).points
                self._contacts.append((feet, T.inverse()))
            hulls.append(_inward_normals(feet))
        self._rotations, self._heights = np.array(rotations).reshape(-1, 3, 3), np.array(heights)
        self._hulls = padded_rows(hulls)  # (|F|, k, 3)

    def values(self, T_world_object: Array) -> Array:
        """(n,) at poses (n, 4, 4)."""
        stood = self._standing.at(T_world_object)
        # All of the side carries.
        if not self.expensive:
            return self._tips(stood.face, self._hulls[stood.face], T_world_object)
        result = np.empty(len(T_world_object))
        for n, T in enumerate(T_world_object):
            face, slope = int(stood.face[n]), self._standing.slopes[stood.slope[n]]
            # The contact points in the world, and which of them a surface carries.
            feet, inward = self._contacts[face]
            points = feet @ inward.rotation[:, :2].T + inward.translation
            placed = points @ T[:3, :3].T + T[:3, 3]
            support = self._environment.support_of(slope)
            carried = feet[support.supported(placed, self._tolerance)]
            # By how much it can be tipped over the hull of these.
            result[n] = self._tips(stood.face[n : n + 1], _inward_normals(carried)[None], T[None])[
                0
            ]
        return result

    def around(self, ranges: PoseRanges, rough: bool = False) -> tuple[Array, Array]:
        """(n,) each: at most what it is with all of the side supported; on a slope it depends on
        the turn by how much gravity is aside."""
        face = self._standing.at(ranges.T).face
        most = self._tips(face, self._hulls[face], ranges.T)
        return np.full(len(most), self.ends[0]), np.where(ranges.rise > 0.0, self.ends[1], most)

    def _tips(self, face: Index, edges: Array, T: Array) -> Array:
        """(n,) least angle over the edges (n, k, 3) of what carries it, at poses (n, 4, 4)."""
        # Up in the frame of the face; the angle of each edge, less gravity's lean over it.
        ups = np.einsum("nij,nj->ni", self._rotations[face], T[:, 2, :3])  # in the face's frame
        firm = np.arctan2(edges[..., 2], self._heights[face, None])
        lean = np.arctan2(np.einsum("nki,ni->nk", edges[..., :2], ups[:, :2]), ups[:, 2:])
        return np.asarray((firm - lean).min(axis=1))


def _inward_normals(points: Array) -> Array:
    """(k, 3) inward normal of each edge of the hull of (m, 2) points about the foot of the centre
    of mass, and how far inside that is; where they are in line it falls over any."""
    try:
        hull = ConvexHull(points).equations
    except (QhullError, ValueError):
        return np.array([[0.0, 0.0, -math.inf]])
    return np.asarray(-hull)
