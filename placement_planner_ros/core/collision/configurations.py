"""Configurations against the obstacle set and the robot itself, and what the tip alone decides.

What the last joint carries stands still against the tip, so where it collides, every configuration
with that pose of the tip does: known before any inverse kinematics.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.collision import arrays as at
from placement_planner_ros.core.collision.against_boxes import (
    BoxArrays,
    KeptMargins,
    bodies_keep_boxes,
)
from placement_planner_ros.core.collision.against_robot import pairs_keep
from placement_planner_ros.core.collision.arrays import ArmArrays, ArmScratch
from placement_planner_ros.core.collision.placing import place_frame, place_joints, place_spheres
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def check_states(
    arm: ArmArrays,
    boxes: BoxArrays,
    scratch: ArmScratch,
    Q: Array,
    kept: KeptMargins,
    answers: npt.NDArray[np.bool_],
) -> None:
    """Whether configurations Q (m, n) certainly keep their margins; `answers` (m,) is filled.

    What the last one does not keep them from is the scratch's `hit`. What is not finite does not.
    """
    # Nothing moves.
    q = scratch.edge[0]
    scratch.edge[2, :] = 0.0
    scratch.motion[:] = 0.0
    for i in range(Q.shape[0]):
        answers[i] = np.isfinite(Q[i].sum())
        if answers[i]:
            for j in range(q.shape[0]):
                q[j] = Q[i, j]
            # Most collisions are with the obstacle set.
            place_joints(arm, scratch, q)
            answers[i] = bodies_keep_boxes(arm, boxes, scratch, arm.moving, kept)
        if answers[i]:
            # Then the robot against itself.
            place_spheres(arm, scratch, 0, arm.moving)
            answers[i] = pairs_keep(arm, scratch, kept.self_margin)


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def hand_keeps(
    arm: ArmArrays, boxes: BoxArrays, scratch: ArmScratch, T_world_joint: Array, kept: KeptMargins
) -> bool:
    """Whether what the last joint carries keeps the margins, its moved frame being at (4, 4)."""
    last = len(arm.prismatic) - 1
    place_frame(scratch, last, T_world_joint)
    # The bodies that the joint carries, which are the first, against the obstacle set.
    bodies, pairs, carried = arm.bodies, arm.pairs, 0
    while carried < arm.moving and bodies[carried, at.BODY_JOINT] == last:
        carried += 1
    scratch.motion[:] = 0.0
    place_spheres(arm, scratch, 0, carried)
    if not bodies_keep_boxes(arm, boxes, scratch, carried, kept):
        return False
    # Pairs of one of them and a body that nothing moves, wherever joints are.
    scratch.edge[2, :] = np.inf
    for pair in range(pairs.shape[0]):
        fixed = pairs[pair, at.PAIR_INNER] >= arm.moving and pairs[pair, at.PAIR_OUTER] < carried
        scratch.motion[arm.moving + pair] = 0.0 if fixed else -1.0
    return pairs_keep(arm, scratch, kept.self_margin)
