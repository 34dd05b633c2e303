"""Trees of spheres that cover a convex set, from coarse to fine.

A set is cut in halves across its longest extent until the ball around each piece sticks out of the
set by no more than the stated excess; as the pieces make up the whole set, so do their balls cover
it, inside included.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.spatial import ConvexHull

from placement_planner_ros.core.collision.mesh_distances import SolidSurface
from placement_planner_ros.core.collision.meshes import mesh_arrays
from placement_planner_ros.core.collision.shapes import ConvexSet, Shape
from placement_planner_ros.core.disk_cache import code_digest, digest_of, recalled_result
from placement_planner_ros.core.types import Array, frozen_array
from placement_planner_ros.core.weak_cache import weak_lru_cache

_PADDING_M = 1e-9
_MAX_TREE_DEPTH = 10
_QUICK_VERTICES = 32
"""Vertices of a shape up to which its spheres are made as quickly as they are read."""


@dataclass(frozen=True, slots=True, eq=False)
class SphereTree:
    """Spheres in preorder: each covers what the spheres below it cover.

    Attributes:
        centers: (n, 3) in the shape's frame, metres.
        radii: (n,) metres.
        inner: (n,) radius of a ball around the centre inside of the shape; -inf where none is
            known to be.
        skip: (n,) the next sphere not below this one.
        leaf: (n,) whether there are none below.
        excess: a bound on how far any leaf sticks out of the set, metres.
    """

    centers: Array
    radii: Array
    inner: Array
    skip: npt.NDArray[np.int64]
    leaf: npt.NDArray[np.bool_]
    excess: float


@weak_lru_cache("shape", maxsize=8)
def sphere_trees(shape: Shape, excess: float) -> tuple[SphereTree, ...]:
    """Cover each set of a shape; what takes long is kept on disk.

    Args:
        shape: what to cover.
        excess: stop splitting where a sphere sticks out of its set by at most this, metres.
    """

    def make() -> tuple[SphereTree, ...]:
        return tuple(_one_sphere_tree(shape, convex, excess) for convex in shape.sets)

    # Few vertices: made at once, others from disk.
    if shape.mesh is None and sum(len(convex.vertices) for convex in shape.sets) <= _QUICK_VERTICES:
        return make()
    sets = tuple((s.vertices, s.radius) for s in shape.sets)
    key = digest_of(code_digest(__name__), excess, shape.mesh and shape.mesh.digest, sets)
    return recalled_result("sphere trees", key, make)


def _one_sphere_tree(shape: Shape, convex: ConvexSet, excess: float) -> SphereTree:
    volume = len(convex.offsets) > 0
    # Spheres around the convex set.
    tree = _cover_solid(convex.vertices.tobytes(), volume, convex.radius, excess)
    if shape.mesh is None:
        return tree
    # Balls of a cover's spheres that lie inside the mesh itself, as far as that is closed.
    away, _ = SolidSurface(mesh_arrays([shape.mesh])).distances(tree.centers, np.inf)
    inner = np.where(away < 0.0, -away - _PADDING_M, -np.inf)
    return replace(tree, inner=frozen_array(inner))


class _TreeBuilder:
    def __init__(self) -> None:
        self.spheres: list[tuple[float, float, float, float, float]] = []
        self.leaves: list[bool] = []
        self.skip: list[int] = []
        self.excess = 0.0

    def add(self, center: Array, radius: float, inner: float = -math.inf) -> int:
        self.spheres.append((*center.tolist(), radius, inner))
        self.leaves.append(False)
        self.skip.append(0)
        return len(self.skip) - 1

    def close(self, node: int) -> None:
        self.skip[node] = len(self.skip)

    def tree(self) -> SphereTree:
        spheres = np.array(self.spheres)
        skip = np.array(self.skip, dtype=np.int64)
        leaf = np.array(self.leaves)
        for array in (skip, leaf):
            array.setflags(write=False)
        return SphereTree(
            frozen_array(spheres[:, :3]),
            frozen_array(spheres[:, 3]),
            frozen_array(spheres[:, 4]),
            skip,
            leaf,
            self.excess,
        )


@functools.lru_cache(maxsize=4096)
def _cover_solid(vertices: bytes, volume: bool, radius: float, excess: float) -> SphereTree:
    points = np.frombuffer(vertices).reshape(-1, 3).copy()
    # Facets and surface of the hull, or of a segment.
    if volume:
        hull = ConvexHull(points)
        facets, surface = hull.equations, points[hull.simplices]
    else:  # a point or the axis of a capsule
        facets, surface = np.zeros((1, 4)), points[[[0, 0, len(points) - 1]]]
    builder = _TreeBuilder()

    def split(piece: Array, depth: int) -> None:
        # The centre is a mean of the piece's corners, so the set holds it.
        corners = _distinct_corners(piece)
        center, ball = bounding_sphere(corners)
        inside = max(0.0, float(np.min(-facets[:, :3] @ center - facets[:, 3])))
        node = builder.add(center, ball + radius + _PADDING_M, inside + radius - _PADDING_M)
        # A leaf where the sphere sticks out little, else both halves.
        sticks_out = ball - inside
        if sticks_out <= excess or depth == _MAX_TREE_DEPTH:
            builder.leaves[node] = True
            builder.excess = max(builder.excess, sticks_out)
        else:
            for half in _cut_halves(piece, corners):
                split(half, depth + 1)
        builder.close(node)

    split(np.ascontiguousarray(surface), 0)
    return builder.tree()


@njit(cache=True, nogil=True)
def _distinct_corners(surface: Array) -> Array:
    """The corners (m, 3) of triangles (k, 3, 3), each once."""
    points = surface.reshape(-1, 3)
    kept = np.empty(points.shape)
    count = 0
    for i in range(len(points)):
        # A point that is there already, within the padding.
        known = False
        for j in range(count):
            if (
                abs(kept[j, 0] - points[i, 0]) < _PADDING_M
                and abs(kept[j, 1] - points[i, 1]) < _PADDING_M
                and abs(kept[j, 2] - points[i, 2]) < _PADDING_M
            ):
                known = True
                break
        if not known:
            kept[count] = points[i]
            count += 1
    return kept[:count].copy()


@njit(cache=True, nogil=True)
def _cut_halves(surface: Array, corners: Array) -> tuple[Array, Array]:
    """Cut a polytope across its longest extent: its surface (k, 3, 3), of `corners` (m, 3)."""
    # The mean of the corners, and how they spread about it.
    mean = np.zeros(3)
    for i in range(len(corners)):
        mean += corners[i]
    mean /= len(corners)
    spread = np.zeros((3, 3))
    for i in range(len(corners)):
        for j in range(3):
            for k in range(3):
                spread[j, k] += (corners[i, j] - mean[j]) * (corners[i, k] - mean[k])
    # The direction in which they spread most, by power iteration.
    nx, ny, nz = 0.61, 0.53, 0.59
    for _ in range(40):
        x = spread[0, 0] * nx + spread[0, 1] * ny + spread[0, 2] * nz
        y = spread[1, 0] * nx + spread[1, 1] * ny + spread[1, 2] * nz
        z = spread[2, 0] * nx + spread[2, 1] * ny + spread[2, 2] * nz
        length = math.sqrt(x * x + y * y + z * z) + 1e-300
        nx, ny, nz = x / length, y / length, z / length
    # Heights of all corners along it, from the middle of their span.
    points = surface.reshape(-1, 3)
    low, high = np.inf, -np.inf
    heights = np.empty(len(points))
    for i in range(len(points)):
        heights[i] = nx * points[i, 0] + ny * points[i, 1] + nz * points[i, 2]
        low, high = min(low, heights[i]), max(high, heights[i])
    heights -= 0.5 * (low + high)
    # What lies below the middle, and what lies above.
    return _lower_part(surface, heights), _lower_part(surface, -heights)


@njit(cache=True, nogil=True)
def _lower_part(surface: Array, heights: Array) -> Array:
    """The surface (., 3, 3) of that part of a convex polytope where heights are not above 0.

    Args:
        surface: (k, 3, 3) triangles of the polytope.
        heights: (3 k,) of their corners.
    """
    # Room for what is kept of each triangle, and for the rim of the cut.
    kept = np.empty((3 * len(surface), 3, 3))
    count = 0
    polygon = np.empty((4, 3))
    cut = np.empty((2, 3))
    fan = np.empty(3)
    closing = False
    for t in range(len(surface)):
        # Walk round the triangle's sides.
        size = crossings = 0
        for v in range(3):
            w = (v + 1) % 3
            a, b = heights[3 * t + v], heights[3 * t + w]
            # A corner on this side of the plane stays.
            if a <= 0.0:
                polygon[size] = surface[t, v]
                size += 1
            # A side that crosses the plane is cut where it does.
            if (a < 0.0 < b) or (b < 0.0 < a):
                polygon[size] = surface[t, v] + a / (a - b) * (surface[t, w] - surface[t, v])
                cut[crossings] = polygon[size]
                size += 1
                crossings += 1
            elif a == 0.0 and crossings < 2:
                cut[crossings] = surface[t, v]
                crossings += 1
        if size == 0:
            continue
        # The polygon that is left, as a fan of triangles; a single point or side as a flat one.
        for v in range(2, max(size, 3)):
            kept[count, 0] = polygon[0]
            kept[count, 1] = polygon[min(v - 1, size - 1)]
            kept[count, 2] = polygon[min(v, size - 1)]
            count += 1
        # Where the plane crosses the surface is the rim of the cut: a fan from any of its points.
        if crossings == 2:
            if not closing:
                fan[:] = cut[0]
                closing = True
            kept[count, 0] = fan
            kept[count, 1] = cut[0]
            kept[count, 2] = cut[1]
            count += 1
    return kept[:count].copy()


@njit(cache=True, nogil=True)
def bounding_sphere(points: Array) -> tuple[Array, float]:
    """Centre (3,) and radius of a ball around (n, 3) points, within 1 % of the smallest.

    Bădoiu and Clarkson's core-set iteration: a step of 1/(i+1) towards the farthest point.
    """
    # Start from the mean of the points.
    center = np.zeros(3)
    count = points.shape[0]
    for i in range(count):
        center += points[i]
    center /= count
    best = center.copy()
    smallest = np.inf
    for step in range(200):
        # The point that is farthest from the centre.
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
        # Keep the best centre so far.
        if square < smallest:
            smallest = square
            best[:] = center
        # A step towards that point.
        for j in range(3):
            center[j] += (points[farthest, j] - center[j]) / (step + 2)
    return best, np.sqrt(smallest)
