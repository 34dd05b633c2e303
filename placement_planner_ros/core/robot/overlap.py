"""Overlap of two collision shapes, and its depth, on the triangles that the files hold."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING

import coal
import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.covered_mesh import CoveredMesh
from placement_planner_ros.core.body.mesh import MAX_PIECES
from placement_planner_ros.core.body.mesh_components import Components
from placement_planner_ros.core.types import ROUNDING, Array, Index, Mask
from placement_planner_ros.core.weak_cache import weak_lru_cache

if TYPE_CHECKING:
    from placement_planner_ros.core.robot.model import Robot


_CUBE = np.array([way for way in product((-1.0, 0.0, 1.0), repeat=3) if any(way)])
_DIRECTIONS = _CUBE / np.linalg.norm(_CUBE, axis=1)[:, None]
"""(26, 3) unit vectors to the faces, edges and corners of a cube."""


def meet(
    a: coal.CollisionGeometry,
    T_world_a: pin.SE3,
    b: coal.CollisionGeometry,
    T_world_b: pin.SE3,
    margin: float = 0.0,
) -> bool:
    """Whether two shapes are closer than `margin` metres."""
    request = coal.CollisionRequest()
    request.security_margin = margin
    return bool(coal.collide(a, T_world_a, b, T_world_b, request, coal.CollisionResult()))


class Overlaps:
    """A robot's shapes, and others with them, asked pair by pair.

    A mesh is a surface to coal; what lies wholly inside of a closed one overlaps it all the same.

    Attributes:
        shapes: in the order of their numbers.
        centers, radii: (n, 3), (n,) balls around them, each in its own frame, metres.

    Args:
        robot: whose shapes come first.
        more: others, each with the mesh that it is, where it is one.
    """

    def __init__(
        self, robot: Robot, more: Sequence[tuple[coal.CollisionGeometry, CoveredMesh | None]] = ()
    ) -> None:
        links = [thing.geometry for thing in robot.geometry.geometryObjects]
        self.shapes = [*links, *(shape for shape, _ in more)]
        for shape in self.shapes:
            shape.computeLocalAABB()
        self.centers = np.array([shape.aabb_center for shape in self.shapes]).reshape(-1, 3)
        self.radii = np.array([shape.aabb_radius for shape in self.shapes])
        self._meshes = [*robot.meshes, *(mesh for _, mesh in more)]

    def near(self, rows: Index, placements: list[pin.SE3], margin: float = 0.0) -> Mask:
        """Of which rows (n, 2) the balls around both shapes come within `margin`, metres; others
        cannot overlap."""
        # Balls around both, where they are.
        at = np.array([T.act(c) for T, c in zip(placements, self.centers, strict=True)])
        first, second = rows.T
        apart = np.linalg.norm(at.reshape(-1, 3)[first] - at.reshape(-1, 3)[second], axis=1)
        reach = self.radii[first] + self.radii[second] + margin + ROUNDING
        return np.asarray(apart <= reach)

    def meet(self, i: int, j: int, T_i: pin.SE3, T_j: pin.SE3, margin: float = 0.0) -> bool:
        """Whether shapes i and j overlap where they are placed, or are nearer than `margin`, m."""
        return (
            meet(self.shapes[i], T_i, self.shapes[j], T_j, margin)
            or self._holds(i, j, T_i.actInv(T_j))
            or self._holds(j, i, T_j.actInv(T_i))
        )

    def depth(self, i: int, j: int, T_i: pin.SE3, T_j: pin.SE3, beyond: float = 0.0) -> float:
        """Metres by which one must be moved that they do not overlap any more.

        Where one is a mesh not the very least way: the shortest of 26 directions, up to a twentieth
        longer than it is. All are tried step by step, as what is hollow may be free after a short
        way and meet its other side after a longer one.

        Args:
            beyond: metres; what is no deeper counts as zero, which is found sooner.
        """
        if not self.meet(i, j, T_i, T_j):
            return 0.0
        # Of two solids coal tells it.
        if self._meshes[i] is None and self._meshes[j] is None:
            request, result = coal.DistanceRequest(), coal.DistanceResult()
            by = -coal.distance(self.shapes[i], T_i, self.shapes[j], T_j, request, result)
            return by if by > beyond else 0.0
        # Away from the other's middle first.
        away = T_j.act(self.centers[j]) - T_i.act(self.centers[i])
        ways = _DIRECTIONS[np.argsort(-_DIRECTIONS @ away, kind="stable")]

        def free(by: float) -> bool:
            moved = (pin.SE3(T_j.rotation, T_j.translation + by * way) for way in ways)
            return any(not self.meet(i, j, T_i, at) for at in moved)

        # Further and further until one of them is free, then halved in between.
        near, far = 0.0, beyond or ROUNDING
        while not free(far):
            near, far = far, 2.0 * far
        if near < beyond:
            return 0.0
        while near < 0.95 * far and far > ROUNDING:
            middle = 0.5 * (near + far)
            near, far = (near, middle) if free(middle) else (middle, far)
        return far

    def _holds(self, outer: int, inner: int, T_outer_inner: pin.SE3) -> bool:
        """Whether a mesh holds a piece of the other shape, whose surface does not meet its own."""
        mesh, other = self._meshes[outer], self._meshes[inner]
        if mesh is None:
            return False  # a solid: coal has answered
        # A piece whose surface meets none is inside with any of its points.
        box = self.shapes[outer].aabb_local
        pieces = self.centers[inner][None] if other is None else _piece_points(other)
        points = pieces @ T_outer_inner.rotation.T + T_outer_inner.translation
        within = points[((points >= box.min_) & (points <= box.max_)).all(axis=1)]
        return any(_goes_around(mesh, point) for point in within)


@weak_lru_cache("mesh", maxsize=1)
def _piece_points(mesh: CoveredMesh) -> Array:
    """(n, 3) a point of each connected piece, the largest pieces first: no more of them than an
    object may have."""
    pieces = Components.of(mesh.vertices, mesh.triangles)
    _, first, size = np.unique(pieces.label, return_index=True, return_counts=True)
    return np.asarray(pieces.corners[first[np.argsort(-size, kind="stable")[:MAX_PIECES]], 0])


def _goes_around(mesh: CoveredMesh, point: Array) -> bool:
    """Whether a mesh goes around a point (3,): all of it where closed, by more than half the view
    where it is open."""
    # The solid angle of each triangle, added up.
    a, b, c = mesh.vertices[mesh.triangles.T] - point
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    triple = (a * np.cross(b, c)).sum(axis=1)
    dots = (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
    return abs(float(np.arctan2(triple, la * lb * lc + dots).sum())) > np.pi
