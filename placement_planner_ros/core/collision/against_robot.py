"""Links and held object against each other, coarse to fine.

Bounding spheres of bodies and parts, then the direction that last kept two parts apart, then their
distance (`separation`), or that of the meshes that they cover. That bodies keep their distance is
certain: spheres hold what they bound, along a direction d two sets are at least
(min d·a - max d·b) / |d| apart, and `separation` proves its own. What runs in the innermost loops
is written into its callers (`inline`).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement_planner_ros.core.collision import arrays as at
from placement_planner_ros.core.collision.against_boxes import MESH_MOTION_M, SET_MOTION_M
from placement_planner_ros.core.collision.arrays import ArmArrays, ArmScratch
from placement_planner_ros.core.collision.placed_meshes import solids_keep
from placement_planner_ros.core.collision.placing import place_set
from placement_planner_ros.core.collision.separation import BOUND_TOLERANCE_M, sets_keep
from placement_planner_ros.core.reach.kinematics import to_world
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _support_gap(
    arm: ArmArrays, scratch: ArmScratch, a: int, b: int, direction: tuple[float, float, float]
) -> float:
    """How far apart the hulls of sets a and b lie along a world direction, at least (times |d|).

    min d·a - max d·b, over the vertices where they are stored: d is turned into their frames
    instead of them into the world.
    """
    vertices, frames, sets = arm.vertices, scratch.frames, arm.sets
    dx, dy, dz = direction
    gap = 0.0
    for side in range(2):
        # The direction in the frame of the joint that moves the set, turned about for b.
        s = a if side == 0 else b
        sign = 1.0 - 2.0 * side
        joint = sets[s, at.SET_JOINT]
        lx = sign * (frames[joint, 0, 0] * dx + frames[joint, 1, 0] * dy + frames[joint, 2, 0] * dz)
        ly = sign * (frames[joint, 0, 1] * dx + frames[joint, 1, 1] * dy + frames[joint, 2, 1] * dz)
        lz = sign * (frames[joint, 0, 2] * dx + frames[joint, 1, 2] * dy + frames[joint, 2, 2] * dz)
        # Two running minima, so that one does not wait for the other.
        first, last = sets[s, at.SET_FIRST_VERTEX], sets[s + 1, at.SET_FIRST_VERTEX]
        lowest = lx * vertices[first, 0] + ly * vertices[first, 1] + lz * vertices[first, 2]
        other = lowest
        for v in range(first + (last - first) % 2, last, 2):
            one = lx * vertices[v, 0] + ly * vertices[v, 1] + lz * vertices[v, 2]
            two = lx * vertices[v + 1, 0] + ly * vertices[v + 1, 1] + lz * vertices[v + 1, 2]
            lowest = one if one < lowest else lowest
            other = two if two < other else other
        lowest = min(lowest, other)
        # The joint's position along the direction.
        gap += lowest + sign * (
            frames[joint, 0, 3] * dx + frames[joint, 1, 3] * dy + frames[joint, 2, 3] * dz
        )
    return gap


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _parts_keep(
    arm: ArmArrays, scratch: ArmScratch, s: int, t: int, slot: int, need: float, motion: float
) -> bool:
    """Whether two convex sets keep `need`, first along the direction that last kept them apart.

    It is remembered in the frames of both: which of them it rests in depends on what turned.
    """
    frames, sets, known, work = scratch.frames, arm.sets, scratch.direction, scratch.work
    radius, bounds, now = arm.radius[s] + arm.radius[t], scratch.bounds, scratch.stamp[0]
    far = need + radius + BOUND_TOLERANCE_M
    # The remembered direction, as it turned with the one and with the other.
    work[5, :3] = 0.0
    widest = -np.inf
    for side in range(2):
        # The direction as it was last remembered in this frame, turned into the world.
        joint = sets[t if side == 1 else s, at.SET_JOINT]
        x, y, z = known[slot, 3 * side], known[slot, 3 * side + 1], known[slot, 3 * side + 2]
        length = np.sqrt(x * x + y * y + z * z)
        if length == 0.0:
            break
        dx = frames[joint, 0, 0] * x + frames[joint, 0, 1] * y + frames[joint, 0, 2] * z
        dy = frames[joint, 1, 0] * x + frames[joint, 1, 1] * y + frames[joint, 1, 2] * z
        dz = frames[joint, 2, 0] * x + frames[joint, 2, 1] * y + frames[joint, 2, 2] * z
        # How far the sets are apart along it.
        gap = _support_gap(arm, scratch, s, t, (dx, dy, dz))
        if gap >= far * length:
            return True
        # Keep the direction of the widest gap as the start.
        if gap > widest * length:
            widest = gap / length
            work[5, 0], work[5, 1], work[5, 2] = dx, dy, dz
    # Not along it: a shorter interval will tell.
    if motion > SET_MOTION_M:
        return False
    # Put the sets where they are, unless another pair has.
    for part in (s, t):
        if scratch.set_stamp[part] < now:
            scratch.set_stamp[part] = now
            place_set(arm, scratch, part)
    # Without a start, the line from the middle of t to that of s.
    if work[5, 0] == 0.0 and work[5, 1] == 0.0 and work[5, 2] == 0.0:
        for i in range(3):
            work[5, i] = bounds[s, i] + bounds[s, i + 3] - bounds[t, i] - bounds[t, i + 3]
    # The distance of both hulls, with their radii added.
    first, last = sets[s, at.SET_FIRST_VERTEX], sets[s + 1, at.SET_FIRST_VERTEX]
    one = (scratch.vertices, first, last)
    first, last = sets[t, at.SET_FIRST_VERTEX], sets[t + 1, at.SET_FIRST_VERTEX]
    if not sets_keep(one, (scratch.vertices, first, last), need + radius, work):
        return False
    # Remember where that ended, in the frames of both joints.
    for side in range(2):
        joint = sets[t if side == 1 else s, at.SET_JOINT]
        for i in range(3):
            known[slot, 3 * side + i] = (
                frames[joint, 0, i] * work[5, 0]
                + frames[joint, 1, i] * work[5, 1]
                + frames[joint, 2, i] * work[5, 2]
            )
    return True


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def tabled_apart(arm: ArmArrays, pair: int, q: Array, delta: Array) -> bool:
    """Whether a pair's table says that it is `clear` apart wherever joints are within ±delta of q.

    Its cells say how many cells away the nearest is that is not apart.
    """
    rows, columns = arm.pairs[pair, at.PAIR_ROWS], arm.pairs[pair, at.PAIR_COLUMNS]
    if rows == 0:
        return False
    # The rows and columns of cells that the ranges touch, all of them in the table.
    joint, per_rad = arm.pairs[pair, at.PAIR_OUTWARD], 1.0 / at.CELL_RAD
    x, y, wide, high = (q[joint] - arm.pair_lower[pair, 0]) * per_rad, 0.5, delta[joint], 0.0
    if columns > 1:
        y, high = (q[joint + 1] - arm.pair_lower[pair, 1]) * per_rad, delta[joint + 1]
    x0, x1 = x - wide * per_rad, x + wide * per_rad
    y0, y1 = y - high * per_rad, y + high * per_rad
    if not (x0 >= 0.0 and x1 < rows and y0 >= 0.0 and y1 < columns):
        return False
    # Along the longer side of what they touch, halfway across it: each cell tells of a square that
    # begins where the last one ended.
    begin, end, low, last, step, across = int(x0), int(x1), int(y0), int(y1), columns, 1
    if end - begin < last - low:
        begin, end, low, last, step, across = low, last, begin, end, 1, columns
    middle = (low + last) // 2
    half = last - middle
    while begin <= end:
        here = min(begin, end - 2 * half) + half
        away = arm.tables[arm.pairs[pair, at.PAIR_CELL] + here * step + middle * across]
        if away <= half:
            return False
        begin = here + away
    return True


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _pair_keeps(
    arm: ArmArrays, scratch: ArmScratch, pair: int, margin: float, motion: float
) -> float:
    """How much of a motion the parts of a pair of bodies certainly keep beside the margin.

    Args:
        motion: metres; much of it is left to shorter intervals.

    Returns:
        `motion`; 0 where only the margin is kept for sure, or -1 where not even that.
    """
    bodies, sets, bounds = arm.bodies, arm.sets, scratch.bounds
    body_spheres, spheres, balls = scratch.body_spheres, scratch.set_spheres, arm.node_spheres
    a, b = arm.pairs[pair, at.PAIR_INNER], arm.pairs[pair, at.PAIR_OUTER]
    # The balls around their sets, the first of their trees, unless they have been placed.
    for body in (a, b):
        if scratch.body_stamp[body] < scratch.stamp[0]:
            scratch.body_stamp[body] = scratch.stamp[0]
            joint = bodies[body, at.BODY_JOINT]
            for s in range(bodies[body, at.BODY_FIRST_SET], bodies[body + 1, at.BODY_FIRST_SET]):
                node = sets[s, at.SET_FIRST_NODE]
                spheres[s, 0], spheres[s, 1], spheres[s, 2] = to_world(
                    scratch.frames, joint, balls[node, 0], balls[node, 1], balls[node, 2]
                )
    # Where the directions of their parts are remembered.
    fixed = a >= arm.moving
    slot = arm.pairs[pair, at.PAIR_SLOT]
    first_b, last_b = bodies[b, at.BODY_FIRST_SET], bodies[b + 1, at.BODY_FIRST_SET]
    apart = apart_other = -1
    # Sets of the one against all of the other, then against its sets.
    for s in range(bodies[a, at.BODY_FIRST_SET], bodies[a + 1, at.BODY_FIRST_SET]):
        slot += last_b - first_b
        # The set's ball against the ball around all of the other body.
        x, y, z = spheres[s, 0], spheres[s, 1], spheres[s, 2]
        dx, dy, dz = x - body_spheres[b, 0], y - body_spheres[b, 1], z - body_spheres[b, 2]
        reach = spheres[s, 3] + body_spheres[b, 3] + margin + motion + BOUND_TOLERANCE_M
        if dx * dx + dy * dy + dz * dz > reach * reach:
            continue
        t = first_b
        while t < last_b:
            need = margin + motion
            far = need + BOUND_TOLERANCE_M
            # Ball against ball.
            dx, dy, dz = x - spheres[t, 0], y - spheres[t, 1], z - spheres[t, 2]
            reach = spheres[s, 3] + spheres[t, 3] + far
            square = dx * dx + dy * dy + dz * dz
            if square > reach * reach:
                t += 1
                continue
            # Centres lie inside, and are too near for what moves: only the margin is left to keep.
            if motion > 0.0 and square < need * need:
                motion = 0.0
                continue
            if fixed:
                # The box around a fixed set is known for good, and tighter than its ball.
                dx = max(bounds[s, 0] - spheres[t, 0], 0.0, spheres[t, 0] - bounds[s, 3])
                dy = max(bounds[s, 1] - spheres[t, 1], 0.0, spheres[t, 1] - bounds[s, 4])
                dz = max(bounds[s, 2] - spheres[t, 2], 0.0, spheres[t, 2] - bounds[s, 5])
                reach = spheres[t, 3] + far
                if dx * dx + dy * dy + dz * dz > reach * reach:
                    t += 1
                    continue
            # Both convex sets; the meshes as wholes, once for all of their sets; of a set without,
            # only it.
            mesh, other = sets[s, at.SET_MESH], sets[t, at.SET_MESH]
            known = mesh == apart and other == apart_other and mesh >= 0 and other >= 0
            covers = (mesh >= 0 or other >= 0) and motion <= MESH_MOTION_M
            if _parts_keep(arm, scratch, s, t, slot - last_b + t, need, motion) or known:
                t += 1
            elif covers and solids_keep(arm, scratch, s, t, need):
                apart, apart_other = mesh, other
                t += 1
            elif motion > 0.0:
                motion = 0.0
            else:
                scratch.hit[0], scratch.hit[1], scratch.hit[2] = 1, s, t
                return -1.0
    return motion


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def pairs_keep(arm: ArmArrays, scratch: ArmScratch, count: int, margin: float) -> bool:
    """Whether pairs of bodies, those among the first `count` items asked for, certainly keep the
    margin.

    The scratch's `motion` says how far both of a pair move to each other, metres, of which much is
    left to shorter intervals; what is not kept of that beside the margin is set to 0. Joints are in
    the ranges of the scratch's `edge`.
    """
    spheres, pairs, q, delta = scratch.body_spheres, arm.pairs, scratch.edge[0], scratch.edge[2]
    for k in range(count):
        item = scratch.asked[k]
        if item < arm.moving:
            continue
        # The balls around both bodies.
        pair, motion = item - arm.moving, scratch.motion[item]
        a, b = pairs[pair, at.PAIR_INNER], pairs[pair, at.PAIR_OUTER]
        dx = spheres[a, 0] - spheres[b, 0]
        dy = spheres[a, 1] - spheres[b, 1]
        dz = spheres[a, 2] - spheres[b, 2]
        reach = spheres[a, 3] + spheres[b, 3] + margin + motion + BOUND_TOLERANCE_M
        if dx * dx + dy * dy + dz * dz > reach * reach:
            continue
        # What their table knows of the ranges of joints.
        if margin <= arm.clear and tabled_apart(arm, pair, q, delta):
            continue
        # Their parts.
        kept = _pair_keeps(arm, scratch, pair, margin, motion)
        if kept < 0.0:
            return False
        scratch.motion[item] = kept
    return True
