"""Configurations against the obstacle set and the robot itself, and what the tip alone decides.

What the last joint carries stands still against the tip, so where it collides, every configuration
with that pose of the tip does: known before any inverse kinematics.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.collision import arrays as at
from placement_planner_ros.core.collision.against_boxes import BoxArrays, bodies_keep_boxes
from placement_planner_ros.core.collision.against_robot import bodies_keep, pair_keeps
from placement_planner_ros.core.collision.arrays import ArmArrays, ArmScratch
from placement_planner_ros.core.collision.placing import (
    place_all_spheres,
    place_frame,
    place_joints,
    place_spheres,
)
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted


class KeptMargins(NamedTuple):
    """What a configuration is to keep, metres."""

    margin: float
    """From the obstacle set; `self_margin`: of the robot from itself."""
    self_margin: float
    contact: bool
    """Whether the held object is left out against the obstacle set."""


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def keep_boxes(
    arm: ArmArrays,
    boxes: BoxArrays,
    scratch: ArmScratch,
    bodies: tuple[int, int],
    kept: KeptMargins,
    motion: float,
) -> bool:
    """Whether moving bodies, the first to before the last, certainly keep their margin, and
    `motion`, from the obstacle set."""
    asked = (bodies[0], bodies[1], arm.held if kept.contact else -1)
    return boxes.number == 0 or bodies_keep_boxes(
        arm, boxes, scratch, asked, kept.margin + motion, motion
    )


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
    q = scratch.edge[0]
    scratch.edge[2, :] = 0.0
    for i in range(Q.shape[0]):
        answers[i] = np.isfinite(Q[i].sum())
        if not answers[i]:
            continue
        # Most collisions are with the obstacle set, and found there at once.
        for j in range(q.shape[0]):
            q[j] = Q[i, j]
        place_joints(arm, scratch, q)
        answers[i] = keep_boxes(arm, boxes, scratch, (0, arm.moving), kept, 0.0)
        if not answers[i]:
            continue
        # Then the robot against itself.
        place_all_spheres(arm, scratch)
        for pair in range(arm.pairs.shape[0]):
            if not pair_keeps(arm, scratch, pair, kept.self_margin, 0.0):
                answers[i] = False
                break


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def hand_keeps(
    arm: ArmArrays, boxes: BoxArrays, scratch: ArmScratch, T_world_joint: Array, kept: KeptMargins
) -> bool:
    """Whether what the last joint carries keeps the margins, its moved frame being at (4, 4)."""
    last = len(arm.prismatic) - 1
    place_frame(scratch, last, T_world_joint)
    # Bodies that the joint carries, each against the obstacle set.
    bodies, pairs = arm.bodies, arm.pairs
    for body in range(arm.moving):
        if bodies[body, at.BODY_JOINT] == last:
            place_spheres(arm, scratch, body)
            if not keep_boxes(arm, boxes, scratch, (body, body + 1), kept, 0.0):
                return False
    # Pairs of a body that nothing moves and one that the joint carries.
    for pair in range(pairs.shape[0]):
        a, b = pairs[pair, at.PAIR_INNER], pairs[pair, at.PAIR_OUTER]
        carried = a >= arm.moving and bodies[b, at.BODY_JOINT] == last
        if carried and not bodies_keep(arm, scratch, pair, kept.self_margin, 0.0):
            return False
    return True
