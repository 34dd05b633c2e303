"""Compiled checks of what a pose of the tip alone decides, before any inverse kinematics.

What the last joint carries stands still against the tip, so where it collides, every configuration
does. What the joint before it carries can only turn about the last axis; a turn by δ moves no
point of it further than δ ρ, ρ being its greatest distance from that axis. Where it is closer to
an obstacle than the margin less δ ρ, it therefore collides over the whole interval of ±δ, and
where such intervals cover the range of the last joint, every configuration collides.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.collision.against_boxes import (
    BoxArrays,
    body_meets_boxes,
)
from placement_planner_ros.core.collision.against_robot import bodies_meet, spheres_apart
from placement_planner_ros.core.collision.arrays import (
    BODY_JOINT,
    PAIR_INNER,
    PAIR_OUTER,
    SET_FIRST_VERTEX,
    SET_JOINT,
    ArmArrays,
    ArmScratch,
)
from placement_planner_ros.core.collision.placing import place_spheres
from placement_planner_ros.core.collision.separation import COLLIDING
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.types import Array

_GOLDEN_RATIO = 0.6180339887498949
_TURNED_SHARE = 0.9
"""Of the margin, that what turns may move within half an interval."""
_MAX_WRIST_INTERVALS = 256
"""Where more were needed, what the last joint but one carries is left out."""


@dataclass(frozen=True, slots=True)
class WristTurns:
    """How far what the last joint but one carries reaches, and how far it turns.

    Attributes:
        radius: ρ, metres; infinite where the last joint slides or there is no other.
        lower, upper: of the last joint, rad.
    """

    radius: float
    lower: float
    upper: float

    @classmethod
    def of(cls, arm: ArmArrays, lower: float, upper: float) -> WristTurns:
        """Of the arm laid out, given the limits of its last joint."""
        last = len(arm.prismatic) - 1
        if last < 1 or arm.prismatic[last]:
            return cls(math.inf, lower, upper)
        origin, axis = arm.fixed[last, :3, 3], arm.fixed[last, :3, 2]
        radius = 0.0
        for s in np.flatnonzero(arm.sets[:-1, SET_JOINT] == last - 1):
            rows = slice(arm.sets[s, SET_FIRST_VERTEX], arm.sets[s + 1, SET_FIRST_VERTEX])
            across = np.linalg.norm(np.cross(arm.vertices[rows] - origin, axis), axis=1)
            radius = max(radius, float(across.max()) + float(arm.radius[s]))
        return cls(radius, lower, upper)

    def intervals(self, margin: float) -> tuple[Array, float]:
        """Intervals of the last joint that cover its range.

        Returns:
            Their middles (m,), rad, m = 0 where the margin leaves too little; and how far a point
            moves within half of one, metres.
        """
        return _wrist_intervals(self, margin)


@functools.lru_cache(maxsize=64)
def _wrist_intervals(turns: WristTurns, margin: float) -> tuple[Array, float]:
    moved = _TURNED_SHARE * max(margin, 0.0)
    span = min(turns.upper - turns.lower, 2.0 * math.pi)
    number = 0
    if math.isfinite(turns.radius) and span * turns.radius <= 2.0 * moved * _MAX_WRIST_INTERVALS:
        number = math.ceil(0.5 * span * turns.radius / moved) if moved > 0.0 else 0
    return turns.lower + span * (np.arange(number) + 0.5) / max(number, 1), moved


@kernel(lean=True)
def spread_stride(count: int) -> int:
    """A stride that visits each of `count` items once and spreads them: k · stride mod count."""
    # About the golden ratio of them, and without a common divisor.
    stride = max(1, int(_GOLDEN_RATIO * count))
    while np.gcd(stride, count) > 1:
        stride += 1
    return stride


@kernel(lean=True)
def _carried_meets_boxes(
    arm: ArmArrays, boxes: BoxArrays, scratch: ArmScratch, joint: int, margin: float, contact: bool
) -> bool:
    """Whether a body that hangs on `joint`, whose frame is placed, surely meets an obstacle."""
    # Bodies that this joint carries, each against the obstacle set.
    for body in range(arm.moving):
        if arm.bodies[body, BODY_JOINT] != joint:
            continue
        place_spheres(arm, scratch, body)
        if boxes.number == 0 or (contact and body == arm.held):
            continue
        scratch.counters[2] = 0
        if body_meets_boxes(arm, boxes, scratch, body, margin, margin) == COLLIDING:
            return True
    return False


@kernel(lean=True)
def _carried_meets_fixed(arm: ArmArrays, scratch: ArmScratch, joint: int, margin: float) -> bool:
    """Whether a body that hangs on `joint` surely meets one that the arm does not move."""
    # Pairs of a body that nothing moves and one that this joint carries.
    world = len(arm.prismatic) + 1
    bodies, pairs = arm.bodies, arm.pairs
    for pair in range(pairs.shape[0]):
        a, b = pairs[pair, PAIR_INNER], pairs[pair, PAIR_OUTER]
        if bodies[a, BODY_JOINT] != world or bodies[b, BODY_JOINT] != joint:
            continue
        if spheres_apart(scratch, pairs[pair], margin):
            continue
        scratch.counters[2] = 0
        if bodies_meet(arm, scratch, pair, margin, margin) == COLLIDING:
            return True
    return False


@kernel(lean=True)
def _place_before(arm: ArmArrays, scratch: ArmScratch, T_world_joint: Array, q: float) -> None:
    """Frame of the last joint but one, the last being at q: T_world_joint · R_z(-q) · A⁻¹."""
    # Turn back by the last joint, then undo its fixed transform A, row by row.
    last = len(arm.prismatic) - 1
    frames, A = scratch.frames, arm.fixed[last]
    cos, sin = np.cos(q), np.sin(q)
    for i in range(3):
        x = cos * T_world_joint[i, 0] - sin * T_world_joint[i, 1]
        y = sin * T_world_joint[i, 0] + cos * T_world_joint[i, 1]
        z = T_world_joint[i, 2]
        p = T_world_joint[i, 3]
        for j in range(3):
            r = x * A[j, 0] + y * A[j, 1] + z * A[j, 2]
            frames[last - 1, i, j] = r
            p -= r * A[j, 3]
        frames[last - 1, i, 3] = p


@kernel(lean=True, nogil=True)
def hand_collides(
    arm: ArmArrays,
    boxes: BoxArrays,
    scratch: ArmScratch,
    T_world_joint: Array,
    margin: float,
    self_margin: float,
    contact: bool,
    middles: Array,
    shrunk_margin: float,
) -> bool:
    """Whether every configuration with the last joint's moved frame at (4, 4) surely collides.

    It does where what the last joint carries collides, or what the joint before it carries does at
    the middle of every interval, by more than it can turn away from (this module).

    Args:
        contact: leave out the held object against the obstacle set.
        middles: (m,) of the intervals that cover the last joint's range, rad; none to leave out
            what the joint before it carries.
        shrunk_margin: what the latter must fall short of at the middle of an interval, metres.
    """
    last = len(arm.prismatic) - 1
    # What stands still against the tip.
    scratch.counters[0] += 1
    for i in range(4):
        for j in range(4):
            scratch.frames[last, i, j] = T_world_joint[i, j]
    if _carried_meets_boxes(arm, boxes, scratch, last, margin, contact):
        return True
    if _carried_meets_fixed(arm, scratch, last, self_margin):
        return True
    number = len(middles)
    if number == 0 or boxes.number == 0:
        return False
    # What turns about the last axis: free at one middle, and nothing is certain.
    stride = spread_stride(number)
    for visit in range(number):
        # Turned to the middle of an interval, short of the margin by what it can turn away.
        scratch.counters[0] += 1
        _place_before(arm, scratch, T_world_joint, middles[(visit * stride) % number])
        if not _carried_meets_boxes(arm, boxes, scratch, last - 1, shrunk_margin, contact):
            return False
    return True
