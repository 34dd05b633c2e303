"""Configurations against the obstacle set and the robot itself, and what the tip alone decides.

What the last joint carries stands still against the tip, so where it collides, every configuration
with that pose of the tip does: known before any inverse kinematics.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from placement_planner_ros.core.collision import arrays as at
from placement_planner_ros.core.collision.against_boxes import (
    BoxArrays,
    body_meets_boxes,
    open_leaves,
    open_leaves_meet_boxes,
)
from placement_planner_ros.core.collision.against_robot import (
    bodies_meet,
    pair_meets,
    spheres_apart,
)
from placement_planner_ros.core.collision.arrays import ArmArrays, ArmScratch, Indices
from placement_planner_ros.core.collision.placing import (
    place_all_spheres,
    place_frame,
    place_joints,
    place_spheres,
)
from placement_planner_ros.core.collision.separation import COLLIDING, FREE
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted

NOT_FINITE = 4
"""A configuration holds a NaN or an infinity."""


class KeptMargins(NamedTuple):
    """What a configuration is to keep, metres."""

    margin: float
    """From the obstacle set; `self_margin`: of the robot from itself."""
    self_margin: float
    contact: bool
    """Whether the held object is left out against the obstacle set."""


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def check_states(
    arm: ArmArrays,
    boxes: BoxArrays,
    scratch: ArmScratch,
    Q: Array,
    kept: KeptMargins,
    answers: Indices,
) -> None:
    """Whether configurations Q (m, n) keep their margins; `answers` (m,) is filled.

    FREE and COLLIDING are certain, as they rest on certain answers for each body and each pair.
    What the last configuration meets, or leaves UNDECIDED, is the scratch's `hit`.
    """
    margin = kept.margin
    moving = arm.moving if boxes.number > 0 else 0
    left_out = arm.held if kept.contact else -1
    # Nothing moves: no range of joint values.
    still = scratch.edge[2]
    still[:] = 0.0
    for i in range(Q.shape[0]):
        if not np.isfinite(Q[i].sum()):
            answers[i] = NOT_FINITE
            continue
        place_joints(arm, scratch, Q[i])
        # The field of distances is asked for all bodies first: most collisions are found there.
        result, count = open_leaves(arm, boxes, scratch, (0, moving, left_out), margin, margin)
        # The boxes in reach of what the field leaves open.
        if result != COLLIDING and count > 0:
            result = open_leaves_meet_boxes(arm, boxes, scratch, count, margin, margin)
        if result != COLLIDING:
            # Then the robot against itself, up to the first collision.
            place_all_spheres(arm, scratch)
            for pair in range(arm.pairs.shape[0]):
                ranges = Q[i], still
                answer = pair_meets(arm, scratch, pair, ranges, kept.self_margin, kept.self_margin)
                if answer != FREE:
                    result = answer
                if answer == COLLIDING:
                    break
        answers[i] = result


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
    place_frame(scratch, last, T_world_joint)
    # Bodies that the joint carries, each against the obstacle set.
    bodies, pairs = arm.bodies, arm.pairs
    for body in range(arm.moving):
        if bodies[body, at.BODY_JOINT] != last:
            continue
        place_spheres(arm, scratch, body)
        if boxes.number == 0 or (kept.contact and body == arm.held):
            continue
        if body_meets_boxes(arm, boxes, scratch, body, kept.margin, kept.margin) == COLLIDING:
            return True
    # Pairs of a body that nothing moves and one that the joint carries.
    for pair in range(pairs.shape[0]):
        a, b = pairs[pair, at.PAIR_INNER], pairs[pair, at.PAIR_OUTER]
        if a < arm.moving or bodies[b, at.BODY_JOINT] != last:
            continue
        if spheres_apart(scratch, pairs[pair], kept.self_margin):
            continue
        if bodies_meet(arm, scratch, pair, kept.self_margin, kept.self_margin) == COLLIDING:
            return True
    return False
