"""Meshes of an arm, where its joints are, against boxes, convex sets and each other."""

from __future__ import annotations

from numba import njit

from placement_planner_ros.core.collision import arrays as at
from placement_planner_ros.core.collision.against_mesh import (
    box_corner,
    mesh_keeps_hull,
    meshes_keep,
)
from placement_planner_ros.core.collision.arrays import ArmArrays, ArmScratch
from placement_planner_ros.core.collision.separation import PointRange
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _place_mesh(arm: ArmArrays, scratch: ArmScratch, mesh: int, T: Array) -> None:
    """Set T (4, 4) to T_world_mesh."""
    # The joint's frame, times the mesh's frame in it.
    A, B = scratch.frames, arm.mesh_frames
    joint = arm.meshes[mesh, at.MESH_JOINT]
    for i in range(3):
        x, y, z = A[joint, i, 0], A[joint, i, 1], A[joint, i, 2]
        for j in range(4):
            T[i, j] = x * B[mesh, 0, j] + y * B[mesh, 1, j] + z * B[mesh, 2, j]
        T[i, 3] += A[joint, i, 3]


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def mesh_keeps_points(
    arm: ArmArrays, scratch: ArmScratch, mesh: int, hull: PointRange, need: float
) -> bool:
    """Whether a mesh and the hull of points in the world are certainly `need` apart."""
    world, first, last = hull
    T, points = scratch.mesh_frames[0], scratch.mesh_points
    _place_mesh(arm, scratch, mesh, T)
    # The points, which may be there already, in the mesh's frame: from its origin, turned back.
    for v in range(first, last):
        dx, dy, dz = world[v, 0] - T[0, 3], world[v, 1] - T[1, 3], world[v, 2] - T[2, 3]
        for i in range(3):
            points[v - first, i] = T[0, i] * dx + T[1, i] * dy + T[2, i] * dz
    tree = arm.meshes[mesh, at.MESH_TREE]
    return mesh_keeps_hull(arm.trees, tree, points, last - first, need, scratch.work)


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def mesh_keeps_box(
    arm: ArmArrays, scratch: ArmScratch, mesh: int, boxes: Array, box: int, need: float
) -> bool:
    """Whether a mesh and a box of (m, 6) are certainly `need` apart.

    What is swept up meets a box where it meets, as it is, what the box sweeps downward.
    """
    corners = scratch.mesh_points
    for row in range(8):
        x, y, z = box_corner(boxes, box, row)
        corners[row, 0], corners[row, 1] = x, y
        corners[row, 2] = z - scratch.sweep[0] if row & 4 == 0 else z
    return mesh_keeps_points(arm, scratch, mesh, (corners, 0, 8), need)


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def solids_keep(arm: ArmArrays, scratch: ArmScratch, a: int, b: int, need: float) -> bool:
    """Whether what sets a and b are parts of keep `need`: two meshes, or a mesh and a set."""
    sets = arm.sets
    mesh, other = sets[a, at.SET_MESH], sets[b, at.SET_MESH]
    if mesh < 0 or other < 0:
        # The set's hull, its radius added to what is to be kept.
        s = b if mesh >= 0 else a
        hull = (scratch.vertices, sets[s, at.SET_FIRST_VERTEX], sets[s + 1, at.SET_FIRST_VERTEX])
        return mesh_keeps_points(arm, scratch, max(mesh, other), hull, need + arm.radius[s])
    # Both meshes in the world.
    A, B, T = scratch.mesh_frames[0], scratch.mesh_frames[1], scratch.mesh_frames[2:]
    _place_mesh(arm, scratch, mesh, A)
    _place_mesh(arm, scratch, other, B)
    # T_mesh_other, column by column.
    for j in range(4):
        x, y, z = B[0, j], B[1, j], B[2, j]
        if j == 3:
            x, y, z = x - A[0, 3], y - A[1, 3], z - A[2, 3]
        for i in range(3):
            T[0, i, j] = A[0, i] * x + A[1, i] * y + A[2, i] * z
    pair = arm.meshes[mesh, at.MESH_TREE], arm.meshes[other, at.MESH_TREE]
    rooms = scratch.mesh_points, scratch.mesh_pairs, scratch.work
    return meshes_keep(arm.trees, pair, T, need, rooms)
