"""Configurations against the obstacle set and the robot itself, and what the tip alone decides.

What the last joint carries stands still against the tip, so where it collides, every configuration
with that pose of the tip does: known before any inverse kinematics.
"""

from __future__ import annotations

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


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def check_states(
    arm: ArmArrays,
    boxes: BoxArrays,
    scratch: ArmScratch,
    Q: Array,
    kept: KeptMargins,
    answers: Mask,
) -> None:
    """Whether configurations Q (m, n) certainly keep their margins; `answers` (m,) is filled.

    What the last one does not keep them from is the scratch's `hit`. What is not finite does not.
    """
    # Everything is asked for, and nothing moves.
    q, items = scratch.edge[0], len(arm.movers)
    scratch.edge[2, :] = 0.0
    for item in range(items):
        scratch.asked[item] = item
        scratch.motion[item] = 0.0
    for i in range(Q.shape[0]):
        for j in range(q.shape[0]):
            q[j] = Q[i, j]
        answers[i] = np.isfinite(q.sum())
        if answers[i]:
            # Most collisions are with the obstacle set.
            place_joints(arm, scratch, q)
            answers[i] = bodies_keep_boxes(arm, boxes, scratch, items, kept)
        if answers[i]:
            # Then the robot against itself.
            place_spheres(arm, scratch, arm.moving)
            answers[i] = pairs_keep(arm, scratch, items, kept.self_margin)


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def check_hands(
    arm: ArmArrays,
    boxes: BoxArrays,
    scratch: ArmScratch,
    T: Array,
    kept: KeptMargins,
    answers: Mask,
) -> None:
    """Whether what the last joint carries keeps the margins with that joint at each of T (m, 4, 4);
    `answers` (m,) is filled."""
    last = len(arm.prismatic) - 1
    for i in range(T.shape[0]):
        # Whatever was placed before is outdated.
        for row in range(3):
            for column in range(4):
                scratch.frames[last, row, column] = T[i, row, column]
        scratch.stamp[0] += 1
        scratch.motion[:] = 0.0
        # The bodies that the joint carries, which are the first, against the obstacle set.
        count = 0
        while count < arm.moving and arm.bodies[count, at.BODY_JOINT] == last:
            scratch.asked[count] = count
            count += 1
        carried = int(count)
        place_spheres(arm, scratch, carried)
        answers[i] = bodies_keep_boxes(arm, boxes, scratch, carried, kept)
        if answers[i]:
            # Pairs of one of them and a body that nothing moves, wherever joints are.
            scratch.edge[2, :] = np.inf
            for pair in range(arm.pairs.shape[0]):
                inner, outer = arm.pairs[pair, at.PAIR_INNER], arm.pairs[pair, at.PAIR_OUTER]
                if inner >= arm.moving and outer < carried:
                    scratch.asked[count] = arm.moving + pair
                    count += 1
            answers[i] = pairs_keep(arm, scratch, int(count), kept.self_margin)
