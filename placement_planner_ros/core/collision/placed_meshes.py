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


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _to_mesh(scratch: ArmScratch, row: int, x: float, y: float, z: float) -> None:
    """Put a point of the world into row of `mesh_points`, in the frame of the placed mesh."""
    # From the frame's origin, turned back.
    T, points = scratch.mesh_frames[0], scratch.mesh_points
    dx, dy, dz = x - T[0, 3], y - T[1, 3], z - T[2, 3]
    for i in range(3):
        points[row, i] = T[0, i] * dx + T[1, i] * dy + T[2, i] * dz


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def mesh_keeps_box(
    arm: ArmArrays, scratch: ArmScratch, mesh: int, boxes: Array, box: int, need: float
) -> bool:
    """Whether a mesh and a box of (m, 6) are certainly `need` apart.

    What is swept up meets a box where it meets, as it is, what the box sweeps downward.
    """
    # The box's corners in the mesh's frame.
    _place_mesh(arm, scratch, mesh, scratch.mesh_frames[0])
    for row in range(8):
        x, y, z = box_corner(boxes, box, row)
        _to_mesh(scratch, row, x, y, z - scratch.sweep[0] if row & 4 == 0 else z)
    tree = arm.meshes[mesh, at.MESH_TREE]
    return mesh_keeps_hull(arm.trees, tree, scratch.mesh_points, 8, need, scratch.work)


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def mesh_keeps_set(arm: ArmArrays, scratch: ArmScratch, mesh: int, s: int, need: float) -> bool:
    """Whether a mesh and convex set s, placed, are certainly `need` apart."""
    # The set's vertices in the mesh's frame.
    _place_mesh(arm, scratch, mesh, scratch.mesh_frames[0])
    first, last = arm.sets[s, at.SET_FIRST_VERTEX], arm.sets[s + 1, at.SET_FIRST_VERTEX]
    world = scratch.vertices
    for v in range(first, last):
        _to_mesh(scratch, v - first, world[v, 0], world[v, 1], world[v, 2])
    # The mesh against their hull, the radius added.
    tree, points, far = arm.meshes[mesh, at.MESH_TREE], scratch.mesh_points, need + arm.radius[s]
    return mesh_keeps_hull(arm.trees, tree, points, last - first, far, scratch.work)


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def placed_meshes_keep(
    arm: ArmArrays, scratch: ArmScratch, mesh: int, other: int, need: float
) -> bool:
    """Whether two meshes are certainly `need` apart."""
    # Both meshes in the world.
    A, B, T = scratch.mesh_frames[0], scratch.mesh_frames[1], scratch.mesh_frames[2]
    _place_mesh(arm, scratch, mesh, A)
    _place_mesh(arm, scratch, other, B)
    # T_mesh_other, column by column.
    for j in range(4):
        x, y, z = B[0, j], B[1, j], B[2, j]
        if j == 3:
            x, y, z = x - A[0, 3], y - A[1, 3], z - A[2, 3]
        for i in range(3):
            T[i, j] = A[0, i] * x + A[1, i] * y + A[2, i] * z
    pair = arm.meshes[mesh, at.MESH_TREE], arm.meshes[other, at.MESH_TREE]
    return meshes_keep(arm.trees, pair, T, need, scratch.mesh_points, scratch.work)
