"""Meshes of an arm, where its joints are, against boxes, convex sets and each other."""

from __future__ import annotations

from placement_planner_ros.core.collision.against_mesh import mesh_meets_hull, meshes_meet
from placement_planner_ros.core.collision.arrays import (
    MESH_JOINT,
    MESH_TREE,
    SET_EXACT,
    SET_FIRST_VERTEX,
    ArmArrays,
    ArmScratch,
)
from placement_planner_ros.core.collision.placing import place_inner
from placement_planner_ros.core.collision.separation import COLLIDING, UNDECIDED
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.types import Array


@kernel(lean=True)
def place_mesh(arm: ArmArrays, scratch: ArmScratch, mesh: int) -> None:
    """Set `mesh_frame` to T_world_mesh."""
    # The joint's frame, times the mesh's frame in it.
    T, A, B = scratch.mesh_frame, scratch.frames, arm.mesh_frames
    joint = arm.meshes[mesh, MESH_JOINT]
    for i in range(3):
        x, y, z = A[joint, i, 0], A[joint, i, 1], A[joint, i, 2]
        for j in range(4):
            T[i, j] = x * B[mesh, 0, j] + y * B[mesh, 1, j] + z * B[mesh, 2, j]
        T[i, 3] += A[joint, i, 3]


@kernel(inline=True)
def _to_mesh(scratch: ArmScratch, row: int, x: float, y: float, z: float) -> None:
    """Put a point of the world into row of `mesh_points`, in the frame of the placed mesh."""
    # From the frame's origin, turned back.
    T, points = scratch.mesh_frame, scratch.mesh_points
    dx, dy, dz = x - T[0, 3], y - T[1, 3], z - T[2, 3]
    for i in range(3):
        points[row, i] = T[0, i] * dx + T[1, i] * dy + T[2, i] * dz


@kernel(lean=True)
def mesh_meets_box(
    arm: ArmArrays,
    scratch: ArmScratch,
    mesh: int,
    corners: Array,
    box: int,
    need: float,
    hit: float,
) -> int:
    """A mesh against a box of `corners` (m, 6): FREE from `need` on, COLLIDING below `hit`."""
    # The box's corners in the mesh's frame.
    place_mesh(arm, scratch, mesh)
    for row in range(8):
        _to_mesh(
            scratch,
            row,
            corners[box, 0 if row & 1 == 0 else 3],
            corners[box, 1 if row & 2 == 0 else 4],
            corners[box, 2 if row & 4 == 0 else 5],
        )
    return mesh_meets_hull(
        arm.trees,
        arm.meshes[mesh, MESH_TREE],
        scratch.mesh_points,
        8,
        need,
        hit,
        scratch.work,
    )


@kernel(lean=True)
def mesh_meets_set(
    arm: ArmArrays, scratch: ArmScratch, mesh: int, s: int, need: float, hit: float
) -> int:
    """A mesh against convex set s, placed: FREE from `need` on, COLLIDING below `hit`.

    Where the set is not exact, COLLIDING is asked of the copy that its shape contains.
    """
    # The set's vertices in the mesh's frame.
    place_mesh(arm, scratch, mesh)
    first, last = arm.sets[s, SET_FIRST_VERTEX], arm.sets[s + 1, SET_FIRST_VERTEX]
    world = scratch.vertices
    for v in range(first, last):
        _to_mesh(scratch, v - first, world[v, 0], world[v, 1], world[v, 2])
    tree, radius = arm.meshes[mesh, MESH_TREE], arm.radius[s]
    # The mesh against their hull, the radius added.
    answer = mesh_meets_hull(
        arm.trees,
        tree,
        scratch.mesh_points,
        last - first,
        need + radius,
        hit + radius,
        scratch.work,
    )
    # Certain where the set is exact; else ask the copy that the shape contains.
    if answer != COLLIDING or arm.sets[s, SET_EXACT] != 0:
        return answer
    last = place_inner(arm, scratch, s, 0)
    inner = scratch.inner
    for v in range(last):
        _to_mesh(scratch, v, inner[v, 0], inner[v, 1], inner[v, 2])
    answer = mesh_meets_hull(
        arm.trees, tree, scratch.mesh_points, last, hit + radius, hit + radius, scratch.work
    )
    return answer if answer == COLLIDING else UNDECIDED


@kernel(lean=True)
def placed_meshes_meet(
    arm: ArmArrays, scratch: ArmScratch, mesh: int, other: int, need: float, hit: float
) -> int:
    """Two meshes: FREE from `need` on, COLLIDING below `hit`."""
    # The first mesh in the world.
    place_mesh(arm, scratch, mesh)
    T, A, B = scratch.mesh_frame, scratch.frames, arm.mesh_frames
    joint = arm.meshes[other, MESH_JOINT]
    # T_mesh_other, column by column, in the last rows of the points.
    points = scratch.mesh_points
    for j in range(4):
        # A column of the other mesh's frame in the world, seen from the first.
        x = A[joint, 0, 0] * B[other, 0, j] + A[joint, 0, 1] * B[other, 1, j]
        y = A[joint, 1, 0] * B[other, 0, j] + A[joint, 1, 1] * B[other, 1, j]
        z = A[joint, 2, 0] * B[other, 0, j] + A[joint, 2, 1] * B[other, 1, j]
        x += A[joint, 0, 2] * B[other, 2, j]
        y += A[joint, 1, 2] * B[other, 2, j]
        z += A[joint, 2, 2] * B[other, 2, j]
        if j == 3:
            x += A[joint, 0, 3] - T[0, 3]
            y += A[joint, 1, 3] - T[1, 3]
            z += A[joint, 2, 3] - T[2, 3]
        for i in range(3):
            points[j, i] = T[0, i] * x + T[1, i] * y + T[2, i] * z
    # Into a matrix, for the meshes to be compared.
    for i in range(3):
        for j in range(4):
            T[i, j] = points[j, i]
    return meshes_meet(
        arm.trees,
        arm.meshes[mesh, MESH_TREE],
        arm.meshes[other, MESH_TREE],
        T,
        need,
        hit,
        scratch.stack,
        points,
        scratch.work,
    )
