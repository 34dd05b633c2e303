"""Links and held object against each other, coarse to fine.

Bounding spheres of bodies and parts, then the direction that last kept two parts apart, then their
distance (`separation`). Every answer but UNDECIDED is certain: spheres hold what they bound, along
a direction d two sets are at least (min d·a - max d·b) / |d| apart, and `separation` proves its
own. What runs in the innermost loops is written into its callers (`inline`).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement_planner_ros.core.collision import arrays as at
from placement_planner_ros.core.collision.against_mesh import COARSE_MOTION_M
from placement_planner_ros.core.collision.arrays import ArmArrays, ArmScratch, Indices
from placement_planner_ros.core.collision.pair_tables import apart_within
from placement_planner_ros.core.collision.placed_meshes import mesh_meets_set, placed_meshes_meet
from placement_planner_ros.core.collision.placing import note_hit, place_set
from placement_planner_ros.core.collision.separation import (
    BOUND_TOLERANCE_M,
    COLLIDING,
    FREE,
    UNDECIDED,
    check_separation,
)
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted

COVERS_MEET = 3
"""Two parts whose covers do not settle how near their meshes are."""


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _sets_meet(
    arm: ArmArrays,
    scratch: ArmScratch,
    a: int,
    b: int,
    need: float,
    hit: float,
) -> int:
    """Two convex sets; work[5, :3] is where to start (zero: anywhere), and where it ended.

    Sets of covers only say what is free, or by how much more than their excess `need` cannot be
    kept; the rest is left to the meshes.
    """
    now = scratch.counters[0]
    bounds = scratch.bounds
    # Put them where they are, unless another pair has.
    for s in (a, b):
        if scratch.set_stamp[s] < now:
            scratch.set_stamp[s] = now
            place_set(arm, scratch, s)
    # Without a start, the line from the middle of b to that of a.
    work = scratch.work
    if work[5, 0] == 0.0 and work[5, 1] == 0.0 and work[5, 2] == 0.0:
        for i in range(3):
            work[5, i] = bounds[a, i] + bounds[a, i + 3] - bounds[b, i] - bounds[b, i + 3]
    sets = arm.sets
    radius = arm.radius[a] + arm.radius[b]
    covers = sets[a, at.SET_MESH] >= 0 or sets[b, at.SET_MESH] >= 0
    # The sets collide below `hit`; covers below what their excess cannot explain.
    short = need - arm.excess[a] - arm.excess[b]
    closer = hit
    if covers:
        closer = short if short > hit else 0.0
    # The distance between both hulls, with their radii added.
    answer = check_separation(
        scratch.vertices,
        sets[a, at.SET_FIRST_VERTEX],
        sets[a + 1, at.SET_FIRST_VERTEX],
        scratch.vertices,
        sets[b, at.SET_FIRST_VERTEX],
        sets[b + 1, at.SET_FIRST_VERTEX],
        need + radius,
        closer + radius,
        work,
    )
    # Covers that meet leave it to the meshes, unless they are deeper in each other than they stick
    # out.
    if answer != FREE and covers:
        return COVERS_MEET if short <= hit or answer != COLLIDING else UNDECIDED
    if answer != FREE:
        note_hit(scratch, 1, a, b)
    return answer


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
def _solids_meet(
    arm: ArmArrays, scratch: ArmScratch, s: int, t: int, slot: int, need: float, hit: float
) -> int:
    """Two solid parts, first along the direction that last kept them apart.

    It is remembered in the frames of both: which of them it rests in depends on what turned.
    Where `need` is far above `hit`, being apart is enough to leave the rest to shorter intervals.
    """
    frames, sets, known, work = scratch.frames, arm.sets, scratch.direction, scratch.work
    far = need + arm.radius[s] + arm.radius[t] + BOUND_TOLERANCE_M
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
            return FREE
        # Apart already, though not by `need`: a shorter interval will tell.
        if need - hit > COARSE_MOTION_M and gap >= (far - need + hit) * length:
            return UNDECIDED
        # Keep the direction of the widest gap as the start.
        if gap > widest * length:
            widest = gap / length
            work[5, 0], work[5, 1], work[5, 2] = dx, dy, dz
    # The distance itself, from the better of both on; remember where it ended.
    answer = _sets_meet(arm, scratch, s, t, need, hit)
    if answer == FREE:
        # The direction in the frames of both joints.
        for side in range(2):
            joint = sets[t if side == 1 else s, at.SET_JOINT]
            for i in range(3):
                known[slot, 3 * side + i] = (
                    frames[joint, 0, i] * work[5, 0]
                    + frames[joint, 1, i] * work[5, 1]
                    + frames[joint, 2, i] * work[5, 2]
                )
    return answer


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def spheres_apart(scratch: ArmScratch, pair: Indices, need: float) -> bool:
    """Whether the bounding spheres of a pair of bodies (row of `ArmArrays.pairs`) keep `need`."""
    # The line between both centres, against the radii.
    spheres = scratch.body_spheres
    a, b = pair[at.PAIR_INNER], pair[at.PAIR_OUTER]
    dx = spheres[a, 0] - spheres[b, 0]
    dy = spheres[a, 1] - spheres[b, 1]
    dz = spheres[a, 2] - spheres[b, 2]
    reach = spheres[a, 3] + spheres[b, 3] + need + BOUND_TOLERANCE_M
    return dx * dx + dy * dy + dz * dz > reach * reach


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _meshes_meet(
    arm: ArmArrays, scratch: ArmScratch, a: int, b: int, need: float, hit: float
) -> int:
    """What sets a and b are parts of, the meshes themselves where there are any."""
    # Two meshes, or a mesh and a convex set.
    sets = arm.sets
    mesh, other = sets[a, at.SET_MESH], sets[b, at.SET_MESH]
    if mesh >= 0 and other >= 0:
        answer = placed_meshes_meet(arm, scratch, mesh, other, need, hit)
    else:
        s = b if mesh >= 0 else a
        answer = mesh_meets_set(arm, scratch, max(mesh, other), s, need, hit)
    if answer != FREE:
        note_hit(scratch, 1, a, b)
    return answer


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def bodies_meet(arm: ArmArrays, scratch: ArmScratch, pair: int, need: float, hit: float) -> int:
    """One pair of bodies: FREE if they keep `need`, COLLIDING if they are closer than `hit`.

    What is left UNDECIDED is noted as `hit`. Once `need` cannot be kept any more, only
    collisions are looked for.
    """
    bodies, sets, bounds = arm.bodies, arm.sets, scratch.bounds
    body_spheres, spheres = scratch.body_spheres, scratch.set_spheres
    # The bodies of the pair, and where the directions of their parts are remembered.
    a, b = arm.pairs[pair, at.PAIR_INNER], arm.pairs[pair, at.PAIR_OUTER]
    fixed = a >= arm.moving
    slot = arm.pairs[pair, at.PAIR_SLOT]
    first_b, last_b = bodies[b, at.BODY_FIRST_SET], bodies[b + 1, at.BODY_FIRST_SET]
    result = FREE
    apart = apart_other = -1
    # Sets of the one against all of the other, then against its sets.
    for s in range(bodies[a, at.BODY_FIRST_SET], bodies[a + 1, at.BODY_FIRST_SET]):
        slot += last_b - first_b
        # The set's ball against the ball around all of the other body.
        x, y, z = spheres[s, 0], spheres[s, 1], spheres[s, 2]
        near = spheres[s, 3] + need + BOUND_TOLERANCE_M
        dx, dy, dz = x - body_spheres[b, 0], y - body_spheres[b, 1], z - body_spheres[b, 2]
        reach = near + body_spheres[b, 3]
        if dx * dx + dy * dy + dz * dz > reach * reach:
            continue
        for t in range(first_b, last_b):
            # Ball against ball.
            dx, dy, dz = x - spheres[t, 0], y - spheres[t, 1], z - spheres[t, 2]
            reach = near + spheres[t, 3]
            square = dx * dx + dy * dy + dz * dz
            if square > reach * reach:
                continue
            if need > hit and square < need * need:
                # Centres lie inside: `need` cannot be kept. Look for a collision, if there can be.
                result = UNDECIDED
                need = hit
                near = spheres[s, 3] + need + BOUND_TOLERANCE_M
                reach = near + spheres[t, 3]
                if square > reach * reach:
                    continue
            if fixed:
                # The box around a fixed set is known for good, and tighter than its ball.
                dx = max(bounds[s, 0] - spheres[t, 0], 0.0, spheres[t, 0] - bounds[s, 3])
                dy = max(bounds[s, 1] - spheres[t, 1], 0.0, spheres[t, 1] - bounds[s, 4])
                dz = max(bounds[s, 2] - spheres[t, 2], 0.0, spheres[t, 2] - bounds[s, 5])
                reach = spheres[t, 3] + need + BOUND_TOLERANCE_M
                if dx * dx + dy * dy + dz * dz > reach * reach:
                    continue
            # Both convex sets.
            answer = _solids_meet(arm, scratch, s, t, slot - last_b + t, need, hit)
            if answer == COVERS_MEET:
                # The meshes as wholes, once for all of their sets; of a set without, only it.
                mesh, other = sets[s, at.SET_MESH], sets[t, at.SET_MESH]
                if mesh == apart and other == apart_other and mesh >= 0 and other >= 0:
                    continue
                answer = _meshes_meet(arm, scratch, s, t, need, hit)
                if answer == FREE:
                    apart, apart_other = mesh, other
            if answer == COLLIDING:
                return COLLIDING
            # The distance cannot be kept any more: only collisions are looked for.
            if answer == UNDECIDED:
                result = UNDECIDED
                need = hit
                near = spheres[s, 3] + need + BOUND_TOLERANCE_M
    return result


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def pair_meets(
    arm: ArmArrays,
    scratch: ArmScratch,
    pair: int,
    ranges: tuple[Array, Array],
    need: float,
    margin: float,
) -> int:
    """One pair of bodies, placed at q (n,): FREE if it keeps `margin` wherever in q ± delta (n,).

    Args:
        ranges: q and delta.
        need: `margin` and the bound on the pair's motion within delta, metres.
    """
    row = arm.pairs[pair]
    # The balls around both bodies.
    if spheres_apart(scratch, row, need):
        return FREE
    # Tables know of whole ranges of joints.
    table, joint = row[at.PAIR_TABLE], row[at.PAIR_OUTWARD]
    q, delta = ranges
    second = min(joint + 1, q.shape[0] - 1)
    if (
        table >= 0
        and margin <= arm.tables.clear
        and apart_within(arm.tables, table, q[joint], q[second], delta[joint], delta[second])
    ):
        return FREE
    # The bodies part by part.
    return bodies_meet(arm, scratch, pair, need, margin)
