"""Original triangles against a convex hull or against each other: what decides where covers do not.

Trees of boxes are descended, those of two meshes at once, and what boxes do not keep apart is left
to the distance of triangles (`separation`). Where no triangle of a mesh is near, what is asked
about lies inside the solid that its closed components bound, or outside: a ray says which.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement_planner_ros.core.collision.meshes import MeshArrays
from placement_planner_ros.core.collision.separation import BOUND_TOLERANCE_M, sets_keep
from placement_planner_ros.core.reach.kinematics import to_world
from placement_planner_ros.core.types import Array, Index
from placement_planner_ros.core.uncounted import Uncounted

Point = tuple[float, float, float]
MeshRooms = tuple[Array, Index, Array]
"""Work space: (4, 3) at least, (64, 2) pairs of nodes that wait, and (9, 4)."""


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _next_node(node: int) -> int:
    """The next node in preorder that is not below this one; 0 after the last."""
    # Climb while the node is a right child (its number is even).
    while node > 0 and node % 2 == 0:
        node = (node - 1) // 2
    # The sibling to the right.
    return node + 1 if node > 0 else 0


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def box_corner(boxes: Array, box: int, number: int) -> Point:
    """A corner (0 to 7) of a box of (., 6)."""
    # A bit of the number for each axis.
    return (
        boxes[box, 0 if number & 1 == 0 else 3],
        boxes[box, 1 if number & 2 == 0 else 4],
        boxes[box, 2 if number & 4 == 0 else 5],
    )


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def mesh_keeps_hull(
    meshes: MeshArrays, mesh: int, points: Array, count: int, need: float, work: Array
) -> bool:
    """Whether a mesh and the hull of `count` points are certainly `need` apart.

    Args:
        points: (., 3) in the mesh's frame.
        work: (9, 4).
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
    # Where to look for the first distance from: anywhere.
    work[5, :3] = 0.0
    node = 0
    # Walk down the tree of boxes in preorder.
    while True:
        # How far the node's box is from the box around the points.
        b = root + node
        dx = max(boxes[b, 0] - x1, 0.0, x0 - boxes[b, 3])
        dy = max(boxes[b, 1] - y1, 0.0, y0 - boxes[b, 4])
        dz = max(boxes[b, 2] - z1, 0.0, z0 - boxes[b, 5])
        apart = dx * dx + dy * dy + dz * dz >= far * far
        # An open inner node: on to its left child.
        if not apart and node < inner:
            node = 2 * node + 1
            continue
        if not apart:
            # An open leaf: its triangles, one by one.
            first = leaf + node - inner
            for t in range(meshes.leaves[first], meshes.leaves[first + 1]):
                # The direction that kept the last triangle away may keep its neighbours away.
                triangle = (corners, 3 * t, 3 * t + 3)
                if not sets_keep(triangle, (points, int(np.int64(0)), count), need, work):
                    return False
        node = _next_node(node)
        if node == 0:
            break
    # No triangle meets the hull; it may lie inside the solid, where any of its points shows it.
    return winding_number(meshes, mesh, points[0, 0], points[0, 1], points[0, 2]) == 0


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _squared_gap(boxes: Array, a: int, b: int, T: Array, way: Array) -> float:
    """How far two boxes are apart, at least and squared: along the axes of a, or along those of b.

    Args:
        T: (1, 4, 4) pose of the frame of box b in that of box a.
        way: (3,) work space.
    """
    along_a = along_b = 0.0
    for i in range(3):
        # From the middle of a to that of b along axis i of a, and half the sides of both there.
        way[i] = T[0, i, 3] - 0.5 * (boxes[a, i + 3] + boxes[a, i])
        reach = 0.5 * (boxes[a, i + 3] - boxes[a, i])
        for j in range(3):
            way[i] += 0.5 * T[0, i, j] * (boxes[b, j + 3] + boxes[b, j])
            reach += 0.5 * abs(T[0, i, j]) * (boxes[b, j + 3] - boxes[b, j])
        along_a += max(abs(way[i]) - reach, 0.0) ** 2
    for j in range(3):
        # The same along axis j of b.
        reach = 0.5 * (boxes[b, j + 3] - boxes[b, j])
        for i in range(3):
            reach += 0.5 * abs(T[0, i, j]) * (boxes[a, i + 3] - boxes[a, i])
        along = T[0, 0, j] * way[0] + T[0, 1, j] * way[1] + T[0, 2, j] * way[2]
        along_b += max(abs(along) - reach, 0.0) ** 2
    return max(along_a, along_b)


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def meshes_keep(
    meshes: MeshArrays, pair: tuple[int, int], T: Array, need: float, rooms: MeshRooms
) -> bool:
    """Whether two meshes are certainly `need` apart; both trees are descended together.

    Args:
        pair: of the meshes.
        T: (1, 4, 4) pose of the second mesh in the first.
    """
    one, two = pair
    room, waiting, work = rooms
    corners, leaves, points = meshes.corners, meshes.leaves, meshes.components
    root, below = meshes.first_node[one], meshes.first_node[two]
    inner = (meshes.first_node[one + 1] - root) // 2
    inner_below = (meshes.first_node[two + 1] - below) // 2
    far = need + BOUND_TOLERANCE_M
    # Where to look for the first distance from: anywhere.
    work[5, :3] = 0.0
    # Pairs of nodes wait, at most one for each level of both trees and one more; first the roots.
    waiting[0], count = 0, 1
    while count > 0:
        count -= 1
        a, b = waiting[count, 0], waiting[count, 1]
        if _squared_gap(meshes.boxes, root + a, below + b, T, room[3]) >= far * far:
            continue
        # The one that is higher up in its tree gives way to its children, ...
        if a < inner or b < inner_below:
            for child in range(1, 3):
                higher = a < inner and (a <= b or b >= inner_below)
                waiting[count, 0] = 2 * a + child if higher else a
                waiting[count, 1] = b if higher else 2 * b + child
                count += 1
            continue
        # ... and of two leaves each triangle is held against each.
        leaf = meshes.first_leaf[one] + a - inner
        other = meshes.first_leaf[two] + b - inner_below
        for t in range(leaves[other], leaves[other + 1]):
            for v in range(3):
                x, y, z = corners[3 * t + v, 0], corners[3 * t + v, 1], corners[3 * t + v, 2]
                room[v, 0], room[v, 1], room[v, 2] = to_world(T, 0, x, y, z)
            for u in range(leaves[leaf], leaves[leaf + 1]):
                # The direction that kept the last triangle away may keep its neighbours away.
                triangle = (corners, 3 * u, 3 * u + 3)
                if not sets_keep(triangle, (room, int(np.int64(0)), int(np.int64(3))), need, work):
                    return False
    # No triangles are near: each component lies inside the other mesh or outside, as a point of it.
    for c in range(meshes.first_component[two], meshes.first_component[two + 1]):
        x, y, z = to_world(T, 0, points[c, 0], points[c, 1], points[c, 2])
        if winding_number(meshes, one, x, y, z) != 0:
            return False
    for c in range(meshes.first_component[one], meshes.first_component[one + 1]):
        # Turned back into the frame of the second.
        for i in range(3):
            room[0, i] = 0.0
            for j in range(3):
                room[0, i] += T[0, j, i] * (points[c, j] - T[0, j, 3])
        if winding_number(meshes, two, room[0, 0], room[0, 1], room[0, 2]) != 0:
            return False
    return True


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def winding_number(meshes: MeshArrays, mesh: int, x: float, y: float, z: float) -> int:
    """How often the closed components of a mesh wind about a point; negative where it is not known.

    A ray counts the triangles that it leaves through, less those that it enters through. Whether
    it passes to the left or to the right of an edge comes out alike for both triangles there, so
    it slips through no crack; where it meets an edge exactly, nothing is known.
    """
    # A direction, all of it positive, along no edge that anybody makes.
    rx, ry, rz = 0.34107, 0.22713, 0.91218
    # The mesh's nodes: the root's row, its first leaf, and how many nodes are no leaves.
    boxes, corners = meshes.boxes, meshes.corners
    root, leaf = meshes.first_node[mesh], meshes.first_leaf[mesh]
    inner = (meshes.first_node[mesh + 1] - root) // 2
    # A point beyond the box around the mesh is outside of it.
    if not (
        boxes[root, 0] <= x <= boxes[root, 3]
        and boxes[root, 1] <= y <= boxes[root, 4]
        and boxes[root, 2] <= z <= boxes[root, 5]
    ):
        return 0
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
                    return -1
                # Out of the solid counts up, into it counts down.
                if u > 0.0 and along > 0.0:
                    total += 1
                elif u < 0.0 and along < 0.0:
                    total -= 1
        node = _next_node(node)
        if node == 0:
            break
    return abs(total)
