"""Whole edges, certified: straight joint motions, with what a controller may stray from them.

An edge is cut into intervals. A body or a pair that keeps, at an interval's middle, its margin and
a bound on how far it moves within the interval keeps its margin throughout.

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

from placement_planner_ros.core.collision import arrays as at
from placement_planner_ros.core.collision.against_boxes import BoxArrays, body_meets_boxes
from placement_planner_ros.core.collision.against_robot import pair_meets
from placement_planner_ros.core.collision.arrays import ArmArrays, ArmScratch
from placement_planner_ros.core.collision.configurations import NOT_FINITE
from placement_planner_ros.core.collision.placing import place_all_spheres, place_joints
from placement_planner_ros.core.collision.separation import COLLIDING, FREE, UNDECIDED
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted

OVERFLOW = 3
"""An edge needs more intervals than the queue holds: cut it in two."""


class EdgeLimits(NamedTuple):
    """What an edge is to keep, and how closely that is looked at, metres.

    Of the bodies against the obstacle set, and of the robot against itself.
    """

    margin: float
    self_margin: float
    resolution: float
    """Motion over an interval down to which it is halved."""
    self_resolution: float
    contact: bool
    """Whether the held object is left out against the obstacle set."""


class JointEdge(NamedTuple):
    """A straight joint motion."""

    a: Array
    """(n,) where it begins; `b`: where it ends."""
    b: Array
    deviation: Array
    """(n,) how far joints may stray from it."""


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def bound_motion(arm: ArmArrays, scratch: ArmScratch, delta: Array, bound: Array) -> None:
    """bound[b, k]: how far joints k and outward move any point of moving body b (this module)."""
    frames, spheres, prismatic = scratch.frames, scratch.body_spheres, arm.prismatic
    for body in range(arm.moving):
        joint = arm.bodies[body, at.BODY_JOINT]
        # The ball around the body, where it is at the middle.
        x, y, z, radius = (
            spheres[body, 0],
            spheres[body, 1],
            spheres[body, 2],
            spheres[body, 3],
        )
        # Joint by joint, from the body's own inward; further joints do not move it.
        m = 0.0
        bound[body, joint + 1] = 0.0
        for k in range(joint, -1, -1):
            if prismatic[k]:
                m += delta[k]
            else:
                # The distance of the ball's centre from the joint's axis.
                dx = x - frames[k, 0, 3]
                dy = y - frames[k, 1, 3]
                dz = z - frames[k, 2, 3]
                along = dx * frames[k, 0, 2] + dy * frames[k, 1, 2] + dz * frames[k, 2, 2]
                across = np.sqrt(max(dx * dx + dy * dy + dz * dz - along * along, 0.0))
                # A turn moves no point further than its angle times the distance from the axis.
                m += delta[k] * (across + radius + m)
            bound[body, k] = m


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _place_interval(
    arm: ArmArrays,
    scratch: ArmScratch,
    edge: JointEdge,
    middle: float,
    half: float,
    strays: bool,
) -> None:
    """Put the arm at `middle` of the edge, and bound its motion up to `half` of it to both sides.

    Filled are `edge`, `bound` and, where the edge is strayed from, `bound_straight`.
    """
    a, b, deviation = edge.a, edge.b, edge.deviation
    q, straight, delta = scratch.edge[0], scratch.edge[1], scratch.edge[2]
    # The configuration at the middle, and how far each joint moves along the edge and beside it.
    for j in range(a.shape[0]):
        q[j] = a[j] + middle * (b[j] - a[j])
        straight[j] = half * abs(b[j] - a[j])
        delta[j] = straight[j] + deviation[j]
    # Place the arm there, and bound its motion.
    place_joints(arm, scratch, q)
    place_all_spheres(arm, scratch)
    bound_motion(arm, scratch, delta, scratch.bound)
    if strays:
        bound_motion(arm, scratch, straight, scratch.bound_straight)


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _append_halves(
    queue: Array, settled: npt.NDArray[np.bool_], head: int, waiting: int, items: int
) -> None:
    """Append both halves of the interval at `head` to the `waiting` ones, settled as far as it."""
    # Appended behind those that wait, in a ring.
    size = queue.shape[0]
    middle, half = queue[head, 0], queue[head, 1]
    for side in range(2):
        place = (head + waiting + side) % size
        queue[place, 0] = middle + (side - 0.5) * half
        queue[place, 1] = 0.5 * half
        for item in range(items):
            settled[place, item] = settled[head, item]


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def check_edge(
    arm: ArmArrays,
    boxes: BoxArrays,
    scratch: ArmScratch,
    edge: JointEdge,
    limits: EdgeLimits,
    work: tuple[Array, npt.NDArray[np.bool_]],
) -> int:
    """A straight joint motion, strayed from by no more than its deviation.

    Breadth-first bisection. Per interval each body (against the obstacle set) and each pair is
    FREE for the whole of it where it keeps, at the middle, its margin and the bound on motion
    (this module's); what is settled for an interval is settled for its halves. Not certified are
    edges with a collision, and those where the distance at a middle falls short although the
    motion over the interval is down to the resolution.

    Args:
        work: (k, 2) intervals that wait; (k, bodies moving + pairs) what of them is settled.

    Returns:
        FREE, COLLIDING (certain), UNDECIDED (not certified), OVERFLOW or NOT_FINITE.
    """
    if not np.isfinite(edge.a.sum() + edge.b.sum() + edge.deviation.sum()):
        return NOT_FINITE
    pairs, bound = arm.pairs, scratch.bound
    queue, settled = work
    # The items to settle: bodies against the obstacle set, then pairs of bodies.
    items = arm.moving + pairs.shape[0]
    q, delta = scratch.edge[0], scratch.edge[2]
    strays = False
    for j in range(q.shape[0]):
        strays = strays or edge.deviation[j] > 0.0
    # Shorter intervals lessen the motion along the edge alone, not what strays from it.
    exact = scratch.bound_straight if strays else bound
    # The whole edge is the first interval: middle and half its length, as shares.
    head = 0
    waiting = 1
    queue[0, 0] = 0.5
    queue[0, 1] = 0.5
    settled[0, :] = False
    # Nothing to settle for bodies without obstacles, and for the object where it may touch them.
    for body in range(arm.moving):
        if boxes.number == 0 or (limits.contact and body == arm.held):
            settled[0, body] = True
    while waiting > 0:
        # The first interval that waits, with the arm at its middle.
        _place_interval(arm, scratch, edge, queue[head, 0], queue[head, 1], strays)
        open_items = False
        for item in range(items):
            if settled[head, item]:
                continue
            # A body against the obstacle set, its motion added to the margin.
            if item < arm.moving:
                need = limits.margin + bound[item, 0]
                answer = body_meets_boxes(arm, boxes, scratch, item, need, limits.margin)
                small = exact[item, 0] <= limits.resolution
            else:
                # A pair of bodies, the motion of the joints between them added to the margin.
                pair = item - arm.moving
                outer, first = pairs[pair, at.PAIR_OUTER], pairs[pair, at.PAIR_OUTWARD]
                need = limits.self_margin + bound[outer, first]
                answer = pair_meets(arm, scratch, pair, (q, delta), need, limits.self_margin)
                small = exact[outer, first] <= limits.self_resolution
            if answer == COLLIDING:
                return COLLIDING
            if answer == FREE:
                settled[head, item] = True
            elif small:
                # Short enough, and still not certain.
                return UNDECIDED
            else:
                open_items = True
        # Halve the interval where anything is open.
        if open_items:
            if waiting + 2 > queue.shape[0]:
                return OVERFLOW
            _append_halves(queue, settled, head, waiting, items)
            waiting += 2
        # On to the next that waits.
        head = (head + 1) % queue.shape[0]
        waiting -= 1
    return FREE
