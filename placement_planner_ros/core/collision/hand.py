"""The compiled check of what a pose of the tip alone decides, before any inverse kinematics.

What the last joint carries stands still against the tip, so where it collides, every configuration
does.
"""

from __future__ import annotations

from typing import NamedTuple

from numba import njit

from placement_planner_ros.core.collision.against_boxes import (
    BoxArrays,
    body_meets_boxes,
)
from placement_planner_ros.core.collision.against_robot import bodies_meet, spheres_apart
from placement_planner_ros.core.collision.arrays import (
    BODY_JOINT,
    PAIR_INNER,
    PAIR_OUTER,
    ArmArrays,
    ArmScratch,
)
from placement_planner_ros.core.collision.placing import place_spheres
from placement_planner_ros.core.collision.separation import COLLIDING
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted


class KeptMargins(NamedTuple):
    """What a configuration is to keep, metres."""

    margin: float
    """From the obstacle set; `self_margin`: of the robot from itself."""
    self_margin: float
    contact: bool
    """Whether the held object is left out against the obstacle set."""


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def hand_collides(
    arm: ArmArrays,
    boxes: BoxArrays,
    scratch: ArmScratch,
    T_world_joint: Array,
    kept: KeptMargins,
) -> bool:
    """Whether what the last joint carries surely collides, its moved frame being at (4, 4)."""
    last = len(arm.prismatic) - 1
    scratch.counters[0] += 1
    for i in range(4):
        for j in range(4):
            scratch.frames[last, i, j] = T_world_joint[i, j]
    # Bodies that the joint carries, each against the obstacle set.
    bodies, pairs = arm.bodies, arm.pairs
    for body in range(arm.moving):
        if bodies[body, BODY_JOINT] != last:
            continue
        place_spheres(arm, scratch, body)
        if boxes.number == 0 or (kept.contact and body == arm.held):
            continue
        if body_meets_boxes(arm, boxes, scratch, body, kept.margin, kept.margin) == COLLIDING:
            return True
    # Pairs of a body that nothing moves and one that the joint carries.
    for pair in range(pairs.shape[0]):
        a, b = pairs[pair, PAIR_INNER], pairs[pair, PAIR_OUTER]
        if a < arm.moving or bodies[b, BODY_JOINT] != last:
            continue
        if spheres_apart(scratch, pairs[pair], kept.self_margin):
            continue
        if bodies_meet(arm, scratch, pair, kept.self_margin, kept.self_margin) == COLLIDING:
            return True
    return False
