"""Original triangles against a convex hull or against each other: what decides where covers do not.

The tree of boxes is descended, and what boxes do not keep apart is left to the distance of
triangles (`separation`). Where no triangle of a mesh is near, what is asked about lies
inside the solid that its closed components bound, or outside: a ray says which.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement_planner_ros.core.collision.meshes import MeshArrays
from placement_planner_ros.core.collision.separation import (
    BOUND_TOLERANCE_M,
    COLLIDING,
    FREE,
    UNDECIDED,
    check_separation,
)
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted

COARSE_MOTION_M = 0.02
"""Metres of motion above which an interval is searched for collisions rather than certified."""

_COARSE_MESH_MOTION_M = 0.004
"""The like for two meshes, between which a search for collisions takes long."""

_UNKNOWN_WINDING = -1

Point = tuple[float, float, float]


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _next_node(node: int) -> int:
    """The next node in preorder that is not below this one; 0 after the last."""
    # Climb while the node is a right child (its number is even).
    while node > 0 and node % 2 == 0:
        node = (node - 1) // 2
    # The sibling to the right.
    return node + 1 if node > 0 else 0


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _furthest_along(points: Array, count: int, x: float, y: float, z: float) -> float:
    """How far the first `count` points (., 3) reach along (x, y, z)."""
    # The furthest of the points.
    most = -np.inf
    for i in range(count):
        most = max(most, points[i, 0] * x + points[i, 1] * y + points[i, 2] * z)
    return most


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _lowest_along(corners: Array, k: int, x: float, y: float, z: float) -> float:
    """How far back along (x, y, z) the triangle of corners k to k + 2 reaches."""
    return min(
        corners[k, 0] * x + corners[k, 1] * y + corners[k, 2] * z,
        corners[k + 1, 0] * x + corners[k + 1, 1] * y + corners[k + 1, 2] * z,
        corners[k + 2, 0] * x + corners[k + 2, 1] * y + corners[k + 2, 2] * z,
    )


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _beside_box(corners: Array, k: int, low: Point, high: Point, far: float) -> bool:
    """Whether the box around corners k to k + 2 is `far` from the box from `low` to `high`."""
    # The gap along each axis, whose squares add up.
    square = 0.0
    for i in range(3):
        least = min(corners[k, i], corners[k + 1, i], corners[k + 2, i])
        most = max(corners[k, i], corners[k + 1, i], corners[k + 2, i])
        gap = max(least - high[i], 0.0, low[i] - most)
        square += gap * gap
    return bool(square >= far * far)


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def box_corner(boxes: Array, box: int, number: int) -> Point:
    """A corner (0 to 7) of a box of (., 6)."""
    # A bit of the number for each axis.
    return (
        boxes[box, 0 if number & 1 == 0 else 3],
        boxes[box, 1 if number & 2 == 0 else 4],
        boxes[box, 2 if number & 4 == 0 else 5],
    )


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _move_point(T: Array, point: Point, room: Array, row: int) -> None:
    """Write T (4, 4) times a point into a row of (., 3)."""
    x, y, z = point
    for i in range(3):
        room[row, i] = T[i, 0] * x + T[i, 1] * y + T[i, 2] * z + T[i, 3]


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def mesh_meets_hull(
    meshes: MeshArrays, mesh: int, points: Array, count: int, need: float, hit: float, work: Array
) -> int:
    """A mesh against the hull of `count` points: FREE from `need` on, COLLIDING below `hit`.

    Where `need` cannot be kept, only collisions are looked for, or nothing where it is far above
    `hit`.

    Args:
        points: (., 3) in the mesh's frame.
        work: (6, 4).
    """
    # The mesh's nodes: the root's row, its first leaf, and how many nodes are no leaves.
    boxes, corners = meshes.boxes, meshes.corners
    root, leaf = meshes.first_node[mesh], meshes.first_leaf[mesh]
    inner = (meshes.first_node[mesh + 1] - root) // 2
    # The box around the points.
    x0 = y0 = z0 = np.inf
    x1 = y1 = z1 = -np.inf
    for i in range(count):
        x0, x1 = min(x0, points[i, 0]), max(x1, points[i, 0])
        y0, y1 = min(y0, points[i, 1]), max(y1, points[i, 1])
        z0, z1 = min(z0, points[i, 2]), max(z1, points[i, 2])
    far = need + BOUND_TOLERANCE_M
    result = FREE
    # The direction that kept the last triangle away may keep its neighbours away.
    nx = ny = nz = 0.0
    reach = np.inf
    node = 0
    # Walk down the tree of boxes in preorder.
    while True:
        # How far the node's box is from the box around the points.
        b = root + node
        dx = max(boxes[b, 0] - x1, 0.0, x0 - boxes[b, 3])
        dy = max(boxes[b, 1] - y1, 0.0, y0 - boxes[b, 4])
        dz = max(boxes[b, 2] - z1, 0.0, z0 - boxes[b, 5])
        apart = dx * dx + dy * dy + dz * dz >= far * far
        if not apart:
            # The box's nearest corner along the remembered direction, against the furthest point.
            lowest = nx * (boxes[b, 0] if nx > 0.0 else boxes[b, 3])
            lowest += ny * (boxes[b, 1] if ny > 0.0 else boxes[b, 4])
            lowest += nz * (boxes[b, 2] if nz > 0.0 else boxes[b, 5])
            apart = lowest - reach >= far
        # An open inner node: on to its left child.
        if not apart and node < inner:
            node = 2 * node + 1
            continue
        if not apart:
            # An open leaf: its triangles, one by one.
            first = leaf + node - inner
            for t in range(meshes.leaves[first], meshes.leaves[first + 1]):
                # Apart along the remembered direction.
                if _lowest_along(corners, 3 * t, nx, ny, nz) - reach >= far:
                    continue
                # The box around the triangle is far from the box around the points.
                if _beside_box(corners, 3 * t, (x0, y0, z0), (x1, y1, z1), far):
                    continue
                # The distance between triangle and hull, sought from the remembered direction on.
                work[5, 0], work[5, 1], work[5, 2] = nx, ny, nz
                answer = check_separation(
                    corners, 3 * t, 3 * t + 3, points, 0, count, need, hit, work
                )
                if answer == COLLIDING:
                    return COLLIDING
                if answer == UNDECIDED:
                    # Far above `hit`, there is no certain answer to be had at this distance.
                    if need - hit > COARSE_MOTION_M:
                        return UNDECIDED
                    result = UNDECIDED
                    # From here on only collisions are looked for.
                    need = hit
                    far = need + BOUND_TOLERANCE_M
                    continue
                # Remember the direction that kept the triangle away, and how far the points reach
                # along it.
                x, y, z = work[5, 0], work[5, 1], work[5, 2]
                length = np.sqrt(x * x + y * y + z * z)
                nx, ny, nz = x / length, y / length, z / length
                reach = _furthest_along(points, count, nx, ny, nz)
        node = _next_node(node)
        if node == 0:
            break
    # No triangle meets the hull; it may lie inside the solid, where any of its points shows it.
    inside = winding_number(meshes, mesh, points[0, 0], points[0, 1], points[0, 2])
    if inside > 0:
        return COLLIDING
    return result if inside == 0 else UNDECIDED


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def meshes_meet(
    meshes: MeshArrays,
    pair: tuple[int, int],
    T: Array,
    need: float,
    hit: float,
    room: Array,
    work: Array,
) -> int:
    """Two meshes: FREE from `need` on, COLLIDING below `hit`.

    The boxes and triangles of the second mesh, as hulls, against the first.

    Args:
        pair: of the meshes.
        T: (4, 4) pose of the second mesh in the first.
        room: (8, 3) at least; work: (6, 4): work space.
    """
    mesh, other = pair
    corners, leaves = meshes.corners, meshes.leaves
    root, leaf = meshes.first_node[other], meshes.first_leaf[other]
    inner = (meshes.first_node[other + 1] - root) // 2
    result = FREE
    node = 0
    while True:
        # The box around what is below the node, in the first mesh's frame.
        for row in range(8):
            _move_point(T, box_corner(meshes.boxes, root + node, row), room, row)
        near = mesh_meets_hull(meshes, mesh, room, 8, need, need, work) != FREE
        # An inner node whose box is near: on to its left child.
        if near and node < inner:
            node = 2 * node + 1
            continue
        if near:
            # A leaf: its triangles, one by one.
            first = leaf + node - inner
            for t in range(leaves[first], leaves[first + 1]):
                for v in range(3):
                    k = 3 * t + v
                    _move_point(T, (corners[k, 0], corners[k, 1], corners[k, 2]), room, v)
                answer = mesh_meets_hull(meshes, mesh, room, 3, need, hit, work)
                if answer == COLLIDING:
                    return COLLIDING
                if answer == UNDECIDED:
                    # Far above `hit`, there is no certain answer to be had at this distance.
                    if need - hit > _COARSE_MESH_MOTION_M:
                        return UNDECIDED
                    # From here on only collisions are looked for.
                    result = UNDECIDED
                    need = hit
        node = _next_node(node)
        if node == 0:
            break
    # No triangle meets the first mesh or lies inside; that may lie inside the second.
    points = meshes.components
    for c in range(meshes.first_component[mesh], meshes.first_component[mesh + 1]):
        # A point of each component of the first mesh, in the frame of the second.
        x, y, z = points[c, 0] - T[0, 3], points[c, 1] - T[1, 3], points[c, 2] - T[2, 3]
        inside = winding_number(
            meshes,
            other,
            T[0, 0] * x + T[1, 0] * y + T[2, 0] * z,
            T[0, 1] * x + T[1, 1] * y + T[2, 1] * z,
            T[0, 2] * x + T[1, 2] * y + T[2, 2] * z,
        )
        if inside > 0:
            return COLLIDING
        if inside < 0:
            result = UNDECIDED
    return result


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def winding_number(meshes: MeshArrays, mesh: int, x: float, y: float, z: float) -> int:
    """How often the closed components of a mesh wind about a point; negative where it is not known.

    A ray counts the triangles that it leaves through, less those that it enters through. Whether
    it passes to the left or to the right of an edge comes out alike for both triangles there, so
    it slips through no crack; where it meets an edge exactly, another ray is taken.
    """
    # A point outside the box around the mesh is outside of it.
    root = meshes.first_node[mesh]
    boxes = meshes.boxes
    if not (
        boxes[root, 0] <= x <= boxes[root, 3]
        and boxes[root, 1] <= y <= boxes[root, 4]
        and boxes[root, 2] <= z <= boxes[root, 5]
    ):
        return 0
    # The first of three rays that meets no edge exactly.
    for ray in range(3):
        if ray == 0:
            total = _ray_crossings(meshes, mesh, x, y, z, (0.34107, 0.22713, 0.91218))
        elif ray == 1:
            total = _ray_crossings(meshes, mesh, x, y, z, (0.87131, 0.39217, 0.29498))
        else:
            total = _ray_crossings(meshes, mesh, x, y, z, (0.25119, 0.84733, 0.46787))
        if total >= 0:
            return total
    return _UNKNOWN_WINDING


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _ray_crossings(
    meshes: MeshArrays,
    mesh: int,
    x: float,
    y: float,
    z: float,
    ray: Point,
) -> int:
    """`winding_number` along the ray from (x, y, z) in direction r, whose parts are positive."""
    rx, ry, rz = ray
    # The mesh's nodes: the root's row, its first leaf, and how many nodes are no leaves.
    boxes, corners = meshes.boxes, meshes.corners
    root, leaf = meshes.first_node[mesh], meshes.first_leaf[mesh]
    inner = (meshes.first_node[mesh + 1] - root) // 2
    total = 0
    node = 0
    while True:
        # Where the ray enters and leaves the node's box.
        b = root + node
        enter = max((boxes[b, 0] - x) / rx, (boxes[b, 1] - y) / ry, (boxes[b, 2] - z) / rz, 0.0)
        leave = min((boxes[b, 3] - x) / rx, (boxes[b, 4] - y) / ry, (boxes[b, 5] - z) / rz)
        met = enter <= leave + BOUND_TOLERANCE_M
        # An inner node that is met: on to its left child.
        if met and node < inner:
            node = 2 * node + 1
            continue
        if met:
            # A leaf that is met: its triangles, but for those of open components.
            first = leaf + node - inner
            for t in range(meshes.leaves[first], meshes.leaves[first + 1]):
                if not meshes.closed[t]:
                    continue
                k = 3 * t
                # The triangle's corners from the start of the ray.
                ax, ay, az = corners[k, 0] - x, corners[k, 1] - y, corners[k, 2] - z
                bx, by, bz = corners[k + 1, 0] - x, corners[k + 1, 1] - y, corners[k + 1, 2] - z
                cx, cy, cz = corners[k + 2, 0] - x, corners[k + 2, 1] - y, corners[k + 2, 2] - z
                # On which side of each edge the ray passes.
                u = rx * (by * cz - bz * cy) + ry * (bz * cx - bx * cz) + rz * (bx * cy - by * cx)
                v = rx * (cy * az - cz * ay) + ry * (cz * ax - cx * az) + rz * (cx * ay - cy * ax)
                w = rx * (ay * bz - az * by) + ry * (az * bx - ax * bz) + rz * (ax * by - ay * bx)
                # The ray passes beside the triangle.
                if (u < 0.0 or v < 0.0 or w < 0.0) and (u > 0.0 or v > 0.0 or w > 0.0):
                    continue
                # Whether the line of the ray meets the triangle ahead of its start.
                along = rx * (u * ax + v * bx + w * cx)
                along += ry * (u * ay + v * by + w * cy)
                along += rz * (u * az + v * bz + w * cz)
                # The ray meets an edge or a corner.
                if u == 0.0 or v == 0.0 or w == 0.0:
                    return _UNKNOWN_WINDING
                # Out of the solid counts up, into it counts down.
                if u > 0.0 and along > 0.0:
                    total += 1
                elif u < 0.0 and along < 0.0:
                    total -= 1
        node = _next_node(node)
        if node == 0:
            break
    return abs(total)
