"""Compiled collision queries on the arrays of `collision_arrays`: configurations and whole edges.

A configuration is settled coarse to fine: spheres against the field of distance bounds, then the
cells near a leaf sphere, then the face planes of the convex set, then the distance between set and
box (`separation`). Every answer but UNDECIDED is certain.

The bound on motion: let the joints move by at most δ_j from q. Change them one by one, outermost
first. While joint k turns, the joints above it still stand at q, and a point that was at most ρ_k
from its axis at q has since strayed by m_{k+1} at most; so m_k = m_{k+1} + δ_k (ρ_k + m_{k+1}),
and m_{k+1} + δ_k where the joint slides.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.robot.collision_arrays import (
    BODY_FIRST_PART,
    BODY_JOINT,
    NODE_FIRST,
    NODE_LAST,
    NODE_SKIP,
    PAIR_INNER,
    PAIR_OUTER,
    PAIR_OUTWARD,
    PAIR_SLOT,
    PART_FIRST_NODE,
    PART_FIRST_SET,
    PART_SOLID,
    SET_EXACT,
    SET_FIRST_PLANE,
    SET_FIRST_VERTEX,
    SET_JOINT,
    ArmArrays,
    ArmScratch,
    Indices,
)
from placement_planner_ros.core.robot.kinematics import chain_frames
from placement_planner_ros.core.robot.separation import (
    COLLIDING,
    FREE,
    TOLERANCE,
    UNDECIDED,
    separate_box,
    separate_hulls,
)
from placement_planner_ros.core.types import Array

OVERFLOW = 3
"""An edge needs more intervals than the queue holds: cut it in two."""

NOT_FINITE = 4
"""A configuration holds a NaN or an infinity."""

_COARSE = 0.02
"""Metres of motion above which an interval is searched for collisions rather than certified."""


class BoxArrays(NamedTuple):
    """The obstacle set for the kernels: m boxes, each within its cell."""

    number: int
    rows: npt.NDArray[np.int32]
    """(nx, ny, nz) cell to its first box, or -1."""
    next: npt.NDArray[np.int32]
    """(m,) another box of the same cell, or -1."""
    corners: Array
    """(m, 6) lower then upper."""
    grid: Array
    """(4,) lower corner of the grid, and its cell size."""
    field_grid: Array
    """(10,) the like of the field, then the box around all boxes, lower and upper."""
    field: npt.NDArray[np.float32]
    """Lower bound of the distance at each cell's centre."""


@njit(cache=True, inline="always")
def distance_bound(
    grid: Array, field: npt.NDArray[np.float32], x: float, y: float, z: float
) -> float:
    """A lower bound of the distance of a point to all boxes (`field_grid`, `field`)."""
    size = grid[3]
    fx = (x - grid[0]) / size
    fy = (y - grid[1]) / size
    fz = (z - grid[2]) / size
    i = int(np.floor(fx))
    j = int(np.floor(fy))
    k = int(np.floor(fz))
    if 0 <= i < field.shape[0] and 0 <= j < field.shape[1] and 0 <= k < field.shape[2]:
        fx -= i + 0.5
        fy -= j + 0.5
        fz -= k + 0.5
        return field[i, j, k] - size * np.sqrt(fx * fx + fy * fy + fz * fz)
    dx = max(grid[4] - x, 0.0, x - grid[7])
    dy = max(grid[5] - y, 0.0, y - grid[8])
    dz = max(grid[6] - z, 0.0, z - grid[9])
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@njit(cache=True, inline="always")
def _to_world(
    frames: Array, joint: int, x: float, y: float, z: float
) -> tuple[float, float, float]:
    return (
        frames[joint, 0, 3]
        + frames[joint, 0, 0] * x
        + frames[joint, 0, 1] * y
        + frames[joint, 0, 2] * z,
        frames[joint, 1, 3]
        + frames[joint, 1, 0] * x
        + frames[joint, 1, 1] * y
        + frames[joint, 1, 2] * z,
        frames[joint, 2, 3]
        + frames[joint, 2, 0] * x
        + frames[joint, 2, 1] * y
        + frames[joint, 2, 2] * z,
    )


@njit(cache=True)
def is_finite(q: Array) -> bool:
    """Whether every number of q (n,) is finite."""
    total = 0.0
    for j in range(q.shape[0]):
        total += q[j]
    return bool(np.isfinite(total))


@njit(cache=True, inline="always")
def place_arm(arm: ArmArrays, scratch: ArmScratch, q: Array) -> None:
    """Forward kinematics at q (n,): joint frames, bounding spheres of moving bodies and parts.

    Whatever was placed in the world before counts as outdated.
    """
    scratch.counters[0] += 1
    frames = scratch.frames
    chain_frames(arm.fixed, arm.prismatic, q, frames)
    bodies = arm.bodies
    local, world = arm.body_spheres, scratch.body_spheres
    part_local, part_world = arm.part_spheres, scratch.part_spheres
    for body in range(arm.moving):
        joint = bodies[body, BODY_JOINT]
        world[body, 0], world[body, 1], world[body, 2] = _to_world(
            frames, joint, local[body, 0], local[body, 1], local[body, 2]
        )
        for part in range(bodies[body, BODY_FIRST_PART], bodies[body + 1, BODY_FIRST_PART]):
            part_world[part, 0], part_world[part, 1], part_world[part, 2] = _to_world(
                frames, joint, part_local[part, 0], part_local[part, 1], part_local[part, 2]
            )


@njit(cache=True, inline="always")
def _place_set(arm: ArmArrays, scratch: ArmScratch, s: int) -> None:
    """Vertices and box of convex set s in the world."""
    frames = scratch.frames
    sets = arm.sets
    local, world = arm.vertices, scratch.vertices
    bounds = scratch.bounds
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
        bounds[s, i] = low - radius
        bounds[s, i + 3] = high + radius


@njit(cache=True, inline="always")
def _place_planes(arm: ArmArrays, scratch: ArmScratch, s: int) -> None:
    """Planes of convex set s in the world."""
    frames, sets = scratch.frames, arm.sets
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


@njit(cache=True)
def polytope_meets_box(
    vertices: Array,
    first_vertex: int,
    last_vertex: int,
    planes: Array,
    first_plane: int,
    last_plane: int,
    closed: bool,
    bounds: Array,
    row: int,
    radius: float,
    corners: Array,
    box: int,
    need: float,
    hit: float,
    work: Array,
) -> int:
    """A convex set in the world against one box: FREE from distance `need`, COLLIDING below `hit`.

    Args:
        vertices, planes: (v, 3), (p, 4) of which the set's rows are the ranges given.
        closed: whether the planes enclose the set and nothing more.
        bounds: (s, 6), of which `row` is the box around the set, its radius included.
        corners: (m, 6), of which `box` is the box.
    """
    far = need + TOLERANCE
    for i in range(3):
        if (
            corners[box, i] - bounds[row, i + 3] >= far
            or bounds[row, i] - corners[box, i + 3] >= far
        ):
            return FREE
    cx = 0.5 * (corners[box, 0] + corners[box, 3])
    cy = 0.5 * (corners[box, 1] + corners[box, 4])
    cz = 0.5 * (corners[box, 2] + corners[box, 5])
    hx = corners[box, 3] - cx
    hy = corners[box, 4] - cy
    hz = corners[box, 5] - cz
    far += radius
    deepest = -np.inf
    best = -np.inf
    axis = -1
    for v in range(first_plane, last_plane):
        nx, ny, nz = planes[v, 0], planes[v, 1], planes[v, 2]
        middle = nx * cx + ny * cy + nz * cz - planes[v, 3]
        gap = middle - abs(nx) * hx - abs(ny) * hy - abs(nz) * hz
        if gap >= far:
            return FREE
        deepest = max(deepest, middle)
        if gap > best:
            best = gap
            axis = v
    if axis >= 0:
        if closed and deepest < -TOLERANCE:
            return COLLIDING
        work[5, 0], work[5, 1], work[5, 2] = -planes[axis, 0], -planes[axis, 1], -planes[axis, 2]
    else:
        work[5, 0] = bounds[row, 0] + bounds[row, 3] - 2 * cx
        work[5, 1] = bounds[row, 1] + bounds[row, 4] - 2 * cy
        work[5, 2] = bounds[row, 2] + bounds[row, 5] - 2 * cz
    return separate_box(
        vertices,
        first_vertex,
        last_vertex,
        corners,
        box,
        need + radius,
        hit + radius,
        work,
    )


@njit(cache=True, inline="always")
def _note(undecided: Indices, counters: Indices, kind: int, a: int, b: int) -> None:
    n = counters[2]
    if n < undecided.shape[0]:
        undecided[n, 0] = kind
        undecided[n, 1] = a
        undecided[n, 2] = b
    counters[2] = n + 1


@njit(cache=True)
def body_meets_boxes(
    arm: ArmArrays, boxes: BoxArrays, scratch: ArmScratch, body: int, need: float, hit: float
) -> int:
    """A moving body against the obstacle set; what is left UNDECIDED is noted in the scratch.

    Where `need` is far above `hit`, or cannot be kept any more, only collisions are looked for.
    """
    field, field_grid = boxes.field, boxes.field_grid
    rows, corners, following = boxes.rows, boxes.corners, boxes.next
    nodes, spheres, frames = arm.nodes, arm.node_spheres, scratch.frames
    parts, sets = arm.parts, arm.sets
    set_stamp, plane_stamp = scratch.set_stamp, scratch.plane_stamp
    box_stamp, counters = scratch.box_stamp, scratch.counters
    vertices, planes, bounds, work = (
        scratch.vertices,
        scratch.planes,
        scratch.bounds,
        scratch.work,
    )
    joint = arm.bodies[body, BODY_JOINT]
    ox, oy, oz, size = boxes.grid[0], boxes.grid[1], boxes.grid[2], boxes.grid[3]
    nx, ny, nz = rows.shape
    now = counters[0]
    near = need
    result = FREE
    if need - hit > _COARSE:
        near = hit
    for part in range(arm.bodies[body, BODY_FIRST_PART], arm.bodies[body + 1, BODY_FIRST_PART]):
        solid = parts[part, PART_SOLID] != 0
        if solid:
            counters[1] += 1
        node = parts[part, PART_FIRST_NODE]
        end = parts[part + 1, PART_FIRST_NODE]
        while node < end:
            x, y, z = _to_world(frames, joint, spheres[node, 0], spheres[node, 1], spheres[node, 2])
            radius = spheres[node, 3]
            bound = distance_bound(field_grid, field, x, y, z) - radius - TOLERANCE
            if bound >= need or (result == UNDECIDED and bound >= near):
                node = nodes[node, NODE_SKIP]
                continue
            if nodes[node, NODE_FIRST] < 0:
                node += 1
                continue
            if near < need:
                result = UNDECIDED
                if bound >= near:
                    node = nodes[node, NODE_SKIP]
                    continue
            if not solid:
                counters[1] += 1
            visit = counters[1]
            reach = radius + near + TOLERANCE
            i0 = max(int(np.floor((x - reach - ox) / size)), 0)
            j0 = max(int(np.floor((y - reach - oy) / size)), 0)
            k0 = max(int(np.floor((z - reach - oz) / size)), 0)
            i1 = min(int(np.floor((x + reach - ox) / size)) + 1, nx)
            j1 = min(int(np.floor((y + reach - oy) / size)) + 1, ny)
            k1 = min(int(np.floor((z + reach - oz) / size)) + 1, nz)
            for i in range(i0, i1):
                for j in range(j0, j1):
                    for k in range(k0, k1):
                        box = rows[i, j, k]
                        while box >= 0:
                            this = box
                            box = following[box]
                            if box_stamp[this] == visit:
                                continue
                            dx = max(corners[this, 0] - x, 0.0, x - corners[this, 3])
                            dy = max(corners[this, 1] - y, 0.0, y - corners[this, 4])
                            dz = max(corners[this, 2] - z, 0.0, z - corners[this, 5])
                            if dx * dx + dy * dy + dz * dz > reach * reach:
                                continue
                            box_stamp[this] = visit
                            for s in range(nodes[node, NODE_FIRST], nodes[node, NODE_LAST]):
                                if set_stamp[s] < now:
                                    set_stamp[s] = now
                                    _place_set(arm, scratch, s)
                                if plane_stamp[s] < now:
                                    plane_stamp[s] = now
                                    _place_planes(arm, scratch, s)
                                answer = polytope_meets_box(
                                    vertices,
                                    sets[s, SET_FIRST_VERTEX],
                                    sets[s + 1, SET_FIRST_VERTEX],
                                    planes,
                                    sets[s, SET_FIRST_PLANE],
                                    sets[s + 1, SET_FIRST_PLANE],
                                    True,
                                    bounds,
                                    s,
                                    arm.radius[s],
                                    corners,
                                    this,
                                    near,
                                    hit,
                                    work,
                                )
                                if answer == COLLIDING and sets[s, SET_EXACT] != 0:
                                    scratch.hit[0] = 0
                                    scratch.hit[1] = s
                                    scratch.hit[2] = this
                                    return COLLIDING
                                if answer != FREE:
                                    result = UNDECIDED
                                    near = hit
                                    _note(scratch.undecided, counters, 0, s, this)
            node = nodes[node, NODE_SKIP]
    return result


@njit(cache=True, inline="always")
def _sets_meet(
    arm: ArmArrays,
    scratch: ArmScratch,
    a: int,
    b: int,
    need: float,
    hit: float,
) -> int:
    """Two convex sets; work[5, :3] is where to start (zero: anywhere), and where it ended."""
    now = scratch.counters[0]
    bounds = scratch.bounds
    for s in (a, b):
        if scratch.set_stamp[s] < now:
            scratch.set_stamp[s] = now
            _place_set(arm, scratch, s)
    work = scratch.work
    if work[5, 0] == 0.0 and work[5, 1] == 0.0 and work[5, 2] == 0.0:
        for i in range(3):
            work[5, i] = bounds[a, i] + bounds[a, i + 3] - bounds[b, i] - bounds[b, i + 3]
    sets = arm.sets
    radius = arm.radius[a] + arm.radius[b]
    answer = separate_hulls(
        scratch.vertices,
        sets[a, SET_FIRST_VERTEX],
        sets[a + 1, SET_FIRST_VERTEX],
        sets[b, SET_FIRST_VERTEX],
        sets[b + 1, SET_FIRST_VERTEX],
        need + radius,
        hit + radius,
        work,
    )
    if answer == COLLIDING and sets[a, SET_EXACT] != 0 and sets[b, SET_EXACT] != 0:
        scratch.hit[0] = 1
        scratch.hit[1] = a
        scratch.hit[2] = b
        return COLLIDING
    if answer != FREE:
        _note(scratch.undecided, scratch.counters, 1, a, b)
        return UNDECIDED
    return FREE


@njit(cache=True, inline="always")
def _support_gap(
    vertices: Array,
    frames: Array,
    sets: Indices,
    a: int,
    b: int,
    dx: float,
    dy: float,
    dz: float,
) -> float:
    """How far apart the hulls of sets a and b lie along a world direction, at least (times |d|)."""
    gap = 0.0
    for side in range(2):
        s = a if side == 0 else b
        sign = 1.0 - 2.0 * side
        joint = sets[s, SET_JOINT]
        lx = sign * (frames[joint, 0, 0] * dx + frames[joint, 1, 0] * dy + frames[joint, 2, 0] * dz)
        ly = sign * (frames[joint, 0, 1] * dx + frames[joint, 1, 1] * dy + frames[joint, 2, 1] * dz)
        lz = sign * (frames[joint, 0, 2] * dx + frames[joint, 1, 2] * dy + frames[joint, 2, 2] * dz)
        # Two running minima, so that one does not wait for the other.
        first, last = sets[s, SET_FIRST_VERTEX], sets[s + 1, SET_FIRST_VERTEX]
        lowest = lx * vertices[first, 0] + ly * vertices[first, 1] + lz * vertices[first, 2]
        other = lowest
        for v in range(first + (last - first) % 2, last, 2):
            one = lx * vertices[v, 0] + ly * vertices[v, 1] + lz * vertices[v, 2]
            two = lx * vertices[v + 1, 0] + ly * vertices[v + 1, 1] + lz * vertices[v + 1, 2]
            lowest = one if one < lowest else lowest
            other = two if two < other else other
        lowest = min(lowest, other)
        gap += lowest + sign * (
            frames[joint, 0, 3] * dx + frames[joint, 1, 3] * dy + frames[joint, 2, 3] * dz
        )
    return gap


@njit(cache=True, inline="always")
def _solids_meet(
    arm: ArmArrays, scratch: ArmScratch, s: int, t: int, slot: int, need: float, hit: float
) -> int:
    """Two solid parts, first along the direction that last kept them apart.

    It is remembered in the frames of both: which of them it rests in depends on what turned.
    Where `need` is far above `hit`, being apart is enough to leave the rest to shorter intervals.
    """
    frames, sets, known, work = scratch.frames, arm.sets, scratch.direction, scratch.work
    vertices = arm.vertices
    far = need + arm.radius[s] + arm.radius[t] + TOLERANCE
    work[5, :3] = 0.0
    widest = -np.inf
    for side in range(2):
        joint = sets[t if side == 1 else s, SET_JOINT]
        x, y, z = known[slot, 3 * side], known[slot, 3 * side + 1], known[slot, 3 * side + 2]
        length = np.sqrt(x * x + y * y + z * z)
        if length == 0.0:
            break
        dx = frames[joint, 0, 0] * x + frames[joint, 0, 1] * y + frames[joint, 0, 2] * z
        dy = frames[joint, 1, 0] * x + frames[joint, 1, 1] * y + frames[joint, 1, 2] * z
        dz = frames[joint, 2, 0] * x + frames[joint, 2, 1] * y + frames[joint, 2, 2] * z
        gap = _support_gap(vertices, frames, sets, s, t, dx, dy, dz)
        if gap >= far * length:
            return FREE
        if need - hit > _COARSE and gap >= (far - need + hit) * length:
            return UNDECIDED
        if gap > widest * length:
            widest = gap / length
            work[5, 0], work[5, 1], work[5, 2] = dx, dy, dz
    answer = _sets_meet(arm, scratch, s, t, need, hit)
    if answer == FREE:
        for side in range(2):
            joint = sets[t if side == 1 else s, SET_JOINT]
            for i in range(3):
                known[slot, 3 * side + i] = (
                    frames[joint, 0, i] * work[5, 0]
                    + frames[joint, 1, i] * work[5, 1]
                    + frames[joint, 2, i] * work[5, 2]
                )
    return answer


@njit(cache=True)
def bodies_meet(arm: ArmArrays, scratch: ArmScratch, pair: int, need: float, hit: float) -> int:
    """One pair of bodies; what is left UNDECIDED is noted in the scratch.

    Once `need` cannot be kept any more, only collisions are looked for.
    """
    bodies, parts, bounds = arm.bodies, arm.parts, scratch.bounds
    body_spheres, spheres = scratch.body_spheres, scratch.part_spheres
    a, b = arm.pairs[pair, PAIR_INNER], arm.pairs[pair, PAIR_OUTER]
    fixed = a >= arm.moving
    slot = arm.pairs[pair, PAIR_SLOT]
    first_b, last_b = bodies[b, BODY_FIRST_PART], bodies[b + 1, BODY_FIRST_PART]
    result = FREE
    for p in range(bodies[a, BODY_FIRST_PART], bodies[a + 1, BODY_FIRST_PART]):
        slot += last_b - first_b
        x, y, z = spheres[p, 0], spheres[p, 1], spheres[p, 2]
        near = spheres[p, 3] + need + TOLERANCE
        dx, dy, dz = x - body_spheres[b, 0], y - body_spheres[b, 1], z - body_spheres[b, 2]
        reach = near + body_spheres[b, 3]
        if dx * dx + dy * dy + dz * dz > reach * reach:
            continue
        s = parts[p, PART_FIRST_SET]
        solid = parts[p, PART_SOLID] != 0
        for o in range(first_b, last_b):
            dx, dy, dz = x - spheres[o, 0], y - spheres[o, 1], z - spheres[o, 2]
            reach = near + spheres[o, 3]
            square = dx * dx + dy * dy + dz * dz
            if square > reach * reach:
                continue
            if need > hit and square < need * need:
                # Centres lie inside: `need` cannot be kept. Look for a collision, if there can be.
                result = UNDECIDED
                need = hit
                near = spheres[p, 3] + need + TOLERANCE
                reach = near + spheres[o, 3]
                if square > reach * reach:
                    continue
            if not solid or parts[o, PART_SOLID] == 0:
                answer = _surfaces_meet(arm, scratch, p, o, need, hit)
            else:
                if fixed:
                    # The box around a fixed set is known for good, and tighter than its ball.
                    dx = max(bounds[s, 0] - spheres[o, 0], 0.0, spheres[o, 0] - bounds[s, 3])
                    dy = max(bounds[s, 1] - spheres[o, 1], 0.0, spheres[o, 1] - bounds[s, 4])
                    dz = max(bounds[s, 2] - spheres[o, 2], 0.0, spheres[o, 2] - bounds[s, 5])
                    reach = spheres[o, 3] + need + TOLERANCE
                    if dx * dx + dy * dy + dz * dz > reach * reach:
                        continue
                t = parts[o, PART_FIRST_SET]
                answer = _solids_meet(arm, scratch, s, t, slot - last_b + o, need, hit)
            if answer == COLLIDING:
                return COLLIDING
            if answer == UNDECIDED:
                result = UNDECIDED
                need = hit
                near = spheres[p, 3] + need + TOLERANCE
    return result


@njit(cache=True)
def _surfaces_meet(
    arm: ArmArrays, scratch: ArmScratch, p: int, o: int, need: float, hit: float
) -> int:
    """Two parts of which one at least is a surface: leaves of p against leaves of o."""
    parts, nodes, local, frames = arm.parts, arm.nodes, arm.node_spheres, scratch.frames
    joint_p = arm.sets[parts[p, PART_FIRST_SET], SET_JOINT]
    joint_o = arm.sets[parts[o, PART_FIRST_SET], SET_JOINT]
    whole = scratch.part_spheres
    result = FREE
    # Of a solid part only the set counts, so its root stands for all of its tree.
    end_a = parts[p + 1, PART_FIRST_NODE]
    end_b = parts[o + 1, PART_FIRST_NODE]
    a = parts[p, PART_FIRST_NODE]
    while a < end_a:
        x, y, z = _to_world(frames, joint_p, local[a, 0], local[a, 1], local[a, 2])
        near = local[a, 3] + need + TOLERANCE
        dx, dy, dz = x - whole[o, 0], y - whole[o, 1], z - whole[o, 2]
        reach = near + whole[o, 3]
        if dx * dx + dy * dy + dz * dz > reach * reach:
            a = nodes[a, NODE_SKIP]
            continue
        first_a, last_a = nodes[a, NODE_FIRST], nodes[a, NODE_LAST]
        if parts[p, PART_SOLID] != 0:
            first_a = parts[p, PART_FIRST_SET]
            last_a = first_a + 1
        elif first_a < 0:
            a += 1
            continue
        b = parts[o, PART_FIRST_NODE]
        while b < end_b:
            u, v, w = _to_world(frames, joint_o, local[b, 0], local[b, 1], local[b, 2])
            dx, dy, dz = x - u, y - v, z - w
            reach = near + local[b, 3]
            if dx * dx + dy * dy + dz * dz > reach * reach:
                b = nodes[b, NODE_SKIP]
                continue
            first_b, last_b = nodes[b, NODE_FIRST], nodes[b, NODE_LAST]
            if parts[o, PART_SOLID] != 0:
                first_b = parts[o, PART_FIRST_SET]
                last_b = first_b + 1
            elif first_b < 0:
                b += 1
                continue
            for s in range(first_a, last_a):
                for t in range(first_b, last_b):
                    scratch.work[5, :3] = 0.0
                    answer = _sets_meet(arm, scratch, s, t, need, hit)
                    if answer == COLLIDING:
                        return COLLIDING
                    if answer == UNDECIDED:
                        result = UNDECIDED
            b = nodes[b, NODE_SKIP]
        a = nodes[a, NODE_SKIP]
    return result


@njit(cache=True)
def check_states(
    arm: ArmArrays,
    boxes: BoxArrays,
    scratch: ArmScratch,
    Q: Array,
    margin: float,
    self_margin: float,
    contact: bool,
    answers: Indices,
) -> None:
    """Configurations Q (m, n), answers (m,); what the last leaves UNDECIDED is in the scratch."""
    field, field_grid = boxes.field, boxes.field_grid
    spheres, pairs = scratch.body_spheres, arm.pairs
    near = self_margin + TOLERANCE
    for i in range(Q.shape[0]):
        if not is_finite(Q[i]):
            answers[i] = NOT_FINITE
            continue
        place_arm(arm, scratch, Q[i])
        scratch.counters[2] = 0
        result = FREE
        for body in range(arm.moving if boxes.number > 0 else 0):
            if contact and body == arm.held:
                continue
            bound = distance_bound(
                field_grid, field, spheres[body, 0], spheres[body, 1], spheres[body, 2]
            )
            if bound >= spheres[body, 3] + margin + TOLERANCE:
                continue
            answer = body_meets_boxes(arm, boxes, scratch, body, margin, margin)
            if answer == COLLIDING:
                result = COLLIDING
                break
            if answer == UNDECIDED:
                result = UNDECIDED
        if result != COLLIDING:
            for pair in range(pairs.shape[0]):
                a, b = pairs[pair, PAIR_INNER], pairs[pair, PAIR_OUTER]
                dx = spheres[a, 0] - spheres[b, 0]
                dy = spheres[a, 1] - spheres[b, 1]
                dz = spheres[a, 2] - spheres[b, 2]
                reach = spheres[a, 3] + spheres[b, 3] + near
                if dx * dx + dy * dy + dz * dz > reach * reach:
                    continue
                answer = bodies_meet(arm, scratch, pair, self_margin, self_margin)
                if answer == COLLIDING:
                    result = COLLIDING
                    break
                if answer == UNDECIDED:
                    result = UNDECIDED
        answers[i] = result


@njit(cache=True)
def bound_motion(arm: ArmArrays, scratch: ArmScratch, delta: Array, bound: Array) -> None:
    """bound[b, k]: how far joints k and outward move any point of moving body b (this module)."""
    frames, spheres, prismatic = scratch.frames, scratch.body_spheres, arm.prismatic
    for body in range(arm.moving):
        joint = arm.bodies[body, BODY_JOINT]
        x, y, z, radius = (
            spheres[body, 0],
            spheres[body, 1],
            spheres[body, 2],
            spheres[body, 3],
        )
        m = 0.0
        bound[body, joint + 1] = 0.0
        for k in range(joint, -1, -1):
            if prismatic[k]:
                m += delta[k]
            else:
                dx = x - frames[k, 0, 3]
                dy = y - frames[k, 1, 3]
                dz = z - frames[k, 2, 3]
                along = dx * frames[k, 0, 2] + dy * frames[k, 1, 2] + dz * frames[k, 2, 2]
                across = np.sqrt(max(dx * dx + dy * dy + dz * dz - along * along, 0.0))
                m += delta[k] * (across + radius + m)
            bound[body, k] = m


@njit(cache=True)
def check_edge(
    arm: ArmArrays,
    boxes: BoxArrays,
    scratch: ArmScratch,
    a: Array,
    b: Array,
    deviation: Array,
    margin: float,
    self_margin: float,
    contact: bool,
    resolution: float,
    self_resolution: float,
    queue: Array,
    settled: npt.NDArray[np.bool_],
) -> int:
    """The straight joint motion from a to b (n,), strayed from by at most `deviation` (n,).

    Breadth-first bisection. Per interval each body (against the obstacle set) and each pair is
    FREE for the whole of it where it keeps, at the middle, its margin and the bound on motion;
    what is settled for an interval is settled for its halves. Not certified are edges with a
    collision, and those where the distance at a middle falls short although the motion over the
    interval is down to the resolution.

    Args:
        resolution, self_resolution: metres.
        queue: (k, 2) work space, settled: (k, bodies moving + pairs).

    Returns:
        FREE, COLLIDING (certain), UNDECIDED (not certified), OVERFLOW or NOT_FINITE.
    """
    if not (is_finite(a) and is_finite(b) and is_finite(deviation)):
        return NOT_FINITE
    n = a.shape[0]
    size = queue.shape[0]
    pairs = arm.pairs
    items = arm.moving + pairs.shape[0]
    field, field_grid = boxes.field, boxes.field_grid
    spheres, bound = scratch.body_spheres, scratch.bound
    delta = np.empty(n)
    straight = np.empty(n)
    q = np.empty(n)
    strays = False
    for j in range(n):
        strays = strays or deviation[j] > 0.0
    exact = scratch.bound_straight if strays else scratch.bound
    head = 0
    waiting = 1
    queue[0, 0] = 0.5
    queue[0, 1] = 0.5
    settled[0, :] = False
    for body in range(arm.moving):
        if boxes.number == 0 or (contact and body == arm.held):
            settled[0, body] = True
    while waiting > 0:
        middle, half = queue[head, 0], queue[head, 1]
        for j in range(n):
            q[j] = a[j] + middle * (b[j] - a[j])
            straight[j] = half * abs(b[j] - a[j])
            delta[j] = straight[j] + deviation[j]
        place_arm(arm, scratch, q)
        bound_motion(arm, scratch, delta, bound)
        if strays:
            bound_motion(arm, scratch, straight, exact)
        open_items = False
        for item in range(items):
            if settled[head, item]:
                continue
            scratch.counters[2] = 0
            if item < arm.moving:
                need = margin + bound[item, 0]
                clear = distance_bound(
                    field_grid, field, spheres[item, 0], spheres[item, 1], spheres[item, 2]
                )
                if clear >= spheres[item, 3] + need + TOLERANCE:
                    settled[head, item] = True
                    continue
                answer = body_meets_boxes(arm, boxes, scratch, item, need, margin)
                small = exact[item, 0] <= resolution
            else:
                pair = item - arm.moving
                inner, outer = pairs[pair, PAIR_INNER], pairs[pair, PAIR_OUTER]
                first = pairs[pair, PAIR_OUTWARD]
                need = self_margin + bound[outer, first]
                dx = spheres[inner, 0] - spheres[outer, 0]
                dy = spheres[inner, 1] - spheres[outer, 1]
                dz = spheres[inner, 2] - spheres[outer, 2]
                reach = spheres[inner, 3] + spheres[outer, 3] + need + TOLERANCE
                if dx * dx + dy * dy + dz * dz > reach * reach:
                    settled[head, item] = True
                    continue
                answer = bodies_meet(arm, scratch, pair, need, self_margin)
                small = exact[outer, first] <= self_resolution
            if answer == COLLIDING:
                return COLLIDING
            if answer == FREE:
                settled[head, item] = True
            elif small:
                return UNDECIDED
            else:
                open_items = True
        if open_items:
            if waiting + 2 > size:
                return OVERFLOW
            for side in range(2):
                place = (head + waiting + side) % size
                queue[place, 0] = middle + (side - 0.5) * half
                queue[place, 1] = 0.5 * half
                for item in range(items):
                    settled[place, item] = settled[head, item]
            waiting += 2
        head = (head + 1) % size
        waiting -= 1
    return FREE
