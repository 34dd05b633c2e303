"""Placing the arm's geometry in the world: the joints at once, convex sets as they are needed."""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.collision.arrays import (
    BODY_FIRST_PART,
    BODY_JOINT,
    SET_FIRST_PLANE,
    SET_FIRST_VERTEX,
    SET_JOINT,
    ArmArrays,
    ArmScratch,
    Indices,
)
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.reach.kinematics import chain_frames, to_world
from placement_planner_ros.core.types import Array


@kernel(lean=True)
def is_finite(q: Array) -> bool:
    """Whether every number of q (n,) is finite."""
    # A sum is finite only if all its terms are.
    total = 0.0
    for j in range(q.shape[0]):
        total += q[j]
    return bool(np.isfinite(total))


@kernel(inline=True)
def place_joints(arm: ArmArrays, scratch: ArmScratch, q: Array) -> None:
    """Forward kinematics at q (n,); whatever was placed in the world before is outdated."""
    # A new stamp outdates all that was placed before.
    scratch.counters[0] += 1
    chain_frames(arm.fixed, arm.prismatic, q, scratch.frames)


@kernel(inline=True)
def place_spheres(arm: ArmArrays, scratch: ArmScratch, body: int) -> None:
    """Bounding spheres of a moving body and of its parts, its joint's frame being placed."""
    frames, bodies = scratch.frames, arm.bodies
    local, world = arm.body_spheres, scratch.body_spheres
    part_local, part_world = arm.part_spheres, scratch.part_spheres
    joint = bodies[body, BODY_JOINT]
    # The ball around the body.
    world[body, 0], world[body, 1], world[body, 2] = to_world(
        frames, joint, local[body, 0], local[body, 1], local[body, 2]
    )
    # The balls around its parts.
    for part in range(bodies[body, BODY_FIRST_PART], bodies[body + 1, BODY_FIRST_PART]):
        part_world[part, 0], part_world[part, 1], part_world[part, 2] = to_world(
            frames, joint, part_local[part, 0], part_local[part, 1], part_local[part, 2]
        )


@kernel(lean=True)
def place_all_spheres(arm: ArmArrays, scratch: ArmScratch) -> None:
    """Bounding spheres of all moving bodies and their parts."""
    for body in range(arm.moving):
        place_spheres(arm, scratch, body)


@kernel(inline=True)
def place_set(arm: ArmArrays, scratch: ArmScratch, s: int) -> None:
    """Vertices and box of convex set s in the world."""
    frames = scratch.frames
    sets = arm.sets
    local, world = arm.vertices, scratch.vertices
    bounds = scratch.bounds
    # One coordinate of all vertices, and the span that it covers.
    joint = sets[s, SET_JOINT]
    radius = arm.radius[s]
    for i in range(3):
        low = np.inf
        high = -np.inf
        r0, r1, r2 = frames[joint, i, 0], frames[joint, i, 1], frames[joint, i, 2]
        p = frames[joint, i, 3]
        for v in range(sets[s, SET_FIRST_VERTEX], sets[s + 1, SET_FIRST_VERTEX]):
            w = p + r0 * local[v, 0] + r1 * local[v, 1] + r2 * local[v, 2]
            world[v, i] = w
            low = min(low, w)
            high = max(high, w)
        # The box around the set, its radius included.
        bounds[s, i] = low - radius
        bounds[s, i + 3] = high + radius


@kernel(lean=True)
def place_inner(arm: ArmArrays, scratch: ArmScratch, s: int, first: int) -> int:
    """Put the scaled copy of convex set s, placed, from row `first` of `inner` on; its end."""
    frames, joint = scratch.frames, arm.sets[s, SET_JOINT]
    # The centre that the copy shrinks towards.
    scale = arm.inner[s, 3]
    x, y, z = to_world(frames, joint, arm.inner[s, 0], arm.inner[s, 1], arm.inner[s, 2])
    # Each vertex, drawn towards it.
    row = first
    for v in range(arm.sets[s, SET_FIRST_VERTEX], arm.sets[s + 1, SET_FIRST_VERTEX]):
        scratch.inner[row, 0] = x + scale * (scratch.vertices[v, 0] - x)
        scratch.inner[row, 1] = y + scale * (scratch.vertices[v, 1] - y)
        scratch.inner[row, 2] = z + scale * (scratch.vertices[v, 2] - z)
        row += 1
    return row


@kernel(inline=True)
def place_planes(arm: ArmArrays, scratch: ArmScratch, s: int) -> None:
    """Planes of convex set s in the world."""
    frames, sets = scratch.frames, arm.sets
    # Each normal turned, its offset moved along it.
    joint = sets[s, SET_JOINT]
    planes, moved = arm.planes, scratch.planes
    for v in range(sets[s, SET_FIRST_PLANE], sets[s + 1, SET_FIRST_PLANE]):
        offset = planes[v, 3]
        for i in range(3):
            n = (
                frames[joint, i, 0] * planes[v, 0]
                + frames[joint, i, 1] * planes[v, 1]
                + frames[joint, i, 2] * planes[v, 2]
            )
            moved[v, i] = n
            offset += n * frames[joint, i, 3]
        moved[v, 3] = offset


@kernel(lean=True)
def note_undecided(undecided: Indices, counters: Indices, kind: int, a: int, b: int) -> None:
    """Add a row to `ArmScratch.undecided`; where it is full, only count."""
    # Filled rows are no more than the array has.
    n = counters[2]
    if n < undecided.shape[0]:
        undecided[n, 0] = kind
        undecided[n, 1] = a
        undecided[n, 2] = b
    counters[2] = n + 1
