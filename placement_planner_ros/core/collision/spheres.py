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
from scipy.spatial import ConvexHull

from placement_planner_ros.core.collision.mesh_distances import SolidSurface
from placement_planner_ros.core.collision.meshes import mesh_arrays
from placement_planner_ros.core.collision.separation import BOUND_TOLERANCE_M
from placement_planner_ros.core.collision.shapes import ConvexSet, Shape
from placement_planner_ros.core.disk_cache import code_digest, digest_of, recalled_result
from placement_planner_ros.core.types import Array, frozen_array
from placement_planner_ros.core.weak_cache import weak_lru_cache

_MAX_TREE_DEPTH = 10


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
    """

    centers: Array
    radii: Array
    inner: Array
    skip: npt.NDArray[np.int64]
    leaf: npt.NDArray[np.bool_]


@weak_lru_cache("shape", maxsize=8)
def sphere_trees(shape: Shape, excess: float) -> tuple[SphereTree, ...]:
    """Cover each set of a shape, and keep that on disk.

    Args:
        shape: what to cover.
        excess: stop splitting where a sphere sticks out of its set by at most this, metres.
    """

    def make() -> tuple[SphereTree, ...]:
        return tuple(_one_sphere_tree(shape, convex, excess) for convex in shape.sets)

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
    inner = np.where(away < 0.0, -away - BOUND_TOLERANCE_M, -np.inf)
    return replace(tree, inner=frozen_array(inner))


def _tree_of(rows: list[tuple[float, ...]]) -> SphereTree:
    """Of rows of centre, radius, inner radius, next sphere not below, and whether it is a leaf."""
    table = np.array(rows)
    skip, leaf = table[:, 5].astype(np.int64), table[:, 6] > 0.0
    for array in (skip, leaf):
        array.setflags(write=False)
    spheres = frozen_array(table[:, :3]), frozen_array(table[:, 3]), frozen_array(table[:, 4])
    return SphereTree(*spheres, skip, leaf)


@functools.lru_cache(maxsize=4096)
def _cover_solid(vertices: bytes, volume: bool, radius: float, excess: float) -> SphereTree:
    points = np.frombuffer(vertices).reshape(-1, 3).copy()
    # Facets and edges of the hull, or of a segment.
    if volume:
        hull = ConvexHull(points)
        facets, sides = hull.equations, hull.simplices[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        edges = points[np.unique(np.sort(sides, axis=1), axis=0)]
    else:  # a point or the axis of a capsule
        facets, edges = np.zeros((1, 4)), points[[[0, len(points) - 1]]]
    rows: list[tuple[float, ...]] = []

    def split(piece: Array, depth: int) -> None:
        # The centre is a mean of the piece's corners, so the set holds it.
        corners = np.unique(piece.reshape(-1, 3), axis=0)
        center, ball = bounding_sphere(corners)
        inside = max(0.0, float(np.min(-facets[:, :3] @ center - facets[:, 3])))
        leaf = ball - inside <= excess or depth == _MAX_TREE_DEPTH
        row = len(rows)
        rows.append(())
        # A leaf where the sphere sticks out little, else both halves.
        if not leaf:
            # Cut in the middle of the longest extent.
            along = np.linalg.eigh(np.cov(corners.T, bias=True))[1][:, 2]
            heights = piece @ along
            heights -= 0.5 * (heights.min() + heights.max())
            for side in (heights, -heights):
                split(_lower_part(piece, side), depth + 1)
        spheres = ball + radius + BOUND_TOLERANCE_M, inside + radius - BOUND_TOLERANCE_M
        rows[row] = (*center.tolist(), *spheres, len(rows), leaf)

    split(edges, 0)
    return _tree_of(rows)


def _lower_part(edges: Array, heights: Array) -> Array:
    """Edges (., 2, 3) of that part of a convex polytope where heights are not above 0.

    Args:
        edges: (k, 2, 3) segments within the polytope, its own edges among them.
        heights: (k, 2) of their ends.
    """
    # Edges that cross the plane are cut where they do.
    crossing = heights.min(axis=1) * heights.max(axis=1) < 0.0
    ends, (a, b) = edges[crossing], heights[crossing].T
    rim = ends[:, 0] + (a / (a - b))[:, None] * (ends[:, 1] - ends[:, 0])
    low = np.where((a < 0.0)[:, None], ends[:, 0], ends[:, 1])
    kept = edges[(heights <= 0.0).all(axis=1)]
    # The rim of the cut: from each point to the next around their middle.
    rim = np.vstack([rim, edges[heights == 0.0]])
    middle = rim - rim.mean(axis=0)
    axes = np.linalg.svd(middle)[2]
    order = np.argsort(np.arctan2(middle @ axes[1], middle @ axes[0]))
    around = np.stack([rim[order], np.roll(rim[order], -1, axis=0)], axis=1)
    return np.concatenate([kept, np.stack([low, rim[: len(low)]], axis=1), around])


def bounding_sphere(points: Array) -> tuple[Array, float]:
    """Centre (3,) and radius of a ball around (n, 3) points, within 1 % of the smallest.

    Bădoiu and Clarkson's core-set iteration: a step of 1/(i+1) towards the farthest point.
    """
    center = best = points.mean(axis=0)
    smallest = np.inf
    for step in range(40):
        squares = np.square(points - center).sum(axis=1)
        farthest = squares.argmax()
        if squares[farthest] < smallest:
            best, smallest = center, squares[farthest]
        center = center + (points[farthest] - center) / (step + 2)
    return best, math.sqrt(smallest)
