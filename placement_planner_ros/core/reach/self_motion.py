"""Compiled walks along the self-motions of a redundant arm.

The configurations that bring the tip to one pose form curves (surfaces, with more than one joint to
spare). A walk follows a curve from one solution both ways: a step along the null space of the
Jacobian, then back onto the pose.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from placement_planner_ros.core.reach.ik_kernels import (
    MIN_DAMPING_M2,
    STALL_ITERATIONS,
    IKArm,
    IKScratch,
    descend_to_target,
    is_among,
    solve_normal,
    weighted_jacobian,
)
from placement_planner_ros.core.reach.kinematics import chain_frames
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted

MIN_TANGENT_LENGTH = 0.05
"""Length below which what the null space leaves of a unit vector is no direction."""

MIN_STEP_SHARE = 0.25
"""Share of a step that a joint limit must leave for it to be made."""


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _project_to_null_space(arm: IKArm, tangent: Array, scratch: IKScratch) -> bool:
    """Project tangent (n,) onto the null space of the Jacobian at the scratch's frames.

    Its length becomes 1. False where next to nothing is left.
    """
    J, y = scratch.J, scratch.y
    dof = len(tangent)
    # J times the tangent: the tip's motion that is to be taken out.
    weighted_jacobian(arm, scratch)
    for a in range(6):
        y[a] = 0.0
        for i in range(dof):
            y[a] += J[a, i] * tangent[i]
    # The joint motion of least norm that does the same, all joints taking part.
    scratch.free[:] = True
    solve_normal(scratch, MIN_DAMPING_M2)
    # Take it off the tangent; followers move as their masters do.
    for i in range(dof):
        for a in range(6):
            tangent[i] -= J[a, i] * y[a]
    for k in range(len(arm.ties)):
        tangent[int(arm.ties[k, 0])] = arm.ties[k, 2] * tangent[int(arm.ties[k, 1])]
    # What is left, to length 1.
    squared = 0.0
    for i in range(dof):
        squared += tangent[i] ** 2
    if squared < MIN_TANGENT_LENGTH**2:
        return False
    scale = 1.0 / math.sqrt(squared)
    for i in range(dof):
        tangent[i] *= scale
    return True


@njit(cache=True, nogil=True)
def _walk_self_motion(
    arm: IKArm,
    target: Array,
    starts: Array,
    tangent: Array,
    found: Array,
    count: int,
    scratch: IKScratch,
) -> int:
    """Walk from the last of the starts along tangent (n,), adding to found (m, n) from count.

    It ends at a joint limit, next to a start or what is found already, where even a short step does
    not come back onto the pose, and where found is full. Returns the new count.
    """
    lower, upper, step = arm.lower, arm.upper, arm.sweep_step
    dof = len(lower)
    # The walk starts at the last of the starts.
    last = starts[len(starts) - 1].copy()
    ahead = np.empty(dof)
    q = np.empty(dof)
    share = 1.0  # of a full step; halved after one that failed
    while count < len(found):
        # A step along the tangent, shortened where a limit comes first.
        largest = 0.0
        for i in range(dof):
            largest = max(largest, abs(tangent[i]))
        length = share * step / largest
        for i in range(dof):
            if tangent[i] > 0.0:
                length = min(length, (upper[i] - last[i]) / tangent[i])
            elif tangent[i] < 0.0:
                length = min(length, (lower[i] - last[i]) / tangent[i])
        # Too short a step: the walk is at a limit.
        moved = length * largest
        if moved < MIN_STEP_SHARE * step:
            break
        # That far along the tangent, within limits.
        for i in range(dof):
            ahead[i] = min(max(last[i] + length * tangent[i], lower[i]), upper[i])
            q[i] = ahead[i]
        # Back onto the pose, and not far along it: else it may be another curve.
        reached = descend_to_target(arm, target, q, int(STALL_ITERATIONS), scratch)
        strayed = 0.0
        for i in range(dof):
            strayed = max(strayed, abs(q[i] - ahead[i]))
        if not reached or strayed > 0.5 * moved:
            share *= 0.5
            continue
        # A configuration that was there before closes the curve.
        radius = 0.5 * moved
        if is_among(q, found[:count], arm.prismatic, radius) or is_among(
            q, starts, arm.prismatic, radius
        ):
            break
        # Keep it, and try twice as long a step next.
        for i in range(dof):
            found[count, i] = last[i] = q[i]
        count += 1
        share = min(1.0, 2.0 * share)
        # The old tangent, projected, goes on in the same direction.
        if not _project_to_null_space(arm, tangent, scratch):
            break
    return count


@njit(cache=True, nogil=True)
def sweep_target(arm: IKArm, target: Array, starts: Array, found: Array, scratch: IKScratch) -> int:
    """Fill found (m, n) with what lies on the self-motions of the starts; how many.

    Args:
        starts: (s, n) solutions of the target (4, 4).
    """
    # Joints beyond the six that a pose needs: without them there is no self-motion.
    dof = len(arm.lower)
    spare = dof - len(arm.ties) - 6
    if spare < 1:
        return 0
    tangent = np.empty(dof)
    count = 0
    for s in range(len(starts)):
        # Each start, but for those that a walk has passed already.
        if is_among(starts[s], found[:count], arm.prismatic, 0.5 * arm.sweep_step):
            continue
        for axis in range(dof):
            moves = False
            for side in (1.0, -1.0):
                # The direction in which the joint moves without the tip, then its opposite.
                chain_frames(arm.fixed, arm.prismatic, starts[s], scratch.frames)
                tangent[:] = 0.0
                tangent[axis] = side
                if not _project_to_null_space(arm, tangent, scratch):
                    break
                # The walk along it.
                moves = True
                count = _walk_self_motion(
                    arm, target, starts[: s + 1], tangent, found, int(count), scratch
                )
            # One direction spans a curve; a surface is cut along one direction for each joint.
            if moves and spare == 1:
                break
    return count
