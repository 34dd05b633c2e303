"""Overlap of two collision shapes, and its depth, on the triangles that the files hold."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property, lru_cache
from itertools import product

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.body.mesh_components import WELD_M, Components
from placement_planner_ros.core.robot.geometry import LinkCover
from placement_planner_ros.core.types import Array, frozen_array

MAX_PIECES = 32
"""Pieces of a mesh that are looked for inside another one, the largest of them."""

DEPTH_RESOLUTION_M = 5e-4
"""Metres that a depth is found to."""


def meet(
    a: coal.CollisionGeometry,
    T_world_a: coal.Transform3s,
    b: coal.CollisionGeometry,
    T_world_b: coal.Transform3s,
    margin: float = 0.0,
) -> bool:
    """Whether two shapes are closer than `margin` metres."""
    request = coal.CollisionRequest()
    request.security_margin = margin
    return bool(coal.collide(a, T_world_a, b, T_world_b, request, coal.CollisionResult()))


def contact(
    a: coal.CollisionGeometry,
    T_world_a: coal.Transform3s,
    b: coal.CollisionGeometry,
    T_world_b: coal.Transform3s,
) -> Array | None:
    """(3,) a point at which the surfaces of two shapes meet; None where they do not."""
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    request.enable_contact = True
    coal.collide(a, T_world_a, b, T_world_b, request, result)
    return np.array(result.getContact(0).pos) if result.numContacts() else None


def nearest(
    a: coal.CollisionGeometry,
    T_world_a: coal.Transform3s,
    b: coal.CollisionGeometry,
    T_world_b: coal.Transform3s,
) -> coal.DistanceResult:
    """How far apart two shapes are, and where; of others than solids that overlap, `min_distance`
    need not say how deep."""
    result = coal.DistanceResult()
    coal.distance(a, T_world_a, b, T_world_b, coal.DistanceRequest(), result)
    return result


class MeshSurface:
    """The triangles (t, 3, 3) of a mesh, metres.

    Made once for all that ask about the same mesh: of 100,000 triangles pieces take 0.1 s.

    Args:
        most: pieces of it, the largest.
    """

    def __init__(self, triangles: Array, most: int = MAX_PIECES) -> None:
        self.triangles = triangles
        self._most = most

    @cached_property
    def pieces(self) -> Array:
        """(n, 3) a point of each connected piece, the largest pieces first."""
        rows = np.arange(self.triangles.size // 3).reshape(-1, 3)
        made = Components.of(self.triangles.reshape(-1, 3), rows)
        _, first, size = np.unique(made.label, return_index=True, return_counts=True)
        return np.asarray(made.corners[first[np.argsort(-size, kind="stable")[: self._most]], 0])


class Overlaps:
    """Shapes asked pair by pair, such as those of one robot.

    A mesh is a surface to coal; what lies wholly inside of a closed one overlaps it all the same.

    Attributes:
        shapes: in the order of their numbers.
        centers, radii: (n, 3), (n,) balls around them, each in its own frame, metres.

    Args:
        surfaces: of each shape the mesh that it is, where it is one.
    """

    def __init__(
        self,
        shapes: Sequence[coal.CollisionGeometry],
        surfaces: Sequence[MeshSurface | None],
    ) -> None:
        self.shapes = list(shapes)
        for shape in self.shapes:
            shape.computeLocalAABB()
        self.centers = np.array([shape.aabb_center for shape in self.shapes]).reshape(-1, 3)
        self.radii = np.array([shape.aabb_radius for shape in self.shapes])
        self._surfaces = {i: each for i, each in enumerate(surfaces) if each is not None}
        self._corners: dict[int, Array] = {}

    def near(
        self, rows: npt.NDArray[np.int64], placements: list[pin.SE3], margin: float = 0.0
    ) -> Array:
        """Of which rows (n, 2 or more) the balls around both shapes come within `margin`, metres;
        others cannot overlap."""
        # Balls around both, where they are.
        at = np.array([T.act(c) for T, c in zip(placements, self.centers, strict=True)])
        at = at.reshape(-1, 3)
        first, second = rows[:, 0], rows[:, 1]
        apart = np.linalg.norm(at[first] - at[second], axis=1)
        reach = (self.radii[first] + self.radii[second]) * (1.0 + 1e-9) + 1e-9 + margin
        return np.asarray(apart <= reach)

    @classmethod
    def of(cls, geometry: pin.GeometryModel, covers: tuple[LinkCover | None, ...]) -> Overlaps:
        """Of a robot's shapes and their covers."""
        shapes = [thing.geometry for thing in geometry.geometryObjects]
        return cls(shapes, surfaces=link_surfaces(covers))

    def meet(self, i: int, j: int, T_i: pin.SE3, T_j: pin.SE3, margin: float = 0.0) -> bool:
        """Whether shapes i and j overlap where they are placed, or are nearer than `margin`, m."""
        touch = meet(self.shapes[i], _for_coal(T_i), self.shapes[j], _for_coal(T_j), margin)
        return touch or self.nested(i, j, T_i, T_j)

    def depth(
        self,
        i: int,
        j: int,
        T_i: pin.SE3,
        T_j: pin.SE3,
        resolution: float = DEPTH_RESOLUTION_M,
        beyond: float = 0.0,
    ) -> float:
        """Metres by which one must be moved that they do not overlap any more.

        Not the very least way: the shortest of 26 directions.

        Args:
            resolution: metres that it is found to.
            beyond: metres; what is no deeper counts as zero, which is found sooner.
        """
        if not self.meet(i, j, T_i, T_j):
            return 0.0
        # Between how far it still overlaps and how far it does not.
        near, far = self._freed(i, j, T_i, T_j, resolution, beyond=beyond)
        return 0.0 if near < beyond else far

    def _freed(
        self,
        i: int,
        j: int,
        T_i: pin.SE3,
        T_j: pin.SE3,
        resolution: float,
        beyond: float = 0.0,
    ) -> tuple[float, float]:
        """How far, metres, j can be moved and still meets i in whichever of the directions it goes;
        and how far that it does not in one of them.

        All directions are tried step by step, as what is hollow may be free after a short way and
        meet its other side after a longer one. That shapes meet is found many times as quickly as
        that they are barely apart.

        Args:
            resolution: both are no further from each other than these metres.
            beyond: metres; of what is free by then nothing more is found out than that.
        """
        # Directions, and how far is enough in each.
        ways, bounds = self._ways_apart(i, j, T_i, T_j)

        def free(by: float) -> bool:
            moved = _moved_along(T_j, by * ways)
            return bounds[0] <= by or any(not self.meet(i, j, T_i, at) for at in moved)

        # Further and further until one of them is free, then in between.
        near, far = 0.0, beyond or DEPTH_RESOLUTION_M
        while not free(far):
            near, far = far, 1.5 * far
        if near == 0.0 and beyond > 0.0:
            return near, far
        # Halved until the resolution.
        far = max(min(far, float(bounds[0])), WELD_M)
        while far - near > resolution:
            middle = 0.5 * (near + far)
            near, far = (near, middle) if free(middle) else (middle, far)
        return near, far

    def _ways_apart(self, i: int, j: int, T_i: pin.SE3, T_j: pin.SE3) -> tuple[Array, Array]:
        """The directions (26, 3) and how far j must be moved in each for their hulls to be apart,
        metres, which is no less than how far the shapes must; the shortest way first."""
        # How far each hull reaches along them.
        ways = _cube_directions()
        reach_i = (self._outermost(i) @ (ways @ T_i.rotation).T).max(axis=0)
        reach_j = (self._outermost(j) @ (ways @ T_j.rotation).T).min(axis=0)
        bounds = reach_i - reach_j + ways @ (T_i.translation - T_j.translation)
        order = np.argsort(bounds, kind="stable")
        return ways[order], bounds[order] + WELD_M

    def _outermost(self, i: int) -> Array:
        """(n, 3) points whose hull holds a shape."""
        if i not in self._corners:
            self._corners[i] = corners_of(self.shapes[i])
        return self._corners[i]

    def place(self, i: int, j: int, T_i: pin.SE3, T_j: pin.SE3) -> Array:
        """(3,) a point at which two shapes that overlap do so."""
        found = contact(self.shapes[i], _for_coal(T_i), self.shapes[j], _for_coal(T_j))
        if found is not None:
            return found
        smaller, T = (i, T_i) if self.radii[i] < self.radii[j] else (j, T_j)
        return np.asarray(T.act(self.centers[smaller]))

    def nested(self, i: int, j: int, T_i: pin.SE3, T_j: pin.SE3) -> bool:
        """Whether one holds a piece of the other, their surfaces being apart."""
        return self._holds(i, j, T_i.actInv(T_j)) or self._holds(j, i, T_j.actInv(T_i))

    def _holds(self, outer: int, inner: int, T_outer_inner: pin.SE3) -> bool:
        if not is_mesh(self.shapes[outer]):
            return False  # a solid: coal has answered
        # A piece whose surface meets none is inside with any of its points.
        box = self.shapes[outer].aabb_local
        pieces = (
            self._surfaces[inner].pieces if is_mesh(self.shapes[inner]) else self.centers[inner]
        )
        points = pieces.reshape(-1, 3) @ T_outer_inner.rotation.T + T_outer_inner.translation
        within = ((points >= box.min_) & (points <= box.max_)).all(axis=1)
        return any(
            winding_number(point, self._surfaces[outer].triangles) > 0.5 for point in points[within]
        )


@lru_cache(maxsize=8)
def link_surfaces(covers: tuple[LinkCover | None, ...]) -> tuple[MeshSurface | None, ...]:
    """Of the mesh of each cover: one for geometries that share it, and for copies of a robot."""
    made = {
        cover: MeshSurface(frozen_array(cover.mesh.vertices[cover.mesh.triangles]))
        for cover in dict.fromkeys(covers)
        if cover is not None
    }
    return tuple(None if cover is None else made[cover] for cover in covers)


def is_mesh(shape: coal.CollisionGeometry) -> bool:
    """Whether it is a surface, which to coal has no inside."""
    return isinstance(shape, coal.BVHModelBase)


def corners_of(shape: coal.CollisionGeometry) -> Array:
    """(n, 3) points whose hull holds a shape, metres."""
    if isinstance(shape, coal.BVHModelBase):
        return np.array(shape.vertices()).reshape(-1, 3)
    if isinstance(shape, coal.ConvexBase):
        return np.array(shape.points()).reshape(-1, 3)
    box = shape.aabb_local
    return np.array(list(product(*zip(box.min_, box.max_, strict=True))))


def _for_coal(T: pin.SE3) -> coal.Transform3s:
    return coal.Transform3s(T.rotation, T.translation)


def winding_number(point: Array, triangles: Array) -> float:
    """How often a surface (t, 3, 3) goes around a point (3,): 0 outside, 1 inside of a closed one,
    of an open one the share of the view that it covers; without its sign."""
    # The solid angle of each triangle, added up.
    a, b, c = (triangles - point).transpose(1, 0, 2)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    triple = _dot_products(a, np.cross(b, c))
    dots = _dot_products(a, b) * lc + _dot_products(b, c) * la + _dot_products(c, a) * lb
    return abs(float(np.arctan2(triple, la * lb * lc + dots).sum())) / (2.0 * np.pi)


def _dot_products(u: Array, v: Array) -> Array:
    """(n,) products of vectors (n, 3)."""
    return np.asarray(np.einsum("ij,ij->i", u, v))


def _moved_along(T: pin.SE3, ways: Array) -> Iterator[pin.SE3]:
    """A pose moved along each of some ways (n, 3), metres."""
    return (pin.SE3(T.rotation, T.translation + way) for way in ways)


def _cube_directions() -> Array:
    """(26, 3) unit vectors to the faces, edges and corners of a cube."""
    grid = np.array(np.meshgrid(*([-1.0, 0.0, 1.0],) * 3)).reshape(3, -1).T
    grid = grid[np.abs(grid).sum(axis=1) > 0.0]
    return np.asarray(grid / np.linalg.norm(grid, axis=1, keepdims=True))
