"""Configurations against the obstacle set and against the robot itself."""

from __future__ import annotations

import numpy as np
from numba import njit

from placement_planner_ros.core.collision.against_boxes import (
    BoxArrays,
    open_leaves,
    open_leaves_meet_boxes,
)
from placement_planner_ros.core.collision.against_robot import pair_meets
from placement_planner_ros.core.collision.arrays import ArmArrays, ArmScratch, Indices
from placement_planner_ros.core.collision.hand import KeptMargins
from placement_planner_ros.core.collision.placing import place_all_spheres, place_joints
from placement_planner_ros.core.collision.separation import COLLIDING, FREE, UNDECIDED
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted

NOT_FINITE = 4
"""A configuration holds a NaN or an infinity."""


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
    for i in range(Q.shape[0]):
        if not np.isfinite(Q[i].sum()):
            answers[i] = NOT_FINITE
            continue
        place_joints(arm, scratch, Q[i])
        # The field of distances is asked for all bodies first: most collisions are found there.
        result, count = open_leaves(arm, boxes, scratch, 0, moving, left_out, margin, margin)
        # The boxes in reach of what the field leaves open.
        if result != COLLIDING and count > 0:
            result = open_leaves_meet_boxes(arm, boxes, scratch, count, margin, margin)
        if result != COLLIDING:
            # Then the robot against itself.
            place_all_spheres(arm, scratch)
            apart = _pairs_meet(arm, scratch, Q[i], kept.self_margin)
            if apart != FREE:
                result = apart
        answers[i] = result


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _pairs_meet(arm: ArmArrays, scratch: ArmScratch, q: Array, margin: float) -> int:
    """The robot against itself at q (n,), where it has been placed."""
    # Nothing moves: no range of joint values.
    still = scratch.edge[2]
    still[:] = 0.0
    result = FREE
    # Pair by pair, up to the first collision.
    for pair in range(arm.pairs.shape[0]):
        answer = pair_meets(arm, scratch, pair, q, still, margin, margin)
        if answer == COLLIDING:
            return COLLIDING
        if answer == UNDECIDED:
            result = UNDECIDED
    return result
