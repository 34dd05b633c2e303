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
from numba import njit

from placement_planner_ros.core.collision import arrays as at
from placement_planner_ros.core.collision.against_boxes import (
    BoxArrays,
    KeptMargins,
    bodies_keep_boxes,
)
from placement_planner_ros.core.collision.against_robot import pairs_keep
from placement_planner_ros.core.collision.arrays import ArmArrays, ArmScratch
from placement_planner_ros.core.collision.placing import place_joints, place_spheres
from placement_planner_ros.core.types import Array, Mask
from placement_planner_ros.core.uncounted import Uncounted


class EdgeLimits(NamedTuple):
    """What an edge is to keep, and how closely that is looked at."""

    kept: KeptMargins
    resolution: float
    """Motion over an interval down to which it is halved, metres; `self_resolution`: the same for
    the robot against itself."""
    self_resolution: float


class JointEdge(NamedTuple):
    """A straight joint motion."""

    a: Array
    """(n,) where it begins; `b`: where it ends."""
    b: Array
    deviation: Array
    """(n,) how far joints may stray from it."""


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def bound_motion(arm: ArmArrays, scratch: ArmScratch, delta: Array, bound: Array) -> None:
    """bound[b, k]: how far joints k and outward move any point of moving body b (this module)."""
    frames, spheres, prismatic = scratch.frames, scratch.body_spheres, arm.prismatic
    for body in range(arm.moving):
        joint = arm.bodies[body, at.BODY_JOINT]
        # The ball around the body, where it is at the middle.
        x, y, z = spheres[body, 0], spheres[body, 1], spheres[body, 2]
        radius = spheres[body, 3]
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
    arm: ArmArrays, scratch: ArmScratch, edge: JointEdge, middle: float, half: float
) -> None:
    """Put the arm at `middle` of the edge, and bound its motion up to `half` of it to both sides.

    Filled are `edge` and `bound`.
    """
    # The configuration at the middle, and how far each joint moves along the edge and beside it.
    q, delta = scratch.edge[0], scratch.edge[2]
    for j in range(q.shape[0]):
        way = edge.b[j] - edge.a[j]
        q[j] = edge.a[j] + middle * way
        delta[j] = half * abs(way) + edge.deviation[j]
    # Place the arm there, and bound its motion.
    place_joints(arm, scratch, q)
    place_spheres(arm, scratch, arm.moving)
    bound_motion(arm, scratch, delta, scratch.bound)


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def check_edge(
    arm: ArmArrays,
    boxes: BoxArrays,
    scratch: ArmScratch,
    edge: JointEdge,
    limits: EdgeLimits,
    work: tuple[Array, Mask],
) -> bool:
    """Whether a straight joint motion, strayed from by no more than its deviation, is certified.

    Breadth-first bisection. Per interval each body (against the obstacle set) and each pair keeps
    its margin for the whole of it where it keeps, at the middle, margin and bound on motion (this
    module's); what is settled for an interval is settled for its halves. Not certified are edges
    that do not keep the margin at a middle, those where the distance there falls short although the
    motion over the interval is down to the resolution, those of more open intervals than there is
    room for, and what is not finite.

    Args:
        work: (k, 2) intervals that wait; (k, bodies moving + pairs) what of them is settled.
    """
    if not np.isfinite(edge.a.sum() + edge.b.sum() + edge.deviation.sum()):
        return False
    bound, straight, moved = scratch.bound, scratch.bound_straight, scratch.motion
    movers, asked, kept = arm.movers, scratch.asked, limits.kept
    queue, settled = work
    items = len(movers)
    # The whole edge is the first interval: middle and half its length, as shares.
    head = 0
    waiting = 1
    queue[0, 0] = 0.5
    queue[0, 1] = 0.5
    settled[0, :] = False
    while waiting > 0:
        # The first interval that waits, with the arm at its middle.
        half = queue[head, 1]
        _place_interval(arm, scratch, edge, queue[head, 0], half)
        # Shorter intervals lessen the motion along the edge alone, not what strays from it.
        if half == 0.5:
            for j in range(edge.a.shape[0]):
                scratch.edge[1, j] = abs(edge.b[j] - edge.a[j])
            bound_motion(arm, scratch, scratch.edge[1], straight)
        # What is open, and how far each of it moves within the interval.
        count = 0
        for item in range(items):
            if not settled[head, item]:
                asked[count] = item
                count += 1
                moved[item] = bound[movers[item, 0], movers[item, 1]]
        # The margins at the middle.
        if not bodies_keep_boxes(arm, boxes, scratch, int(count), kept):
            return False
        if not pairs_keep(arm, scratch, int(count), kept.self_margin):
            return False
        # What keeps its motion too is settled, and all is to be within the shortest interval.
        open_items = False
        for k in range(count):
            item = asked[k]
            body, first = movers[item, 0], movers[item, 1]
            if moved[item] >= bound[body, first]:
                settled[head, item] = True
                continue
            open_items = True
            resolution = limits.resolution if item < arm.moving else limits.self_resolution
            if half * straight[body, first] <= resolution:
                return False
        # Halve the interval where anything is open.
        if open_items:
            if waiting + 2 > queue.shape[0]:
                return False
            # Its halves behind those that wait, in a ring, settled as far as it is.
            for side in range(2):
                place = (head + waiting) % queue.shape[0]
                queue[place, 0] = queue[head, 0] + (side - 0.5) * half
                queue[place, 1] = 0.5 * half
                for item in range(items):
                    settled[place, item] = settled[head, item]
                waiting += 1
        # On to the next that waits.
        head = (head + 1) % queue.shape[0]
        waiting -= 1
    return True
