"""Compiled walks along the self-motions of a redundant arm.

The configurations that bring the tip to one pose form curves (surfaces, with more than one joint to
spare). A walk follows a curve from one solution both ways: a step along the null space of the
Jacobian, then back onto the pose.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.reach.ik_kernels import (
    ROTATION_SCALE,
    descend,
    differs,
    solve_spd,
)
from placement_planner_ros.core.reach.kinematics import Flags, chain_frames, frames_jacobian
from placement_planner_ros.core.types import Array

CORRECTIONS = 6
"""Iterations at most that lead back onto the pose after a step."""

REGULARIZATION = 1e-9
"""Added to J Jᵀ, m²: singular configurations stay solvable."""

MIN_TANGENT = 0.05
"""Length below which what the null space leaves of a unit vector is no direction."""

MIN_STEP = 0.25
"""Share of a step that a joint limit must leave for it to be made."""


@kernel(lean=True)
def _project(frames: Array, prismatic: Flags, J: Array, M: Array, y: Array, tangent: Array) -> bool:
    """Project tangent (dof,) onto the null space of the Jacobian at frames; its length becomes 1.

    J (6, dof), M (6, 6) and y (6,) are scratch. False where next to nothing is left.
    """
    dof = len(tangent)
    frames_jacobian(frames, prismatic, frames[dof][:3, 3], J)
    for a in range(3, 6):
        for i in range(dof):
            J[a, i] *= ROTATION_SCALE
    for a in range(6):
        y[a] = 0.0
        for i in range(dof):
            y[a] += J[a, i] * tangent[i]
        for b in range(a + 1):
            s = 0.0
            for i in range(dof):
                s += J[a, i] * J[b, i]
            M[a, b] = s
        M[a, a] += REGULARIZATION
    solve_spd(M, y)
    squared = 0.0
    for i in range(dof):
        for a in range(6):
            tangent[i] -= J[a, i] * y[a]
        squared += tangent[i] ** 2
    if squared < MIN_TANGENT**2:
        return False
    scale = 1.0 / math.sqrt(squared)
    for i in range(dof):
        tangent[i] *= scale
    return True


@kernel(lean=True)
def _null_direction(
    frames: Array,
    prismatic: Flags,
    J: Array,
    M: Array,
    y: Array,
    axis: int,
    any_axis: bool,
    tangent: Array,
) -> bool:
    """tangent (dof,): joint `axis`, or the first that can, moved within the null space."""
    for i in range(len(tangent) if any_axis else 1):
        tangent[:] = 0.0
        tangent[(axis + i) % len(tangent)] = 1.0
        if _project(frames, prismatic, J, M, y, tangent):
            return True
    return False


@kernel(lean=True)
def _visited(q: Array, starts: Array, found: Array, prismatic: Flags, radius: float) -> bool:
    """Whether q is next to one of the configurations."""
    for near in (found, starts):
        for k in range(len(near) - 1, -1, -1):
            if not differs(near[k], q, prismatic, radius):
                return True
    return False


@kernel()
def _walk(
    fixed: Array,
    prismatic: Flags,
    lower: Array,
    upper: Array,
    target: Array,
    position_tolerance: float,
    rotation_tolerance: float,
    step: float,
    starts: Array,
    tangent: Array,
    frames: Array,
    J: Array,
    M: Array,
    y: Array,
    found: Array,
    count: int,
) -> int:
    """Walk from the last of the starts along tangent (dof,), adding to found (m, dof) from count.

    It ends at a joint limit, next to a start or what is found already, where even a short step does
    not come back onto the pose, and where found is full. Returns the new count.
    """
    dof = len(lower)
    last = starts[len(starts) - 1].copy()
    ahead = np.empty(dof)
    q = np.empty(dof)
    share = 1.0  # of a full step; halved after one that failed
    while count < len(found):
        largest = 0.0
        for i in range(dof):
            largest = max(largest, abs(tangent[i]))
        length = share * step / largest
        for i in range(dof):
            if tangent[i] > 0.0:
                length = min(length, (upper[i] - last[i]) / tangent[i])
            elif tangent[i] < 0.0:
                length = min(length, (lower[i] - last[i]) / tangent[i])
        moved = length * largest
        if moved < MIN_STEP * step:
            break
        for i in range(dof):
            ahead[i] = min(max(last[i] + length * tangent[i], lower[i]), upper[i])
            q[i] = ahead[i]
        reached = descend(
            fixed,
            prismatic,
            lower,
            upper,
            target,
            q,
            position_tolerance,
            rotation_tolerance,
            CORRECTIONS,
            frames,
            J,
        )
        strayed = 0.0
        for i in range(dof):
            strayed = max(strayed, abs(q[i] - ahead[i]))
        if not reached or strayed > 0.5 * moved:
            share *= 0.5
            continue
        if _visited(q, starts, found[:count], prismatic, 0.5 * moved):
            break
        found[count] = q
        last[:] = q
        count += 1
        share = min(1.0, 2.0 * share)
        if not _project(frames, prismatic, J, M, y, tangent):
            break
    return count


@kernel(nogil=True)
def sweep_batch(
    fixed: Array,
    prismatic: Flags,
    lower: Array,
    upper: Array,
    targets: Array,
    starts: Array,
    start_counts: npt.NDArray[np.int64],
    position_tolerance: float,
    rotation_tolerance: float,
    step: float,
    found: Array,
    counts: npt.NDArray[np.int64],
) -> None:
    """Fill found (n, m, dof), counts (n,) with what lies on the self-motions of the starts.

    Args:
        starts: (n, s, dof), of which the first start_counts[i] (n,) solve targets[i] (4, 4).
        step: rad or m, the largest change of a joint from one configuration to the next.
    """
    dof = len(lower)
    spare = dof - 6
    counts[:] = 0
    if spare < 1:
        return
    frames = np.zeros((dof + 1, 4, 4))
    J = np.empty((6, dof))
    M = np.empty((6, 6))
    y = np.empty(6)
    tangent = np.empty(dof)
    for n in range(len(targets)):
        count = 0
        own = starts[n, : start_counts[n]]
        for s in range(len(own)):
            if _visited(own[s], own[:0], found[n, :count], prismatic, 0.5 * step):
                continue
            # one direction spans a curve; a surface is cut along one direction for each joint
            for axis in range(1 if spare == 1 else dof):
                for side in (1.0, -1.0):
                    chain_frames(fixed, prismatic, own[s], frames)
                    if not _null_direction(frames, prismatic, J, M, y, axis, spare == 1, tangent):
                        break
                    for i in range(dof):
                        tangent[i] *= side
                    count = _walk(
                        fixed,
                        prismatic,
                        lower,
                        upper,
                        targets[n],
                        position_tolerance,
                        rotation_tolerance,
                        step,
                        own[: s + 1],
                        tangent,
                        frames,
                        J,
                        M,
                        y,
                        found[n],
                        count,
                    )
        counts[n] = count
