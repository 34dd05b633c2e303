"""Compiled check of the object swept straight down onto poses, against the obstacle set.

The object is a body of its own, whose sets hold each vertex twice: where it rests and where it is
raised. What such a set sweeps is the hull of both copies, for which the kernels of
`against_boxes` answer as for any other; sets that cover a mesh only say what is free there too.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numba import njit

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision import arrays as at
from placement_planner_ros.core.collision.against_boxes import (
    BoxArrays,
    distance_bounds,
    leaves_keep_boxes,
    reach_along_side,
)
from placement_planner_ros.core.collision.arrays import (
    ArmArrays,
    ArmScratch,
    lone_body,
    scratch_for,
)
from placement_planner_ros.core.collision.attached_object import object_solids
from placement_planner_ros.core.collision.separation import BOUND_TOLERANCE_M
from placement_planner_ros.core.collision.solids import SolidRows
from placement_planner_ros.core.collision.spheres import shape_rows
from placement_planner_ros.core.reach.kinematics import to_world
from placement_planner_ros.core.types import Array, Mask
from placement_planner_ros.core.uncounted import Uncounted


class SweptPoses(NamedTuple):
    """Poses that the object is swept straight down onto, over contact planes of one slope."""

    T: Array
    """(n, 4, 4) T_world_object at rest."""
    contact: Array
    """(n,) heights of the contact planes at x = y = 0, metres."""
    raised: Array
    """(n,) how far above the pose the sweep begins, metres."""


class SweptObject(NamedTuple):
    """The object laid out as an arm without joints, and its balls at rest; a sweep changes them."""

    arm: ArmArrays
    balls: Array
    """(s, 5) around each set; not to be written to, the like of the body are shared."""


def swept_object(body: Body) -> tuple[SweptObject, ArmScratch]:
    """Lay out an object: one ball around each of its sets, which hold every vertex twice."""
    rows = SolidRows.joined([shape_rows(solid.shape, np.inf) for solid in object_solids(body)])
    parts = np.split(rows.vertices, rows.sets[1:, at.SET_FIRST_VERTEX])
    raised = replace(
        rows,
        node_spheres=rows.node_spheres.copy(),
        vertices=np.vstack([part for part in parts for _ in range(2)]),
        sets=rows.sets * np.where(np.arange(3) == at.SET_FIRST_VERTEX, 2, 1),
    )
    flat = lone_body(raised)
    return SweptObject(flat.arrays, rows.node_spheres), scratch_for(flat)


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def check_poses(
    thing: SweptObject,
    boxes: BoxArrays,
    scratch: ArmScratch,
    poses: SweptPoses,
    margin: float,
    answers: Mask,
) -> None:
    """Whether the object keeps the margin on its way straight down onto each pose.

    Balls around sets against the field of distances, then the swept sets against boxes. What a ball
    sweeps lies in the ball around the sweep's middle that is larger by half its height. Filled are
    the `answers` (n,).
    """
    arm, frames, balls = thing.arm, scratch.frames, thing.balls
    for row in range(len(answers)):
        # The object where it rests; whatever was placed before is outdated.
        T, raised = poses.T[row], poses.raised[row]
        scratch.stamp[0] += 1
        total = raised
        for i in range(4):
            for j in range(4):
                frames[0, i, j] = T[i, j]
                total += T[i, j]
        # What is not finite is not free.
        answers[row] = np.isfinite(total)
        # The support is that of this pose.
        scratch.sweep[0] = raised
        boxes.support[0] = poses.contact[row]
        # The ball around each set, where it is halfway up.
        for s in range(len(balls)):
            x, y, z = to_world(frames, 0, balls[s, 0], balls[s, 1], balls[s, 2])
            bound, _ = distance_bounds(boxes.field_grid, boxes.field, x, y, z + 0.5 * raised)
            if bound >= balls[s, 3] + 0.5 * raised + (margin + BOUND_TOLERANCE_M):
                continue
            # The set's vertices once more where they are raised, and the ball around both.
            first, last = arm.sets[s, at.SET_FIRST_VERTEX], arm.sets[s + 1, at.SET_FIRST_VERTEX]
            count = (last - first) // 2
            for i in range(3):
                up = T[2, i] * raised
                for v in range(first, first + count):
                    arm.vertices[v + count, i] = arm.vertices[v, i] + up
                arm.node_spheres[s, i] = balls[s, i] + 0.5 * up
            arm.node_spheres[s, 3] = balls[s, 3] + 0.5 * raised
            reach_along_side(arm, scratch, s)
            # The boxes in its reach, up to the first that is met.
            scratch.leaves[0], scratch.leaf_bounds[0] = s, -np.inf
            if not leaves_keep_boxes(arm, boxes, scratch, (0, 1), margin, True):
                answers[row] = False
                break
