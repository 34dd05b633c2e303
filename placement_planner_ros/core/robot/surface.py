"""A mesh of many triangles for coal, of which only what something comes near is laid out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import TypeAlias

import coal
import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.robot.geometry import triangle_geometry
from placement_planner_ros.core.types import Array, frozen_array

PIECE = 1024
"""Triangles in a piece, at most: coal's tree over so many takes some 7 ms, in which no other
thread of Python runs, and 0.5 MB."""

ROUNDING_M = 1e-9
"""Metres."""


class Surface:
    """Triangles in pieces, each of which becomes a tree of coal when something first comes near it.

    A tree over all of 200,000 triangles takes 1.4 s and 100 MB; a hand comes near a few pieces. A
    surface has the attributes that coal's shapes tell their place by.

    Attributes:
        corners: (t, 3, 3) metres.
        connected: (n, 3) of each connected part of it, points that are outermost in some direction,
            metres.
        aabb_local: the box around it.
        aabb_center, aabb_radius: (3,), metres, a ball around it.

    Args:
        first: (p + 1,) first triangle of each piece, and their number. Each is a part of space, as
            the leaves of a tree are.
    """

    def __init__(
        self, corners: Array, first: npt.NDArray[np.int64], connected: Sequence[Array]
    ) -> None:
        self.corners = frozen_array(corners, (-1, 3, 3))
        self.connected = tuple(connected)
        self._first = first
        points = self.corners.reshape(-1, 3)
        self._lower = np.minimum.reduceat(points, 3 * first[:-1])
        self._upper = np.maximum.reduceat(points, 3 * first[:-1])
        self._pieces: dict[int, coal.BVHModelOBBRSS] = {}
        low, high = self._lower.min(axis=0), self._upper.max(axis=0)
        self.aabb_local = coal.AABB(low, high)
        self.aabb_center = 0.5 * (low + high)
        away = points - self.aabb_center
        self.aabb_radius = float(np.sqrt((away * away).sum(axis=1).max()))

    def computeLocalAABB(self) -> None:
        """Nothing is left to do."""

    @property
    def boxes(self) -> Array:
        """(p, 8, 3) corners of a box around each piece, metres."""
        ends = np.stack([self._lower, self._upper])
        return np.stack([ends[list(c), :, range(3)].T for c in product((0, 1), repeat=3)], axis=1)

    def near(self, lower: Array, upper: Array) -> Iterator[coal.BVHModelOBBRSS]:
        """The pieces that may have a point in a box of these corners (3,)."""
        meet = ((self._lower <= upper) & (self._upper >= lower)).all(axis=1)
        return map(self.piece, np.flatnonzero(meet).tolist())

    def by_distance(self, lower: Array, upper: Array) -> Iterator[tuple[float, int]]:
        """For each piece a bound below its distance from that box, metres, and its number; the
        nearest first."""
        apart = np.maximum(np.maximum(self._lower - upper, lower - self._upper), 0.0)
        bounds = np.sqrt((apart * apart).sum(axis=1))
        order = np.argsort(bounds, kind="stable")
        return zip(bounds[order].tolist(), order.tolist(), strict=True)

    def piece(self, number: int) -> coal.BVHModelOBBRSS:
        """The piece of that number."""
        made = self._pieces.get(number)
        if made is None:
            corners = self.corners[self._first[number] : self._first[number + 1]]
            rows = np.arange(3 * len(corners)).reshape(-1, 3)
            made = self._pieces[number] = triangle_geometry(corners.reshape(-1, 3), rows)
        return made


Solid: TypeAlias = coal.CollisionGeometry | Surface
"""What coal can be asked about, at once or piece by piece."""


def meet(
    a: Solid,
    T_world_a: coal.Transform3s,
    b: Solid,
    T_world_b: coal.Transform3s,
    margin: float = 0.0,
) -> bool:
    """Whether two shapes, of which one at most is a surface, are closer than `margin` metres."""
    request = coal.CollisionRequest()
    request.security_margin = margin
    return any(
        coal.collide(x, T_world_a, y, T_world_b, request, coal.CollisionResult())
        for x, y in _pairs_near(a, T_world_a, b, T_world_b, margin)
    )


def contact(
    a: Solid, T_world_a: coal.Transform3s, b: Solid, T_world_b: coal.Transform3s
) -> Array | None:
    """(3,) a point at which the surfaces of two shapes meet; None where they do not."""
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    request.enable_contact = True
    for x, y in _pairs_near(a, T_world_a, b, T_world_b, 0.0):
        coal.collide(x, T_world_a, y, T_world_b, request, result)
        if result.numContacts():
            return np.array(result.getContact(0).pos)
    return None


def nearest(
    a: Solid, T_world_a: coal.Transform3s, b: Solid, T_world_b: coal.Transform3s
) -> coal.DistanceResult:
    """How far apart two shapes are, and where, of which one at most is a surface; of others than
    solids that overlap, `min_distance` need not say how deep."""
    if isinstance(b, Surface):
        other, at, to, T_to = b, T_world_b, a, T_world_a
    elif isinstance(a, Surface):
        other, at, to, T_to = a, T_world_a, b, T_world_b
    else:
        result = coal.DistanceResult()
        coal.distance(a, T_world_a, b, T_world_b, coal.DistanceRequest(), result)
        return result
    best: coal.DistanceResult | None = None
    for bound, number in other.by_distance(*_box_around(to, at.inverseTimes(T_to))):
        if best is not None and bound > max(best.min_distance, 0.0):
            break
        piece = other.piece(number)
        pair = (to, T_to, piece, at) if isinstance(b, Surface) else (piece, at, to, T_to)
        result = coal.DistanceResult()
        coal.distance(*pair, coal.DistanceRequest(), result)
        if best is None or result.min_distance < best.min_distance:
            best = result
    assert best is not None
    return best


def _pairs_near(
    a: Solid, T_world_a: coal.Transform3s, b: Solid, T_world_b: coal.Transform3s, margin: float
) -> Iterator[tuple[coal.CollisionGeometry, coal.CollisionGeometry]]:
    """Pairs of what coal knows, of which some are closer than `margin` if a and b are."""
    if isinstance(b, Surface):
        lower, upper = _box_around(a, T_world_b.inverseTimes(T_world_a))
        yield from ((a, piece) for piece in b.near(lower - margin, upper + margin))
    elif isinstance(a, Surface):
        lower, upper = _box_around(b, T_world_a.inverseTimes(T_world_b))
        yield from ((piece, b) for piece in a.near(lower - margin, upper + margin))
    else:
        yield a, b


def _box_around(shape: coal.CollisionGeometry, T: coal.Transform3s) -> tuple[Array, Array]:
    """Corners (3,) of a box around a shape at T."""
    shape.computeLocalAABB()
    box, R = shape.aabb_local, T.getRotation()
    middle = T.transform((box.min_ + box.max_) / 2)
    half = np.abs(R) @ ((box.max_ - box.min_) / 2) + ROUNDING_M
    return middle - half, middle + half
