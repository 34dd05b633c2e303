"""Compiled check of the object swept straight down onto poses, against the obstacle set.

The object is a body of its own, whose sets hold each vertex twice: where it rests and where it is
raised. What such a set sweeps is the hull of both copies, for which the kernels of
`against_boxes` answer as for any other; sets that cover a mesh only say what is free there too.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision import arrays as at
from placement_planner_ros.core.collision.against_boxes import (
    BoxArrays,
    begin_set,
    distance_bounds,
    leaf_keeps_boxes,
)
from placement_planner_ros.core.collision.arrays import (
    ArmArrays,
    ArmScratch,
    lone_body,
    scratch_for,
)
from placement_planner_ros.core.collision.attached_object import object_solids
from placement_planner_ros.core.collision.placing import place_frame
from placement_planner_ros.core.collision.separation import BOUND_TOLERANCE_M
from placement_planner_ros.core.collision.solids import SolidRows
from placement_planner_ros.core.reach.kinematics import to_world
from placement_planner_ros.core.types import Array
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
    """(s, 4) around each set."""


def swept_object(body: Body, boxes: int) -> tuple[SweptObject, ArmScratch]:
    """Lay out an object: one ball around each of its sets, which hold every vertex twice.

    Args:
        boxes: how many obstacles the work space is for.
    """
    rows = SolidRows.joined([SolidRows.of(solid.shape, np.inf) for solid in object_solids(body)])
    ends = np.append(rows.sets[1:, at.SET_FIRST_VERTEX], len(rows.vertices))
    parts = np.split(rows.vertices, ends[:-1])
    rows = replace(
        rows,
        vertices=np.vstack([part for part in parts for _ in range(2)]),
        sets=rows.sets * np.where(np.arange(3) == at.SET_FIRST_VERTEX, 2, 1),
    )
    flat = lone_body(rows)
    return SweptObject(flat.arrays, rows.node_spheres.copy()), scratch_for(flat, boxes)


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _sweep_set(thing: SweptObject, s: int, up: tuple[float, float, float], raised: float) -> None:
    """Make the second copy of a set's vertices, and its ball.

    Args:
        up: the way from rest to raised, in the object's frame.
        raised: its length.
    """
    arm = thing.arm
    first, last = arm.sets[s, at.SET_FIRST_VERTEX], arm.sets[s + 1, at.SET_FIRST_VERTEX]
    count = (last - first) // 2
    node = arm.sets[s, at.SET_FIRST_NODE]
    for i in range(3):
        # The raised copy, and the ball around the middle of the sweep.
        for v in range(first, first + count):
            arm.vertices[v + count, i] = arm.vertices[v, i] + up[i]
        arm.node_spheres[node, i] = thing.balls[s, i] + 0.5 * up[i]
    arm.node_spheres[node, 3] = thing.balls[s, 3] + 0.5 * raised


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _ball_clear(boxes: BoxArrays, frames: Array, ball: Array, raised: float, margin: float) -> bool:
    """Whether a ball (4,) in the object's frame, swept, surely keeps the margin from all boxes.

    What it sweeps lies in the ball around the sweep's middle that is larger by half its height.
    """
    # The distance of the sweep's middle, against the ball grown by half the sweep.
    x, y, z = to_world(frames, 0, ball[0], ball[1], ball[2])
    bound, _ = distance_bounds(boxes.field_grid, boxes.field, x, y, z + 0.5 * raised)
    return bound >= ball[3] + 0.5 * raised + (margin + BOUND_TOLERANCE_M)


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def check_poses(
    thing: SweptObject,
    boxes: BoxArrays,
    scratch: ArmScratch,
    poses: SweptPoses,
    margin: float,
    answers: npt.NDArray[np.bool_],
) -> None:
    """Whether the object keeps the margin on its way straight down onto each pose.

    Balls around the object and around each set against the field of distances, then the swept
    sets against boxes. Filled are the `answers` (n,).
    """
    arm, frames = thing.arm, scratch.frames
    for row in range(len(answers)):
        T, raised = poses.T[row], poses.raised[row]
        place_frame(scratch, 0, T)
        # The ball around all of the object.
        answers[row] = True
        if boxes.number == 0 or _ball_clear(boxes, frames, arm.body_spheres[0], raised, margin):
            continue
        # The support is that of this pose.
        scratch.sweep[0] = raised
        boxes.support[0] = poses.contact[row]
        up = (T[2, 0] * raised, T[2, 1] * raised, T[2, 2] * raised)
        # Set by set: the ball around it, then the boxes in reach, up to the first that is met.
        for s in range(len(arm.radius)):
            if _ball_clear(boxes, frames, thing.balls[s], raised, margin):
                continue
            _sweep_set(thing, s, up, raised)
            begin_set(arm, scratch, s, margin)
            node = arm.sets[s, at.SET_FIRST_NODE]
            if not leaf_keeps_boxes(arm, boxes, scratch, node, margin, True):
                answers[row] = False
                break
