"""Compiled collision queries: configurations and whole edges.

The bound on motion: let the joints move by at most δ_j from q. Change them one by one, outermost
first. While joint k turns, the joints above it still stand at q, and a point that was at most ρ_k
from its axis at q has since strayed by m_{k+1} at most; so m_k = m_{k+1} + δ_k (ρ_k + m_{k+1}),
and m_{k+1} + δ_k where the joint slides.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.collision.against_boxes import (
    BoxArrays,
    open_leaves,
    open_leaves_meet_boxes,
)
from placement_planner_ros.core.collision.against_robot import bodies_meet
from placement_planner_ros.core.collision.arrays import (
    BODY_JOINT,
    PAIR_INNER,
    PAIR_OUTER,
    PAIR_OUTWARD,
    PAIR_TABLE,
    ArmArrays,
    ArmScratch,
    Indices,
)
from placement_planner_ros.core.collision.pair_tables import apart_within
from placement_planner_ros.core.collision.placing import (
    is_finite,
    place_all_spheres,
    place_joints,
)
from placement_planner_ros.core.collision.separation import COLLIDING, FREE, TOLERANCE, UNDECIDED
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.types import Array

OVERFLOW = 3
"""An edge needs more intervals than the queue holds: cut it in two."""

NOT_FINITE = 4
"""A configuration holds a NaN or an infinity."""


@kernel(lean=True, nogil=True)
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
    """Configurations Q (m, n), answers (m,); what the last leaves UNDECIDED is in the scratch.

    The field of distances is asked for all bodies first: most collisions are found there.
    """
    moving = arm.moving if boxes.number > 0 else 0
    left_out = arm.held if contact else -1
    for i in range(Q.shape[0]):
        if not is_finite(Q[i]):
            answers[i] = NOT_FINITE
            continue
        place_joints(arm, scratch, Q[i])
        scratch.counters[2] = 0
        result, count = open_leaves(arm, boxes, scratch, 0, moving, left_out, margin, margin)
        if result != COLLIDING and count > 0:
            result = open_leaves_meet_boxes(arm, boxes, scratch, count, margin, margin)
        if result != COLLIDING:
            place_all_spheres(arm, scratch)
            apart = _pairs_meet(arm, scratch, Q[i], self_margin)
            if apart != FREE:
                result = apart
        answers[i] = result


@kernel(lean=True)
def _pairs_meet(arm: ArmArrays, scratch: ArmScratch, q: Array, margin: float) -> int:
    """The robot against itself at q (n,), where it has been placed."""
    spheres, pairs = scratch.body_spheres, arm.pairs
    near = margin + TOLERANCE
    result = FREE
    for pair in range(pairs.shape[0]):
        a, b = pairs[pair, PAIR_INNER], pairs[pair, PAIR_OUTER]
        dx = spheres[a, 0] - spheres[b, 0]
        dy = spheres[a, 1] - spheres[b, 1]
        dz = spheres[a, 2] - spheres[b, 2]
        reach = spheres[a, 3] + spheres[b, 3] + near
        if dx * dx + dy * dy + dz * dz > reach * reach:
            continue
        table, joint = pairs[pair, PAIR_TABLE], pairs[pair, PAIR_OUTWARD]
        if (
            table >= 0
            and margin <= arm.tables.clear
            and apart_within(arm.tables, table, q[joint], q[joint + 1], 0.0, 0.0)
        ):
            continue
        answer = bodies_meet(arm, scratch, pair, margin, margin)
        if answer == COLLIDING:
            return COLLIDING
        if answer == UNDECIDED:
            result = UNDECIDED
    return result


@kernel(lean=True)
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


@kernel(lean=True, nogil=True)
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
    spheres, bound = scratch.body_spheres, scratch.bound
    q, straight, delta = scratch.edge[0], scratch.edge[1], scratch.edge[2]
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
        place_joints(arm, scratch, q)
        place_all_spheres(arm, scratch)
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
                answer, count = open_leaves(arm, boxes, scratch, item, item + 1, -1, need, margin)
                if answer != COLLIDING and count > 0:
                    if answer == UNDECIDED:
                        need = margin
                    found_near = open_leaves_meet_boxes(arm, boxes, scratch, count, need, margin)
                    if found_near != FREE:
                        answer = found_near
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
                table = pairs[pair, PAIR_TABLE]
                if (
                    table >= 0
                    and self_margin <= arm.tables.clear
                    and apart_within(
                        arm.tables, table, q[first], q[first + 1], delta[first], delta[first + 1]
                    )
                ):
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
