"""Placing the arm's geometry in the world: the joints at once, convex sets as they are needed."""

from __future__ import annotations

import numpy as np
from numba import njit

from placement_planner_ros.core.collision import arrays as at
from placement_planner_ros.core.collision.arrays import ArmArrays, ArmScratch
from placement_planner_ros.core.reach.kinematics import chain_frames, to_world
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def place_joints(arm: ArmArrays, scratch: ArmScratch, q: Array) -> None:
    """Forward kinematics at q (n,); whatever was placed in the world before is outdated."""
    # A new stamp outdates all that was placed before.
    scratch.stamp[0] += 1
    chain_frames(arm.fixed, arm.prismatic, q, scratch.frames)


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def place_spheres(arm: ArmArrays, scratch: ArmScratch, count: int) -> None:
    """Bounding spheres of the first bodies, so many."""
    local, world = arm.body_spheres, scratch.body_spheres
    for body in range(count):
        world[body, 0], world[body, 1], world[body, 2] = to_world(
            scratch.frames,
            arm.bodies[body, at.BODY_JOINT],
            local[body, 0],
            local[body, 1],
            local[body, 2],
        )


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def place_set(arm: ArmArrays, scratch: ArmScratch, s: int) -> None:
    """Vertices and box of convex set s in the world."""
    frames = scratch.frames
    sets = arm.sets
    local, world = arm.vertices, scratch.vertices
    bounds = scratch.bounds
    # One coordinate of all vertices, and the span that it covers.
    joint = sets[s, at.SET_JOINT]
    radius = arm.radius[s]
    for i in range(3):
        low = np.inf
        high = -np.inf
        r0, r1, r2 = frames[joint, i, 0], frames[joint, i, 1], frames[joint, i, 2]
        p = frames[joint, i, 3]
        for v in range(sets[s, at.SET_FIRST_VERTEX], sets[s + 1, at.SET_FIRST_VERTEX]):
            w = p + r0 * local[v, 0] + r1 * local[v, 1] + r2 * local[v, 2]
            world[v, i] = w
            low = min(low, w)
            high = max(high, w)
        # The box around the set, its radius included.
        bounds[s, i] = low - radius
        bounds[s, i + 3] = high + radius
