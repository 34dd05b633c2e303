"""Compiled loops of inverse kinematics: damped least squares, batches of it, straight lines.

Each iteration solves min |J dq - e|² + λ |dq|² with λ proportional to the squared error (Sugihara,
"Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", 2011), over the
joints that are not pressed against a limit: dq = Jᵀ (J Jᵀ + λ I)⁻¹ e, a system of six whatever the
number of joints. A solution is checked, never assumed: it counts where the tip at q is within the
tolerances of the target.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from placement_planner_ros.core.reach.kinematics import chain_frames, frames_jacobian
from placement_planner_ros.core.types import Array, Mask
from placement_planner_ros.core.uncounted import Uncounted

ROTATION_SCALE_M = 0.25
"""m; a rotation error of 1 rad weighs as much as this position error."""

DAMPING_PER_ERROR = 0.1
"""λ per squared error."""

MIN_DAMPING_M2 = 1e-7
"""λ at zero error, m²."""

MAX_JOINT_STEP = 0.7
"""rad or m, largest change of a joint in an iteration."""

STALL_ITERATIONS = 8
"""Iterations within which the squared error must halve, and within which a descent that starts next
to its target must be there."""


class IKArm(NamedTuple):
    """An arm of n joints as `kinematics.Chain` describes it, and numbers of `IKSettings`."""

    fixed: Array
    prismatic: Mask
    lower: Array
    upper: Array
    ties: Array
    position_tolerance: float
    rotation_tolerance: float
    max_iterations: int
    min_difference: float
    sweep_step: float
    max_joint_step: float
    line_tolerance: float


class IKScratch(NamedTuple):
    """Work space for an arm of n joints."""

    frames: Array
    """(n + 1, 4, 4) of `chain_frames`."""
    J: Array
    """(6, n) of the tip, rotation weighed by ROTATION_SCALE."""
    L: Array
    """(6, 6), the factor of the system to solve, below and on its diagonal."""
    y: Array
    """(6,) its right-hand side, then its solution."""
    error: Array
    """(6,)"""
    free: Mask
    """(n,) joints that take part."""
    dq: Array
    """(n,)"""


def ik_scratch(dof: int) -> IKScratch:
    """Work space for an arm of so many joints."""
    return IKScratch(
        np.zeros((dof + 1, 4, 4)),
        np.empty((6, dof)),
        np.empty((6, 6)),
        np.empty(6),
        np.empty(6),
        np.ones(dof, np.bool_),
        np.empty(dof),
    )


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _pose_error(tip: Array, target: Array, error: Array) -> None:
    """error (6,): translation, then rotation vector, that take the tip to the target, in world."""
    for a in range(3):
        # The translation that is left.
        error[a] = target[a, 3] - tip[a, 3]
    # R = R_target R_tipᵀ
    # its diagonal, and the part that is skew: 2 sin(angle) axis
    d0 = d1 = d2 = vx = vy = vz = 0.0
    for c in range(3):
        d0 += target[0, c] * tip[0, c]
        d1 += target[1, c] * tip[1, c]
        d2 += target[2, c] * tip[2, c]
        vx += target[2, c] * tip[1, c] - target[1, c] * tip[2, c]
        vy += target[0, c] * tip[2, c] - target[2, c] * tip[0, c]
        vz += target[1, c] * tip[0, c] - target[0, c] * tip[1, c]
    sine = 0.5 * math.sqrt(vx * vx + vy * vy + vz * vz)
    cosine = 0.5 * (d0 + d1 + d2 - 1.0)
    # axis times angle; for small angles the skew part is that already
    if sine > 1e-9:
        scale = 0.5 * math.atan2(sine, cosine) / sine
        error[3], error[4], error[5] = scale * vx, scale * vy, scale * vz
    elif cosine > 0.0:
        error[3], error[4], error[5] = 0.5 * vx, 0.5 * vy, 0.5 * vz
    else:  # half a turn: about which axis is seen once the first step is made
        error[3], error[4], error[5] = math.pi, 0.0, 0.0


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def follow_in_place(ties: Array, q: Array) -> None:
    """`arm.follow_masters` of q (n,) itself."""
    # Each follower from the joint that it follows.
    for k in range(len(ties)):
        q[int(ties[k, 0])] = ties[k, 2] * q[int(ties[k, 1])] + ties[k, 3]


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def weighted_jacobian(arm: IKArm, scratch: IKScratch) -> None:
    """J of the tip where the frames are, a radian weighing as much as ROTATION_SCALE metres.

    What tied joints move is in the column of the joint that they follow.
    """
    frames, J = scratch.frames, scratch.J
    dof = len(arm.lower)
    frames_jacobian(
        frames, arm.prismatic, frames[dof, 0, 3], frames[dof, 1, 3], frames[dof, 2, 3], J
    )
    # rotation in metres
    for a in range(3, 6):
        for i in range(dof):
            J[a, i] *= ROTATION_SCALE_M
    # a follower's column, by its factor, joins that of its master
    for k in range(len(arm.ties)):
        joint, other = int(arm.ties[k, 0]), int(arm.ties[k, 1])
        for a in range(6):
            J[a, other] += arm.ties[k, 2] * J[a, joint]
            J[a, joint] = 0.0


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def solve_normal(scratch: IKScratch, damping: float) -> None:
    """y := (J Jᵀ + damping I)⁻¹ y by Cholesky, J without the joints that are not free."""
    J, L, y, free = scratch.J, scratch.L, scratch.y, scratch.free
    # L of L Lᵀ = J Jᵀ + damping I
    for a in range(len(y)):
        for b in range(a + 1):
            s = damping if a == b else 0.0
            for i in range(len(free)):
                if free[i]:
                    s += J[a, i] * J[b, i]
            for k in range(b):
                s -= L[a, k] * L[b, k]
            L[a, b] = math.sqrt(s) if a == b else s / L[b, b]
    # forwards: L z = y
    for a in range(len(y)):
        for k in range(a):
            y[a] -= L[a, k] * y[k]
        y[a] /= L[a, a]
    # backwards: Lᵀ x = z
    for a in range(len(y) - 1, -1, -1):
        for k in range(a + 1, len(y)):
            y[a] -= L[k, a] * y[k]
        y[a] /= L[a, a]


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _step_within_limits(arm: IKArm, q: Array, scratch: IKScratch, damping: float) -> None:
    """dq: the damped least squares' step for the error, without the joints at a limit that the
    gradient Jᵀ e presses against it."""
    J, y, error, free, dq = scratch.J, scratch.y, scratch.error, scratch.free, scratch.dq
    for i in range(len(q)):
        gradient = 0.0
        for a in range(6):
            gradient += J[a, i] * error[a]
        pressed = (q[i] <= arm.lower[i] and gradient < 0.0) or (
            q[i] >= arm.upper[i] and gradient > 0.0
        )
        free[i] = not pressed
    # the damped step of the free joints
    for a in range(6):
        y[a] = error[a]
    solve_normal(scratch, damping)
    for i in range(len(q)):
        dq[i] = 0.0
        if free[i]:
            for a in range(6):
                dq[i] += J[a, i] * y[a]


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def descend_to_target(
    arm: IKArm, target: Array, q: Array, max_iterations: int, scratch: IKScratch
) -> bool:
    """Move q (n,) within its limits until the tip is at the target (4, 4); False where it is not.

    The frames of the scratch hold the chain at q on return.
    """
    dof = len(q)
    error, dq = scratch.error, scratch.dq
    best = np.inf
    age = 0
    for iteration in range(max_iterations + 1):
        # How far off the tip is, and whether that still gets better.
        chain_frames(arm.fixed, arm.prismatic, q, scratch.frames)
        _pose_error(scratch.frames[dof], target, error)
        position = error[0] ** 2 + error[1] ** 2 + error[2] ** 2
        rotation = error[3] ** 2 + error[4] ** 2 + error[5] ** 2
        # At the target, within both tolerances.
        if position <= arm.position_tolerance**2 and rotation <= arm.rotation_tolerance**2:
            return True
        # The error with rotation in metres; `age` counts steps that did not halve its square.
        squared = position + ROTATION_SCALE_M**2 * rotation
        if squared < 0.5 * best:
            best = squared
            age = 0
        else:
            age += 1
        if iteration == max_iterations or age > STALL_ITERATIONS:
            return False
        # The step, shortened where a joint would go further than the linear model is good for.
        weighted_jacobian(arm, scratch)
        for a in range(3, 6):
            error[a] *= ROTATION_SCALE_M
        _step_within_limits(arm, q, scratch, DAMPING_PER_ERROR * squared + MIN_DAMPING_M2)
        largest = 0.0
        for i in range(dof):
            largest = max(largest, abs(dq[i]))
        scale = min(1.0, MAX_JOINT_STEP / max(largest, 1e-300))
        # The step, kept within limits, with the followers.
        for i in range(dof):
            q[i] = min(max(q[i] + scale * dq[i], arm.lower[i]), arm.upper[i])
        follow_in_place(arm.ties, q)
    return False


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def is_among(q: Array, known: Array, prismatic: Mask, min_difference: float) -> bool:
    """Whether q (n,) is one of configurations (k, n), but for full turns and `min_difference`."""
    # Newest first, as the last steps of a walk are nearest.
    for k in range(len(known) - 1, -1, -1):
        same = True
        for i in range(len(q)):
            # The difference of a joint that turns, without full turns.
            d = abs(known[k, i] - q[i])
            if not prismatic[i]:
                d = abs(d - 2.0 * math.pi * math.floor(d / (2.0 * math.pi) + 0.5))
            if d > min_difference:
                same = False
                break
        if same:
            return True
    return False


@njit(cache=True, nogil=True)
def solve_target(
    arm: IKArm, target: Array, seeds: Array, solutions: Array, scratch: IKScratch
) -> int:
    """Fill solutions (k, n) of a target (4, 4) from seeds (s, n), distinct ones; how many."""
    count = 0
    for s in range(len(seeds)):
        # Every seed, until the solutions are as many as there is room for.
        if count == len(solutions):
            break
        # From the seed, brought within limits, to the target.
        q = solutions[count]
        for i in range(len(q)):
            q[i] = min(max(seeds[s, i], arm.lower[i]), arm.upper[i])
        follow_in_place(arm.ties, q)
        if not descend_to_target(arm, target, q, arm.max_iterations, scratch):
            continue
        # Kept unless a solution that is the same but for full turns is there.
        if not is_among(q, solutions[:count], arm.prismatic, arm.min_difference):
            count += 1
    return count


@njit(cache=True, nogil=True)
def track_targets(arm: IKArm, targets: Array, q0: Array, path: Array, scratch: IKScratch) -> bool:
    """Fill path (m, n) with what follows targets (m, 4, 4) from q0 (n,); False where that fails.

    No joint moves further than `max_joint_step` between two targets, and half-way in the joints the
    tip is within `line_tolerance` (m, rad) of half-way between both.
    """
    dof = len(arm.lower)
    # Start at q0, its followers where they belong.
    q = q0.copy()
    follow_in_place(arm.ties, q)
    previous = q.copy()
    between = np.empty(dof)
    error = np.empty(6)
    other = np.empty(6)
    for n in range(len(targets)):
        # On to the next target, from the configuration before.
        if not descend_to_target(arm, targets[n], q, int(STALL_ITERATIONS), scratch):
            return False
        # No joint may have moved too far; half-way in the joints.
        for i in range(dof):
            if abs(q[i] - previous[i]) > arm.max_joint_step:
                return False
            between[i] = 0.5 * (q[i] + previous[i])
            path[n, i] = previous[i] = q[i]
        if n == 0:
            continue
        # Where the tip is in the middle of both, the ways to them are opposite.
        chain_frames(arm.fixed, arm.prismatic, between, scratch.frames)
        _pose_error(scratch.frames[dof], targets[n - 1], other)
        _pose_error(scratch.frames[dof], targets[n], error)
        # What the tip is off from the middle of both targets.
        for a in range(6):
            error[a] = 0.5 * (error[a] + other[a])
        if (
            error[0] ** 2 + error[1] ** 2 + error[2] ** 2 > arm.line_tolerance**2
            or error[3] ** 2 + error[4] ** 2 + error[5] ** 2 > arm.line_tolerance**2
        ):
            return False
    return True
