"""Original triangles against a convex hull or against each other: what decides where covers do not.

The trees of boxes of both sides are descended, and what boxes do not keep apart is left to the
distance of triangles (`separation`). Where no triangle of a mesh is near, what is asked about lies
inside the solid that its closed components bound, or outside: a ray says which.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.collision.meshes import MeshArrays, Singles
from placement_planner_ros.core.collision.separation import (
    BOUND_TOLERANCE_M,
    COLLIDING,
    FREE,
    UNDECIDED,
    check_separation,
)
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.types import Array

Indices = npt.NDArray[np.int64]

COARSE_MOTION_M = 0.02
"""Metres of motion above which an interval is searched for collisions rather than certified."""

_COARSE_MESH_MOTION_M = 0.004
"""The like for two meshes, between which a search for collisions takes long."""

_UNKNOWN_WINDING = -1


@kernel(inline=True)
def _next_node(node: int) -> int:
    """The next node in preorder that is not below this one; 0 after the last."""
    # Climb while the node is a right child (its number is even).
    while node > 0 and node % 2 == 0:
        node = (node - 1) // 2
    # The sibling to the right.
    return node + 1 if node > 0 else 0


@kernel(inline=True)
def _furthest_along(points: Array, count: int, x: float, y: float, z: float) -> float:
    """How far the first `count` points (., 3) reach along (x, y, z)."""
    # The furthest of the points.
    most = -np.inf
    for i in range(count):
        most = max(most, points[i, 0] * x + points[i, 1] * y + points[i, 2] * z)
    return most


@kernel(inline=True)
def _lowest_along(corners: Array, k: int, x: float, y: float, z: float) -> float:
    """How far back along (x, y, z) the triangle of corners k to k + 2 reaches."""
    return min(
        corners[k, 0] * x + corners[k, 1] * y + corners[k, 2] * z,
        corners[k + 1, 0] * x + corners[k + 1, 1] * y + corners[k + 1, 2] * z,
        corners[k + 2, 0] * x + corners[k + 2, 1] * y + corners[k + 2, 2] * z,
    )


@kernel(inline=True)
def _least_coordinate(corners: Array, k: int, i: int) -> float:
    """The least coordinate i of corners k to k + 2."""
    return min(corners[k, i], corners[k + 1, i], corners[k + 2, i])


@kernel(inline=True)
def _greatest_coordinate(corners: Array, k: int, i: int) -> float:
    """The greatest coordinate i of corners k to k + 2."""
    return max(corners[k, i], corners[k + 1, i], corners[k + 2, i])


@kernel(lean=True)
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
                # How far the box around the triangle is from the box around the points.
                dx = max(
                    _least_coordinate(corners, 3 * t, 0) - x1,
                    0.0,
                    x0 - _greatest_coordinate(corners, 3 * t, 0),
                )
                dy = max(
                    _least_coordinate(corners, 3 * t, 1) - y1,
                    0.0,
                    y0 - _greatest_coordinate(corners, 3 * t, 1),
                )
                dz = max(
                    _least_coordinate(corners, 3 * t, 2) - z1,
                    0.0,
                    z0 - _greatest_coordinate(corners, 3 * t, 2),
                )
                if dx * dx + dy * dy + dz * dz >= far * far:
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


@kernel(lean=True)
def _turned_boxes_apart(
    turned: Singles,
    a: int,
    b: int,
    T: Array,
    n: tuple[float, float, float],
    far: float,
) -> bool:
    """Whether turned boxes a and b (rows), b placed by T (4, 4), are `far` apart: as balls, along
    n, or from each other's sides."""
    nx, ny, nz = n
    # From the centre of b, placed, to that of a.
    x, y, z = turned[b, 9], turned[b, 10], turned[b, 11]
    cx = turned[a, 9] - (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3])
    cy = turned[a, 10] - (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3])
    cz = turned[a, 11] - (T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3])
    # Apart as balls.
    reach = far + turned[a, 15] + turned[b, 15]
    if cx * cx + cy * cy + cz * cz >= reach * reach:
        return True
    # How far the boxes reach along the axes of the other, and along n.
    along = nx * cx + ny * cy + nz * cz
    square_a = square_b = 0.0
    a0 = a1 = a2 = 0.0
    for j in range(3):
        # An axis of b, turned into the frame of a.
        x, y, z = turned[b, 3 * j], turned[b, 3 * j + 1], turned[b, 3 * j + 2]
        half = turned[b, 12 + j]
        u = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z
        v = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z
        w = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z
        # What b reaches along n by this axis.
        along -= abs(nx * u + ny * v + nz * w) * half
        # How far it reaches along each axis of a.
        m0 = abs(turned[a, 0] * u + turned[a, 1] * v + turned[a, 2] * w)
        m1 = abs(turned[a, 3] * u + turned[a, 4] * v + turned[a, 5] * w)
        m2 = abs(turned[a, 6] * u + turned[a, 7] * v + turned[a, 8] * w)
        a0 += m0 * half
        a1 += m1 * half
        a2 += m2 * half
        # The gap along b's axis, less what both boxes reach along it.
        gap = abs(u * cx + v * cy + w * cz) - half
        gap -= m0 * turned[a, 12] + m1 * turned[a, 13] + m2 * turned[a, 14]
        if gap > 0.0:
            square_b += gap * gap
    for j in range(3):
        # An axis of a.
        x, y, z = turned[a, 3 * j], turned[a, 3 * j + 1], turned[a, 3 * j + 2]
        half = turned[a, 12 + j]
        # What a reaches along n by this axis.
        along -= abs(nx * x + ny * y + nz * z) * half
        # The gap along a's axis, less what both boxes reach along it.
        gap = abs(x * cx + y * cy + z * cz) - half - (a0 if j == 0 else a1 if j == 1 else a2)
        if gap > 0.0:
            square_a += gap * gap
    # Gaps along the axes of one box are at right angles, so that their squares add up.
    return bool(along >= far or square_a >= far * far or square_b >= far * far)


@kernel(inline=True)
def _beside_turned_box(turned: Singles, a: int, triangle: Array, far: float) -> bool:
    """Whether a triangle, the first rows of (., 3), is `far` from the sides of turned box a."""
    square = 0.0
    # An axis of the box, and where the corners of the triangle lie along it from its centre.
    for j in range(3):
        x, y, z = turned[a, 3 * j], turned[a, 3 * j + 1], turned[a, 3 * j + 2]
        # As float64, which Python's own numbers are.
        middle = float(turned[a, 9]) * x + float(turned[a, 10]) * y + float(turned[a, 11]) * z
        p = triangle[0, 0] * x + triangle[0, 1] * y + triangle[0, 2] * z - middle
        q = triangle[1, 0] * x + triangle[1, 1] * y + triangle[1, 2] * z - middle
        r = triangle[2, 0] * x + triangle[2, 1] * y + triangle[2, 2] * z - middle
        # The gap along this axis, on whichever side the triangle lies.
        gap = max(min(p, q, r), -max(p, q, r)) - turned[a, 12 + j]
        if gap > 0.0:
            square += gap * gap
    return square >= far * far


@kernel(lean=True)
def meshes_meet(
    meshes: MeshArrays,
    mesh: int,
    other: int,
    T: Array,
    need: float,
    hit: float,
    stack: Indices,
    room: Array,
    work: Array,
) -> int:
    """Two meshes: FREE from `need` on, COLLIDING below `hit`.

    Where `need` cannot be kept, only collisions are looked for, or nothing where it is far above
    `hit`.

    Args:
        T: (4, 4) T_mesh_other.
        stack: (256, 2); room: (12, 3) at least; work: (6, 4): work space.
    """
    # Both trees: the root's row, the first leaf, and how many nodes are no leaves.
    turned, corners, leaves = meshes.turned, meshes.corners, meshes.leaves
    root_a, root_b = meshes.first_node[mesh], meshes.first_node[other]
    leaf_a, leaf_b = meshes.first_leaf[mesh], meshes.first_leaf[other]
    inner_a = (meshes.first_node[mesh + 1] - root_a) // 2
    inner_b = (meshes.first_node[other + 1] - root_b) // 2
    far = need + BOUND_TOLERANCE_M
    result = FREE
    # The direction that last kept two triangles apart, from other to mesh.
    nx = ny = nz = 0.0
    # Pairs of nodes that are still to be looked at, first both roots.
    stack[0, 0] = 0
    stack[0, 1] = 0
    waiting = 1
    while waiting > 0:
        waiting -= 1
        node_a, node_b = stack[waiting, 0], stack[waiting, 1]
        a, b = root_a + node_a, root_b + node_b
        if _turned_boxes_apart(turned, a, b, T, (nx, ny, nz), far):
            continue
        if node_a < inner_a or node_b < inner_b:
            # The larger of them is opened.
            if node_b >= inner_b or (node_a < inner_a and turned[a, 15] >= turned[b, 15]):
                for side in range(2):
                    stack[waiting, 0], stack[waiting, 1] = 2 * node_a + 2 - side, node_b
                    waiting += 1
            else:
                for side in range(2):
                    stack[waiting, 0], stack[waiting, 1] = node_a, 2 * node_b + 2 - side
                    waiting += 1
            continue
        # A pair of leaves: the triangles of the other mesh, put into the frame of the first.
        for t in range(leaves[leaf_b + node_b - inner_b], leaves[leaf_b + node_b - inner_b + 1]):
            for v in range(3):
                x, y, z = corners[3 * t + v, 0], corners[3 * t + v, 1], corners[3 * t + v, 2]
                for i in range(3):
                    room[v, i] = T[i, 0] * x + T[i, 1] * y + T[i, 2] * z + T[i, 3]
            # All of the leaf's triangles lie beside it.
            if _beside_turned_box(turned, a, room, far):
                continue
            # Against the triangles of the leaf of the first mesh.
            for s in range(
                leaves[leaf_a + node_a - inner_a], leaves[leaf_a + node_a - inner_a + 1]
            ):
                # Their distance, sought from the remembered direction on.
                work[5, 0], work[5, 1], work[5, 2] = nx, ny, nz
                answer = check_separation(corners, 3 * s, 3 * s + 3, room, 0, 3, need, hit, work)
                if answer == COLLIDING:
                    return COLLIDING
                if answer == UNDECIDED:
                    # There is no certain answer to be had at this distance.
                    if need - hit > _COARSE_MESH_MOTION_M:
                        return UNDECIDED
                    # From here on only collisions are looked for.
                    result = UNDECIDED
                    need = hit
                    far = need + BOUND_TOLERANCE_M
                    continue
                # Remember the direction that kept them apart.
                x, y, z = work[5, 0], work[5, 1], work[5, 2]
                length = np.sqrt(x * x + y * y + z * z)
                nx, ny, nz = x / length, y / length, z / length
    # No surface meets the other; a component may still lie inside.
    points = meshes.components
    for c in range(meshes.first_component[other], meshes.first_component[other + 1]):
        # A point of each component of the other mesh, in the frame of the first.
        x, y, z = points[c, 0], points[c, 1], points[c, 2]
        inside = winding_number(
            meshes,
            mesh,
            T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3],
            T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3],
            T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3],
        )
        if inside > 0:
            return COLLIDING
        if inside < 0:
            result = UNDECIDED
    for c in range(meshes.first_component[mesh], meshes.first_component[mesh + 1]):
        # A point of each component of the first mesh, in the frame of the other.
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


@kernel(lean=True)
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


@kernel(lean=True)
def _ray_crossings(
    meshes: MeshArrays,
    mesh: int,
    x: float,
    y: float,
    z: float,
    ray: tuple[float, float, float],
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


@kernel(lean=True)
def surface_distance(meshes: MeshArrays, mesh: int, x: float, y: float, z: float) -> float:
    """Metres from a point to the nearest triangle of a mesh."""
    # The mesh's nodes: the root's row, its first leaf, and how many nodes are no leaves.
    boxes = meshes.boxes
    root, leaf = meshes.first_node[mesh], meshes.first_leaf[mesh]
    inner = (meshes.first_node[mesh + 1] - root) // 2
    nearest = np.inf
    node = 0
    while True:
        # Whether the node's box is closer than the nearest triangle so far.
        b = root + node
        dx = max(boxes[b, 0] - x, 0.0, x - boxes[b, 3])
        dy = max(boxes[b, 1] - y, 0.0, y - boxes[b, 4])
        dz = max(boxes[b, 2] - z, 0.0, z - boxes[b, 5])
        near = dx * dx + dy * dy + dz * dz < nearest
        # An inner node: on to its left child.
        if near and node < inner:
            node = 2 * node + 1
            continue
        if near:
            # A leaf: the nearest of its triangles.
            first = leaf + node - inner
            for t in range(meshes.leaves[first], meshes.leaves[first + 1]):
                nearest = min(nearest, _square_distance(meshes.corners, 3 * t, x, y, z))
        node = _next_node(node)
        if node == 0:
            break
    return np.sqrt(nearest)


@kernel(lean=True, nogil=True)
def inside_of_mesh(meshes: MeshArrays, centers: Array, radius: Array) -> None:
    """Set `radius` (n,) to that of the ball around each centre (n, 3) that lies inside the solid
    of the only mesh; it stays where there is none."""
    for i in range(len(radius)):
        # Only centres inside the solid have a ball inside of it.
        x, y, z = centers[i, 0], centers[i, 1], centers[i, 2]
        if winding_number(meshes, 0, x, y, z) > 0:
            radius[i] = surface_distance(meshes, 0, x, y, z)


@kernel(lean=True)
def _square_distance(corners: Array, k: int, x: float, y: float, z: float) -> float:
    """Of a point to the triangle of corners k to k + 2: to its plane where the foot lies in it,
    else to the nearest of its sides."""
    nearest = np.inf
    within = True
    # Two sides of the triangle, and its normal.
    ux = corners[k + 1, 0] - corners[k, 0]
    uy = corners[k + 1, 1] - corners[k, 1]
    uz = corners[k + 1, 2] - corners[k, 2]
    vx = corners[k + 2, 0] - corners[k, 0]
    vy = corners[k + 2, 1] - corners[k, 1]
    vz = corners[k + 2, 2] - corners[k, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    square = nx * nx + ny * ny + nz * nz
    for side in range(3):
        # A side, and the point from its first corner.
        a, b = k + side, k + (side + 1) % 3
        ex = corners[b, 0] - corners[a, 0]
        ey = corners[b, 1] - corners[a, 1]
        ez = corners[b, 2] - corners[a, 2]
        px, py, pz = x - corners[a, 0], y - corners[a, 1], z - corners[a, 2]
        length = ex * ex + ey * ey + ez * ez
        # The point of the side that is nearest.
        share = 0.0
        if length > 0.0:
            share = min(max((px * ex + py * ey + pz * ez) / length, 0.0), 1.0)
        dx, dy, dz = px - share * ex, py - share * ey, pz - share * ez
        nearest = min(nearest, dx * dx + dy * dy + dz * dz)
        # Left of the side, seen against the normal.
        turned = (ey * pz - ez * py) * nx + (ez * px - ex * pz) * ny + (ex * py - ey * px) * nz
        within = within and turned >= 0.0
    # The foot of the point lies within the triangle: the distance to its plane.
    if within and square > 0.0:
        px, py, pz = x - corners[k, 0], y - corners[k, 1], z - corners[k, 2]
        height = px * nx + py * ny + pz * nz
        nearest = min(nearest, height * height / square)
    return nearest
