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

from placement_planner_ros.core.robot.collision_arrays import ArmArrays, ArmScratch
from placement_planner_ros.core.robot.kinematics import chain_frames
from placement_planner_ros.core.robot.separation import (
    COLLIDING,
    FREE,
    UNDECIDED,
    separate_box,
    separate_hulls,
)
from placement_planner_ros.core.types import Array

OVERFLOW = 3
"""An edge needs more intervals than the queue holds: cut it in two."""

TOLERANCE = 1e-6


class BoxArrays(NamedTuple):
    """The obstacle set for the kernels: m boxes, each within its cell."""

    number: int
    origin: Array
    cell_size: float
    rows: npt.NDArray[np.int32]
    lower: Array
    upper: Array
    next: npt.NDArray[np.int32]
    """(m,) another box of the same cell, or -1."""
    extent: Array
    """(6,) box around all boxes, lower then upper."""
    field_origin: Array
    field_cell: float
    field: npt.NDArray[np.float32]
    """Lower bound of the distance at each cell's centre."""


@njit(cache=True)
def distance_bound(boxes: BoxArrays, x: float, y: float, z: float) -> float:
    """A lower bound of the distance of a point to all boxes; negative where none is known."""
    dx = max(boxes.extent[0] - x, 0.0, x - boxes.extent[3])
    dy = max(boxes.extent[1] - y, 0.0, y - boxes.extent[4])
    dz = max(boxes.extent[2] - z, 0.0, z - boxes.extent[5])
    outside = np.sqrt(dx * dx + dy * dy + dz * dz)
    size = boxes.field_cell
    fx = (x - boxes.field_origin[0]) / size
    fy = (y - boxes.field_origin[1]) / size
    fz = (z - boxes.field_origin[2]) / size
    i = min(max(int(np.floor(fx)), 0), boxes.field.shape[0] - 1)
    j = min(max(int(np.floor(fy)), 0), boxes.field.shape[1] - 1)
    k = min(max(int(np.floor(fz)), 0), boxes.field.shape[2] - 1)
    fx -= i + 0.5
    fy -= j + 0.5
    fz -= k + 0.5
    bound = boxes.field[i, j, k] - size * np.sqrt(fx * fx + fy * fy + fz * fz)
    return max(outside, bound)


@njit(cache=True)
def place_joints(arm: ArmArrays, scratch: ArmScratch, q: Array) -> None:
    """Forward kinematics: world frames of the joints at q (n,); ends what was known before."""
    scratch.counters[0] += 1
    chain_frames(arm.fixed, arm.prismatic, q, scratch.frames)


@njit(cache=True)
def _to_world(scratch: ArmScratch, joint: int, v: Array) -> tuple[float, float, float]:
    if joint < 0:
        return v[0], v[1], v[2]
    T = scratch.frames[joint]
    return (
        T[0, 3] + T[0, 0] * v[0] + T[0, 1] * v[1] + T[0, 2] * v[2],
        T[1, 3] + T[1, 0] * v[0] + T[1, 1] * v[1] + T[1, 2] * v[2],
        T[2, 3] + T[2, 0] * v[0] + T[2, 1] * v[1] + T[2, 2] * v[2],
    )


@njit(cache=True)
def place_set(arm: ArmArrays, scratch: ArmScratch, s: int) -> None:
    """Vertices, planes and box of convex set s in the world, once per configuration."""
    if scratch.set_stamp[s] >= scratch.counters[0]:
        return
    scratch.set_stamp[s] = scratch.counters[0]
    T = scratch.frames[arm.set_joint[s]]
    radius = arm.set_radius[s]
    bounds = scratch.bounds[s]
    for i in range(3):
        bounds[i] = np.inf
        bounds[i + 3] = -np.inf
    for v in range(arm.set_vertices[s], arm.set_vertices[s + 1]):
        x, y, z = arm.vertices[v, 0], arm.vertices[v, 1], arm.vertices[v, 2]
        for i in range(3):
            w = T[i, 3] + T[i, 0] * x + T[i, 1] * y + T[i, 2] * z
            scratch.vertices[v, i] = w
            bounds[i] = min(bounds[i], w - radius)
            bounds[i + 3] = max(bounds[i + 3], w + radius)
    for v in range(arm.set_planes[s], arm.set_planes[s + 1]):
        x, y, z = arm.normals[v, 0], arm.normals[v, 1], arm.normals[v, 2]
        offset = arm.offsets[v]
        for i in range(3):
            n = T[i, 0] * x + T[i, 1] * y + T[i, 2] * z
            scratch.normals[v, i] = n
            offset += n * T[i, 3]
        scratch.offsets[v] = offset


@njit(cache=True)
def set_meets_box(
    arm: ArmArrays,
    scratch: ArmScratch,
    s: int,
    lower: Array,
    upper: Array,
    need: float,
    hit: float,
) -> int:
    """Convex set s against one box: FREE from distance `need` on, COLLIDING below `hit`."""
    bounds = scratch.bounds[s]
    for i in range(3):
        if lower[i] - bounds[i + 3] >= need + TOLERANCE or (
            bounds[i] - upper[i] >= need + TOLERANCE
        ):
            return FREE
    cx = 0.5 * (lower[0] + upper[0])
    cy = 0.5 * (lower[1] + upper[1])
    cz = 0.5 * (lower[2] + upper[2])
    hx = upper[0] - cx
    hy = upper[1] - cy
    hz = upper[2] - cz
    radius = arm.set_radius[s]
    first, last = arm.set_planes[s], arm.set_planes[s + 1]
    deepest = -np.inf
    best = -np.inf
    axis = -1
    for v in range(first, last):
        nx, ny, nz = scratch.normals[v, 0], scratch.normals[v, 1], scratch.normals[v, 2]
        middle = nx * cx + ny * cy + nz * cz - scratch.offsets[v]
        gap = middle - abs(nx) * hx - abs(ny) * hy - abs(nz) * hz
        if gap - radius >= need + TOLERANCE:
            return FREE
        deepest = max(deepest, middle)
        if gap > best:
            best = gap
            axis = v
    if last > first and deepest < -TOLERANCE:
        return COLLIDING if arm.set_exact[s] else UNDECIDED
    direction = scratch.work[5]
    if axis >= 0:
        for i in range(3):
            direction[i] = -scratch.normals[axis, i]
    else:
        direction[0] = bounds[0] + bounds[3] - 2 * cx
        direction[1] = bounds[1] + bounds[4] - 2 * cy
        direction[2] = bounds[2] + bounds[5] - 2 * cz
    answer = separate_box(
        scratch.vertices,
        arm.set_vertices[s],
        arm.set_vertices[s + 1],
        lower,
        upper,
        need + radius,
        hit + radius,
        direction,
        scratch.work,
    )
    if answer == COLLIDING and not arm.set_exact[s]:
        return UNDECIDED
    return answer


@njit(cache=True)
def _note(scratch: ArmScratch, kind: int, a: int, b: int) -> None:
    n = scratch.counters[2]
    if n < scratch.undecided.shape[0]:
        scratch.undecided[n, 0] = kind
        scratch.undecided[n, 1] = a
        scratch.undecided[n, 2] = b
    scratch.counters[2] = n + 1


@njit(cache=True)
def _leaf_meets_box(
    arm: ArmArrays,
    boxes: BoxArrays,
    scratch: ArmScratch,
    node: int,
    box: int,
    x: float,
    y: float,
    z: float,
    reach: float,
    need: float,
    hit: float,
) -> int:
    """The sets under a leaf at (x, y, z) against one box, if it is within `reach` of the leaf."""
    lower = boxes.lower[box]
    upper = boxes.upper[box]
    dx = max(lower[0] - x, 0.0, x - upper[0])
    dy = max(lower[1] - y, 0.0, y - upper[1])
    dz = max(lower[2] - z, 0.0, z - upper[2])
    if dx * dx + dy * dy + dz * dz > reach * reach:
        return FREE
    scratch.box_stamp[box] = scratch.counters[1]
    result = FREE
    for s in range(arm.node_first[node], arm.node_last[node]):
        place_set(arm, scratch, s)
        answer = set_meets_box(arm, scratch, s, lower, upper, need, hit)
        if answer == COLLIDING:
            scratch.hit[0] = 0
            scratch.hit[1] = s
            scratch.hit[2] = box
            return COLLIDING
        if answer == UNDECIDED:
            result = UNDECIDED
            _note(scratch, 0, s, box)
    return result


@njit(cache=True)
def body_meets_boxes(
    arm: ArmArrays, boxes: BoxArrays, scratch: ArmScratch, body: int, need: float, hit: float
) -> int:
    """A moving body against the obstacle set; what is left UNDECIDED is noted in the scratch.

    Where `need` is far above `hit`, or cannot be kept any more, only collisions are looked for.
    """
    joint = arm.body_joint[body]
    x, y, z = _to_world(scratch, joint, arm.body_center[body])
    if distance_bound(boxes, x, y, z) >= arm.body_radius[body] + need + TOLERANCE:
        return FREE
    near = need
    result = FREE
    if need - hit > 2.0 * boxes.cell_size:
        near = hit
    size = boxes.cell_size
    nx, ny, nz = boxes.rows.shape
    for part in range(arm.body_parts[body], arm.body_parts[body + 1]):
        node = arm.part_nodes[part]
        end = arm.part_nodes[part + 1]
        if arm.part_solid[part]:
            scratch.counters[1] += 1
        while node < end:
            x, y, z = _to_world(scratch, joint, arm.node_center[node])
            radius = arm.node_radius[node]
            bound = distance_bound(boxes, x, y, z) - radius - TOLERANCE
            if bound >= need:
                node = arm.node_skip[node]
                continue
            if result == UNDECIDED and bound >= near:
                node = arm.node_skip[node]
                continue
            if arm.node_first[node] < 0:
                node += 1
                continue
            if near < need:
                result = UNDECIDED
                if bound >= near:
                    node = arm.node_skip[node]
                    continue
            if not arm.part_solid[part]:
                scratch.counters[1] += 1
            reach = radius + near + TOLERANCE
            i0 = max(int(np.floor((x - reach - boxes.origin[0]) / size)), 0)
            j0 = max(int(np.floor((y - reach - boxes.origin[1]) / size)), 0)
            k0 = max(int(np.floor((z - reach - boxes.origin[2]) / size)), 0)
            i1 = min(int(np.floor((x + reach - boxes.origin[0]) / size)) + 1, nx)
            j1 = min(int(np.floor((y + reach - boxes.origin[1]) / size)) + 1, ny)
            k1 = min(int(np.floor((z + reach - boxes.origin[2]) / size)) + 1, nz)
            for i in range(i0, i1):
                for j in range(j0, j1):
                    for k in range(k0, k1):
                        box = boxes.rows[i, j, k]
                        while box >= 0:
                            answer = FREE
                            if scratch.box_stamp[box] != scratch.counters[1]:
                                answer = _leaf_meets_box(
                                    arm, boxes, scratch, node, box, x, y, z, reach, near, hit
                                )
                            if answer == COLLIDING:
                                return COLLIDING
                            if answer == UNDECIDED:
                                result = UNDECIDED
                                near = hit
                            box = boxes.next[box]
            node = arm.node_skip[node]
    return result


@njit(cache=True)
def _sets_meet(
    arm: ArmArrays,
    scratch: ArmScratch,
    a: int,
    b: int,
    need: float,
    hit: float,
    direction: Array,
) -> int:
    place_set(arm, scratch, a)
    place_set(arm, scratch, b)
    if direction[0] == 0.0 and direction[1] == 0.0 and direction[2] == 0.0:
        for i in range(3):
            direction[i] = (
                scratch.bounds[a, i]
                + scratch.bounds[a, i + 3]
                - scratch.bounds[b, i]
                - scratch.bounds[b, i + 3]
            )
    radius = arm.set_radius[a] + arm.set_radius[b]
    answer = separate_hulls(
        scratch.vertices,
        arm.set_vertices[a],
        arm.set_vertices[a + 1],
        arm.set_vertices[b],
        arm.set_vertices[b + 1],
        need + radius,
        hit + radius,
        direction,
        scratch.work,
    )
    if answer == COLLIDING:
        if not (arm.set_exact[a] and arm.set_exact[b]):
            answer = UNDECIDED
        else:
            scratch.hit[0] = 1
            scratch.hit[1] = a
            scratch.hit[2] = b
            return COLLIDING
    if answer == UNDECIDED:
        _note(scratch, 1, a, b)
    return answer


@njit(cache=True)
def bodies_meet(arm: ArmArrays, scratch: ArmScratch, pair: int, need: float, hit: float) -> int:
    """One pair of bodies; what is left UNDECIDED is noted in the scratch."""
    a, b = arm.pairs[pair, 0], arm.pairs[pair, 1]
    joint_a, joint_b = arm.body_joint[a], arm.body_joint[b]
    xa, ya, za = _to_world(scratch, joint_a, arm.body_center[a])
    xb, yb, zb = _to_world(scratch, joint_b, arm.body_center[b])
    reach = arm.body_radius[a] + arm.body_radius[b] + need + TOLERANCE
    if (xa - xb) ** 2 + (ya - yb) ** 2 + (za - zb) ** 2 > reach * reach:
        return FREE
    result = FREE
    slot = arm.pair_slot[pair]
    for part_a in range(arm.body_parts[a], arm.body_parts[a + 1]):
        xa, ya, za = _to_world(scratch, joint_a, arm.part_center[part_a])
        near_b = arm.part_radius[part_a] + need + TOLERANCE
        reach = near_b + arm.body_radius[b]
        if (xa - xb) ** 2 + (ya - yb) ** 2 + (za - zb) ** 2 > reach * reach:
            slot += arm.body_parts[b + 1] - arm.body_parts[b]
            continue
        for part_b in range(arm.body_parts[b], arm.body_parts[b + 1]):
            slot += 1
            x, y, z = _to_world(scratch, joint_b, arm.part_center[part_b])
            reach = near_b + arm.part_radius[part_b]
            if (xa - x) ** 2 + (ya - y) ** 2 + (za - z) ** 2 > reach * reach:
                continue
            if arm.part_solid[part_a] and arm.part_solid[part_b]:
                answer = _sets_meet(
                    arm,
                    scratch,
                    arm.part_sets[part_a],
                    arm.part_sets[part_b],
                    need,
                    hit,
                    scratch.direction[slot - 1],
                )
            else:
                answer = _trees_meet(arm, scratch, part_a, part_b, joint_a, joint_b, need, hit)
            if answer == COLLIDING:
                return COLLIDING
            if answer == UNDECIDED:
                result = UNDECIDED
    return result


@njit(cache=True)
def _trees_meet(
    arm: ArmArrays,
    scratch: ArmScratch,
    part_a: int,
    part_b: int,
    joint_a: int,
    joint_b: int,
    need: float,
    hit: float,
) -> int:
    """Two parts of which one at least is a surface: leaves of a against leaves of b."""
    xb, yb, zb = _to_world(scratch, joint_b, arm.part_center[part_b])
    result = FREE
    a = arm.part_nodes[part_a]
    while a < arm.part_nodes[part_a + 1]:
        xa, ya, za = _to_world(scratch, joint_a, arm.node_center[a])
        near = arm.node_radius[a] + need + TOLERANCE
        reach = near + arm.part_radius[part_b]
        if (xa - xb) ** 2 + (ya - yb) ** 2 + (za - zb) ** 2 > reach * reach:
            a = arm.node_skip[a]
            continue
        if arm.node_first[a] < 0 and not arm.part_solid[part_a]:
            a += 1
            continue
        b = arm.part_nodes[part_b]
        while b < arm.part_nodes[part_b + 1]:
            x, y, z = _to_world(scratch, joint_b, arm.node_center[b])
            reach = near + arm.node_radius[b]
            if (xa - x) ** 2 + (ya - y) ** 2 + (za - z) ** 2 > reach * reach:
                b = arm.node_skip[b]
                continue
            if arm.node_first[b] < 0 and not arm.part_solid[part_b]:
                b += 1
                continue
            first_a, last_a = arm.node_first[a], arm.node_last[a]
            if arm.part_solid[part_a]:
                first_a = arm.part_sets[part_a]
                last_a = first_a + 1
            first_b, last_b = arm.node_first[b], arm.node_last[b]
            if arm.part_solid[part_b]:
                first_b = arm.part_sets[part_b]
                last_b = first_b + 1
            for s in range(first_a, last_a):
                for t in range(first_b, last_b):
                    direction = scratch.work[5, :3]
                    direction[:] = 0.0
                    answer = _sets_meet(arm, scratch, s, t, need, hit, direction)
                    if answer == COLLIDING:
                        return COLLIDING
                    if answer == UNDECIDED:
                        result = UNDECIDED
            b = arm.node_skip[b]
            if arm.part_solid[part_b]:
                break
        a = arm.node_skip[a]
        if arm.part_solid[part_a]:
            break
    return result


@njit(cache=True)
def check_state(
    arm: ArmArrays,
    boxes: BoxArrays,
    scratch: ArmScratch,
    q: Array,
    margin: float,
    self_margin: float,
    contact: bool,
) -> int:
    """One configuration q (n,); pairs left UNDECIDED are noted in the scratch."""
    place_joints(arm, scratch, q)
    scratch.counters[2] = 0
    result = FREE
    if boxes.number > 0:
        for body in range(arm.moving):
            if contact and body == arm.held:
                continue
            answer = body_meets_boxes(arm, boxes, scratch, body, margin, margin)
            if answer == COLLIDING:
                return COLLIDING
            if answer == UNDECIDED:
                result = UNDECIDED
    for pair in range(arm.pairs.shape[0]):
        answer = bodies_meet(arm, scratch, pair, self_margin, self_margin)
        if answer == COLLIDING:
            return COLLIDING
        if answer == UNDECIDED:
            result = UNDECIDED
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
    answers: npt.NDArray[np.int64],
) -> None:
    """Configurations Q (m, n); answers (m,)."""
    for i in range(Q.shape[0]):
        answers[i] = check_state(arm, boxes, scratch, Q[i], margin, self_margin, contact)


@njit(cache=True)
def bound_motion(arm: ArmArrays, scratch: ArmScratch, delta: Array, bound: Array) -> None:
    """bound[b, k]: how far joints k and outward move any point of moving body b (this module)."""
    for body in range(arm.moving):
        joint = arm.body_joint[body]
        x, y, z = _to_world(scratch, joint, arm.body_center[body])
        radius = arm.body_radius[body]
        m = 0.0
        bound[body, joint + 1] = 0.0
        for k in range(joint, -1, -1):
            if arm.prismatic[k]:
                m += delta[k]
            else:
                T = scratch.frames[k]
                dx = x - T[0, 3]
                dy = y - T[1, 3]
                dz = z - T[2, 3]
                along = dx * T[0, 2] + dy * T[1, 2] + dz * T[2, 2]
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
        FREE, COLLIDING (certain), UNDECIDED (not certified) or OVERFLOW.
    """
    n = a.shape[0]
    size = queue.shape[0]
    pairs = arm.pairs.shape[0]
    delta = np.empty(n)
    straight = np.empty(n)
    q = np.empty(n)
    strays = False
    for j in range(n):
        strays = strays or deviation[j] > 0.0
    head = 0
    waiting = 1
    queue[0, 0] = 0.5
    queue[0, 1] = 0.5
    for item in range(arm.moving + pairs):
        settled[0, item] = False
    for body in range(arm.moving):
        if boxes.number == 0 or (contact and body == arm.held):
            settled[0, body] = True
    while waiting > 0:
        middle, half = queue[head, 0], queue[head, 1]
        done = settled[head]
        for j in range(n):
            q[j] = a[j] + middle * (b[j] - a[j])
            straight[j] = half * abs(b[j] - a[j])
            delta[j] = straight[j] + deviation[j]
        place_joints(arm, scratch, q)
        bound_motion(arm, scratch, delta, scratch.bound)
        if strays:
            bound_motion(arm, scratch, straight, scratch.bound_straight)
        exact = scratch.bound_straight if strays else scratch.bound
        open_items = False
        for item in range(arm.moving + pairs):
            if done[item]:
                continue
            scratch.counters[2] = 0
            if item < arm.moving:
                answer = body_meets_boxes(
                    arm, boxes, scratch, item, margin + scratch.bound[item, 0], margin
                )
                motion = exact[item, 0]
            else:
                pair = item - arm.moving
                outer = arm.pairs[pair, 1]
                inner = arm.body_joint[arm.pairs[pair, 0]]
                motion = exact[outer, inner + 1]
                answer = bodies_meet(
                    arm, scratch, pair, self_margin + scratch.bound[outer, inner + 1], self_margin
                )
            if answer == COLLIDING:
                return COLLIDING
            if answer == FREE:
                done[item] = True
            elif motion <= (resolution if item < arm.moving else self_resolution):
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
                for item in range(arm.moving + pairs):
                    settled[place, item] = done[item]
            waiting += 2
        head = (head + 1) % size
        waiting -= 1
    return FREE
