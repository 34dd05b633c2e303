"""Trees of spheres that cover a convex set, from coarse to fine.

A set is cut in halves across its longest extent until the ball around each piece sticks out of the
set by no more than the stated excess; as the pieces make up the whole set, so do their balls cover
it, inside included.
"""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull

from placement_planner_ros.core.collision.mesh_distances import SolidSurface
from placement_planner_ros.core.collision.meshes import mesh_arrays
from placement_planner_ros.core.collision.separation import BOUND_TOLERANCE_M
from placement_planner_ros.core.collision.shapes import Shape
from placement_planner_ros.core.collision.solids import CollisionBody, SolidRows, bounding_sphere
from placement_planner_ros.core.disk_cache import code_digest, digest_of, recalled_result
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.weak_cache import weak_lru_cache


@weak_lru_cache("shape", maxsize=8)
def shape_rows(shape: Shape, excess: float) -> SolidRows:
    """The rows of a shape in its own frame: each set with its spheres in preorder, each of which
    covers what the spheres below it cover. Kept on disk.

    Args:
        shape: what to cover.
        excess: stop splitting where a sphere sticks out of its set by at most this, metres;
            infinite for one sphere around each set.
    """

    def make() -> SolidRows:
        made = SolidRows.joined(
            [
                _cover_set(s.vertices.tobytes(), len(s.offsets) > 0, s.radius, excess)
                for s in shape.sets
            ]
        )
        if shape.mesh is None:
            return made
        # Balls of a cover's spheres that lie inside the mesh itself, as far as that is closed.
        spheres = made.node_spheres
        away, _ = SolidSurface(mesh_arrays([shape.mesh])).distances(spheres[:, :3], np.inf)
        inner = np.where(away < 0.0, -away - BOUND_TOLERANCE_M, -np.inf)
        return replace(made, node_spheres=np.column_stack([spheres[:, :4], inner]))

    sets = tuple((s.vertices, s.radius) for s in shape.sets)
    key = digest_of(code_digest(__name__), excess, shape.mesh and shape.mesh.digest, sets)
    rows = recalled_result("sphere trees", key, make)
    if shape.mesh is None:
        return rows
    # The mesh that all of the sets cover.
    covering = np.column_stack([rows.sets[:, :2], np.zeros(len(rows.sets), dtype=np.int64)])
    return replace(rows, sets=covering, meshes=(shape.mesh,), mesh_frames=np.eye(4)[None])


def body_rows(body: CollisionBody, T_joint_world: bytes, excess: float) -> tuple[SolidRows, Array]:
    """The rows of a body, and a ball (4,) around it.

    Args:
        T_joint_world: (4, 4) of the body's joint, with all joints at zero.
        excess: how far the finest covering spheres may stick out, metres; ten times that of
            what does not move.
    """
    step(f"covering {body.name} with spheres")
    T = pin.SE3(np.frombuffer(T_joint_world).reshape(4, 4))
    (first, at), *others = [
        (shape, (T * T_part).homogeneous.tobytes()) for shape, T_part in body.parts
    ]
    return _placed_rows(first, at, tuple(others), excess if body.joint >= 0 else 10 * excess)


@weak_lru_cache("shape", maxsize=16)
def _placed_rows(
    shape: Shape, at: bytes, others: tuple[tuple[Shape, bytes], ...], excess: float
) -> tuple[SolidRows, Array]:
    """The rows of shapes, each (4, 4) there, and a ball (4,) around all: the same for each object
    and grasp of it, whether the hand is open or not."""
    placed = [
        shape_rows(each, excess).moved(pin.SE3(np.frombuffer(T).reshape(4, 4)))
        for each, T in ((shape, at), *others)
    ]
    rows = SolidRows.joined(placed)
    return rows, rows.ball()


@functools.lru_cache(maxsize=4096)
def _cover_set(vertices: bytes, volume: bool, radius: float, excess: float) -> SolidRows:
    points = np.frombuffer(vertices).reshape(-1, 3).copy()
    # Facets and edges of the hull, or of a segment.
    if volume:
        hull = ConvexHull(points)
        facets, sides = hull.equations, hull.simplices[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        edges = points[np.unique(np.sort(sides, axis=1), axis=0)]
    else:  # a point or the axis of a capsule
        facets, edges = np.zeros((1, 4)), points[[[0, len(points) - 1]]]
    nodes: list[tuple[int, int]] = []
    spheres: list[tuple[float, ...]] = []

    def split(piece: Array) -> None:
        # The centre is a mean of the piece's corners, so the set holds it.
        corners = np.unique(piece.reshape(-1, 3), axis=0)
        center, ball = bounding_sphere(corners)
        inside = max(0.0, float(np.min(-facets[:, :3] @ center - facets[:, 3])))
        row = len(nodes)
        nodes.append((row + 1, 0))
        outer = ball + radius + BOUND_TOLERANCE_M
        spheres.append((*center.tolist(), outer, inside + radius - BOUND_TOLERANCE_M))
        # A leaf where the sphere sticks out little, else both halves.
        if ball - inside > excess:
            # Cut in the middle of the longest extent.
            along = np.linalg.eigh(np.cov(corners.T, bias=True))[1][:, 2]
            heights = piece @ along
            heights -= 0.5 * (heights.min() + heights.max())
            for side in (heights, -heights):
                split(_lower_part(piece, side))
            nodes[row] = len(nodes), -1

    split(edges)
    one_set = np.array([[0, 0, -1]]), np.array([radius])
    return SolidRows(np.array(nodes), np.array(spheres), *one_set, points, (), np.zeros((0, 4, 4)))


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
