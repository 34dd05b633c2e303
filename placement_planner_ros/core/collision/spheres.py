"""Trees of spheres that cover a collision shape, from coarse to fine.

A convex set is cut in halves across its longest extent until the ball around each piece sticks out
of the set by no more than the stated excess; as the pieces make up the whole set, so do their balls
cover it, inside included. The triangles of a surface are cut small and split by their centres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial import ConvexHull

from placement_planner_ros.core.collision.shapes import ConvexSet, Shape
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.types import Array, frozen_array

_PAD = 1e-9
_MAX_DEPTH = 9
_TRIANGLES_PER_LEAF = 4


@dataclass(frozen=True, slots=True, eq=False)
class SphereTree:
    """Spheres in preorder: each covers what the spheres below it cover.

    Attributes:
        centers: (n, 3) in the shape's frame, metres.
        radii: (n,) metres.
        inner: (n,) radius of a ball around the centre inside of the shape; -inf where the shape is
            a surface, or larger than what it stands for.
        skip: (n,) the next sphere not below this one.
        first, last: (n,) range of `sets` that a leaf covers pieces of; (-1, -1) inside the tree.
        sets: what the leaves cover, in their order (a mesh's triangles are cut and sorted).
        excess: a bound on how far any leaf sticks out of the shape, metres.
    """

    centers: Array
    radii: Array
    inner: Array
    skip: npt.NDArray[np.int64]
    first: npt.NDArray[np.int64]
    last: npt.NDArray[np.int64]
    sets: tuple[ConvexSet, ...]
    excess: float


def sphere_tree(shape: Shape, excess: float) -> SphereTree:
    """Cover a shape.

    Args:
        shape: what to cover.
        excess: stop splitting where a sphere sticks out of the shape by at most this, metres.
    """
    if shape.solid:
        only = shape.sets[0]
        volume = len(only.offsets) > 0
        nodes = _cover_solid(only.vertices.tobytes(), volume, only.radius, excess)
        sets = shape.sets
        solid = only.exact
    else:
        corners = np.array([s.vertices for s in shape.sets])
        nodes, pieces = _cover_surface(corners.tobytes(), excess)
        none = np.zeros((0, 3)), np.zeros(0)
        sets = tuple(ConvexSet(piece, *none) for piece in pieces)
        solid = False
    centers, radii, inner, skip, first, last, reached = nodes
    if not solid:
        inner = frozen_array(np.full(len(radii), -np.inf))
    return SphereTree(centers, radii, inner, skip, first, last, sets, reached)


_Nodes = tuple[
    Array, Array, Array, npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64], float
]


class _Builder:
    def __init__(self) -> None:
        self.spheres: list[tuple[float, float, float, float, float]] = []
        self.ranges: list[tuple[int, int]] = []
        self.skip: list[int] = []
        self.excess = 0.0

    def add(self, center: Array, radius: float, inner: float = -math.inf) -> int:
        self.spheres.append((*center.tolist(), radius, inner))
        self.ranges.append((-1, -1))
        self.skip.append(0)
        return len(self.skip) - 1

    def close(self, node: int) -> None:
        self.skip[node] = len(self.skip)

    def nodes(self) -> _Nodes:
        spheres = np.array(self.spheres)
        ranges = np.array(self.ranges, dtype=np.int64)
        skip = np.array(self.skip, dtype=np.int64)
        first, last = ranges[:, 0].copy(), ranges[:, 1].copy()
        for array in (skip, first, last):
            array.setflags(write=False)
        return (
            frozen_array(spheres[:, :3]),
            frozen_array(spheres[:, 3]),
            frozen_array(spheres[:, 4]),
            skip,
            first,
            last,
            self.excess,
        )


@lru_cache(maxsize=1024)
def _cover_solid(vertices: bytes, volume: bool, radius: float, excess: float) -> _Nodes:
    corners = np.frombuffer(vertices).reshape(-1, 3).copy()
    facets = ConvexHull(corners).equations if volume else np.zeros((1, 4))
    builder = _Builder()

    def split(piece: Array, depth: int) -> None:
        # The centre is a mean of the piece's corners, so the set holds it.
        center, ball = bounding_sphere(piece)
        inside = max(0.0, float(np.min(-facets[:, :3] @ center - facets[:, 3])))
        node = builder.add(center, ball + radius + _PAD, inside + radius - _PAD)
        sticks_out = ball - inside
        if sticks_out <= excess or depth == _MAX_DEPTH:
            builder.ranges[node] = (0, 1)
            builder.excess = max(builder.excess, sticks_out)
        else:
            for half in _halves(piece):
                split(half, depth + 1)
        builder.close(node)

    split(corners, 0)
    return builder.nodes()


@lru_cache(maxsize=64)
def _cover_surface(corners: bytes, excess: float) -> tuple[_Nodes, Array]:
    triangles = np.frombuffer(corners).reshape(-1, 3, 3)
    fine, faces = trimesh.remesh.subdivide_to_size(
        triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), 2 * excess, 30
    )
    pieces = np.asarray(fine)[np.asarray(faces)]
    centroids = pieces.mean(axis=1)
    builder = _Builder()
    order: list[npt.NDArray[np.int64]] = []
    placed = 0

    def split(rows: npt.NDArray[np.int64]) -> None:
        nonlocal placed
        center, ball = bounding_sphere(np.ascontiguousarray(pieces[rows].reshape(-1, 3)))
        node = builder.add(center, ball + _PAD)
        if len(rows) <= _TRIANGLES_PER_LEAF:
            order.append(rows)
            builder.ranges[node] = (placed, placed + len(rows))
            builder.excess = max(builder.excess, ball)
            placed += len(rows)
        else:
            spread = centroids[rows]
            axis = int(np.argmax(np.ptp(spread, axis=0)))
            ranked = rows[np.argsort(spread[:, axis], kind="stable")]
            split(ranked[: len(rows) // 2])
            split(ranked[len(rows) // 2 :])
        builder.close(node)

    split(np.arange(len(pieces)))
    return builder.nodes(), pieces[np.concatenate(order)]


def _halves(piece: Array) -> tuple[Array, Array]:
    """Cut the hull of (m, 3) vertices across its longest principal extent."""
    centered = piece - piece.mean(axis=0)
    axis = np.linalg.svd(centered, full_matrices=False)[2][0]
    height = centered @ axis
    height -= (height.max() + height.min()) / 2
    below, above = height <= 0.0, height > 0.0
    low, high = height[below][:, None], height[above][None, :]
    share = (low / (low - high))[..., None]
    cut = (piece[below][:, None] * (1 - share) + piece[above][None, :] * share).reshape(-1, 3)
    return _hull_vertices(np.vstack([piece[below], cut])), _hull_vertices(
        np.vstack([piece[above], cut])
    )


def _hull_vertices(points: Array) -> Array:
    if len(points) <= 8 or np.linalg.matrix_rank(points - points[0], tol=1e-7) < 3:
        return np.ascontiguousarray(points)
    return np.ascontiguousarray(points[ConvexHull(points, qhull_options="QJ").vertices])


@kernel()
def bounding_sphere(points: Array) -> tuple[Array, float]:
    """Centre (3,) and radius of a ball around (n, 3) points, within 1 % of the smallest.

    Bădoiu and Clarkson's core-set iteration: a step of 1/(i+1) towards the farthest point.
    """
    center = np.zeros(3)
    count = points.shape[0]
    for i in range(count):
        center += points[i]
    center /= count
    best = center.copy()
    smallest = np.inf
    for step in range(200):
        farthest = 0
        square = -1.0
        for i in range(count):
            dx = points[i, 0] - center[0]
            dy = points[i, 1] - center[1]
            dz = points[i, 2] - center[2]
            d = dx * dx + dy * dy + dz * dz
            if d > square:
                square = d
                farthest = i
        if square < smallest:
            smallest = square
            best[:] = center
        for j in range(3):
            center[j] += (points[farthest, j] - center[j]) / (step + 2)
    return best, np.sqrt(smallest)
