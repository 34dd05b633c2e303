"""Compiled loops of inverse kinematics: damped least squares, batches of it, straight lines.

Each iteration solves min |J dq - e|² + λ |dq|² with λ proportional to the squared error (Sugihara,
"Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", 2011), over the
joints that are not pressed against a limit.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.reach.kinematics import Flags, chain_frames, frames_jacobian
from placement_planner_ros.core.types import Array

ROTATION_SCALE = 0.25
"""m; a rotation error of 1 rad weighs as much as this position error."""

DAMPING = 0.1
"""λ per squared error."""

MIN_DAMPING = 1e-7
"""λ at zero error, m²."""

MAX_STEP = 0.7
"""rad or m, largest change of a joint in an iteration."""

STALL = 8
"""Iterations within which the squared error must halve."""

TRACK_ITERATIONS = 10
"""Iterations per waypoint of `track`, which starts next to its solution."""


@kernel(lean=True)
def _pose_error(tip: Array, target: Array, error: Array) -> None:
    """error (6,): translation, then rotation vector, that take the tip to the target, in world."""
    for a in range(3):
        error[a] = target[a, 3] - tip[a, 3]
    # R = R_target R_tipᵀ
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
    if sine > 1e-9:
        scale = 0.5 * math.atan2(sine, cosine) / sine
        error[3], error[4], error[5] = scale * vx, scale * vy, scale * vz
    elif cosine > 0.0:
        error[3], error[4], error[5] = 0.5 * vx, 0.5 * vy, 0.5 * vz
    else:  # half a turn: R = 2 a aᵀ - I, any sign of the axis a
        k = 0
        if d1 > d0:
            k = 1
        if d2 > max(d0, d1):
            k = 2
        norm = 0.0
        for a in range(3):
            entry = 0.0
            for c in range(3):
                entry += target[a, c] * tip[k, c]
            if a == k:
                entry += 1.0
            error[3 + a] = entry
            norm += entry * entry
        for a in range(3, 6):
            error[a] *= math.pi / math.sqrt(norm)


@kernel(lean=True)
def solve_spd(M: Array, b: Array) -> None:
    """Solve M x = b in place, M (6, 6) symmetric positive definite, by Cholesky."""
    for i in range(6):
        for j in range(i + 1):
            s = M[i, j]
            for k in range(j):
                s -= M[i, k] * M[j, k]
            if i == j:
                M[i, i] = math.sqrt(s)
            else:
                M[i, j] = s / M[j, j]
    for i in range(6):
        s = b[i]
        for k in range(i):
            s -= M[i, k] * b[k]
        b[i] = s / M[i, i]
    for i in range(5, -1, -1):
        s = b[i]
        for k in range(i + 1, 6):
            s -= M[k, i] * b[k]
        b[i] = s / M[i, i]


@kernel()
def descend(
    fixed: Array,
    prismatic: Flags,
    lower: Array,
    upper: Array,
    target: Array,
    q: Array,
    position_tolerance: float,
    rotation_tolerance: float,
    max_iterations: int,
    frames: Array,
    J: Array,
) -> bool:
    """Move q (dof,) within its limits until the tip is at the target; False where it is not.

    frames (dof + 1, 4, 4) and J (6, dof) are scratch; frames hold the chain at q on return.
    """
    dof = len(q)
    error = np.empty(6)
    y = np.empty(6)
    M = np.empty((6, 6))
    free = np.empty(dof, dtype=np.bool_)
    dq = np.empty(dof)
    best = np.inf
    age = 0
    for iteration in range(max_iterations + 1):
        chain_frames(fixed, prismatic, q, frames)
        tip = frames[dof]
        _pose_error(tip, target, error)
        position = error[0] ** 2 + error[1] ** 2 + error[2] ** 2
        rotation = error[3] ** 2 + error[4] ** 2 + error[5] ** 2
        if position <= position_tolerance**2 and rotation <= rotation_tolerance**2:
            return True
        squared = position + ROTATION_SCALE**2 * rotation
        if squared < 0.5 * best:
            best = squared
            age = 0
        else:
            age += 1
        if iteration == max_iterations or age > STALL:
            return False
        frames_jacobian(frames, prismatic, tip[:3, 3], J)
        for a in range(3, 6):
            error[a] *= ROTATION_SCALE
            for i in range(dof):
                J[a, i] *= ROTATION_SCALE
        for i in range(dof):
            gradient = 0.0
            for a in range(6):
                gradient += J[a, i] * error[a]
            pressed = (q[i] <= lower[i] and gradient < 0.0) or (q[i] >= upper[i] and gradient > 0.0)
            free[i] = not pressed
            dq[i] = 0.0
        damping = DAMPING * squared + MIN_DAMPING
        for _ in range(dof):  # each round either ends or takes a joint to its limit
            for a in range(6):
                for b in range(a + 1):
                    s = 0.0
                    for i in range(dof):
                        if free[i]:
                            s += J[a, i] * J[b, i]
                    M[a, b] = s
                M[a, a] += damping
                y[a] = error[a]
            solve_spd(M, y)
            hit = False
            for i in range(dof):
                if free[i]:
                    step = 0.0
                    for a in range(6):
                        step += J[a, i] * y[a]
                    dq[i] = step
            for i in range(dof):
                if free[i]:
                    rest = 0.0
                    if q[i] + dq[i] > upper[i]:
                        rest = upper[i] - q[i]
                    elif q[i] + dq[i] < lower[i]:
                        rest = lower[i] - q[i]
                    else:
                        continue
                    hit = True
                    free[i] = False
                    dq[i] = rest
                    for a in range(6):
                        error[a] -= J[a, i] * rest
            if not hit:
                break
        largest = 0.0
        for i in range(dof):
            largest = max(largest, abs(dq[i]))
        scale = min(1.0, MAX_STEP / max(largest, 1e-300))
        for i in range(dof):
            q[i] = min(max(q[i] + scale * dq[i], lower[i]), upper[i])
    return False


@kernel(lean=True)
def differs(a: Array, b: Array, prismatic: Flags, min_difference: float) -> bool:
    """Whether two configurations differ in some joint by more than full turns explain."""
    for i in range(len(a)):
        d = abs(a[i] - b[i])
        if not prismatic[i]:
            d = abs(d - 2.0 * math.pi * math.floor(d / (2.0 * math.pi) + 0.5))
        if d > min_difference:
            return True
    return False


@kernel(nogil=True)
def solve_batch(
    fixed: Array,
    prismatic: Flags,
    lower: Array,
    upper: Array,
    targets: Array,
    seeds: Array,
    position_tolerance: float,
    rotation_tolerance: float,
    max_iterations: int,
    min_difference: float,
    solutions: Array,
    counts: npt.NDArray[np.int64],
) -> None:
    dof = len(lower)
    frames = np.zeros((dof + 1, 4, 4))
    J = np.empty((6, dof))
    q = np.empty(dof)
    for n in range(len(targets)):
        count = 0
        for s in range(seeds.shape[1]):
            if count == solutions.shape[1]:
                break
            for i in range(dof):
                q[i] = min(max(seeds[n, s, i], lower[i]), upper[i])
            if not descend(
                fixed,
                prismatic,
                lower,
                upper,
                targets[n],
                q,
                position_tolerance,
                rotation_tolerance,
                max_iterations,
                frames,
                J,
            ):
                continue
            new = True
            for k in range(count):
                if not differs(solutions[n, k], q, prismatic, min_difference):
                    new = False
                    break
            if new:
                solutions[n, count] = q
                count += 1
        counts[n] = count


@kernel(nogil=True)
def track(
    fixed: Array,
    prismatic: Flags,
    lower: Array,
    upper: Array,
    targets: Array,
    q0: Array,
    position_tolerance: float,
    rotation_tolerance: float,
    max_joint_step: float,
    line_tolerance: float,
    path: Array,
) -> bool:
    dof = len(lower)
    frames = np.zeros((dof + 1, 4, 4))
    J = np.empty((6, dof))
    q = q0.copy()
    between = np.empty(dof)
    error = np.empty(6)
    other = np.empty(6)
    for n in range(len(targets)):
        if not descend(
            fixed,
            prismatic,
            lower,
            upper,
            targets[n],
            q,
            position_tolerance,
            rotation_tolerance,
            TRACK_ITERATIONS,
            frames,
            J,
        ):
            return False
        path[n] = q
        if n == 0:
            for i in range(dof):
                if abs(q[i] - q0[i]) > max_joint_step:
                    return False
            continue
        for i in range(dof):
            if abs(q[i] - path[n - 1, i]) > max_joint_step:
                return False
            between[i] = 0.5 * (q[i] + path[n - 1, i])
        chain_frames(fixed, prismatic, between, frames)
        _pose_error(frames[dof], targets[n - 1], other)
        _pose_error(frames[dof], targets[n], error)
        for a in range(6):  # opposite ways to both ends, where the tip is in their middle
            error[a] = 0.5 * (error[a] + other[a])
        if (
            error[0] ** 2 + error[1] ** 2 + error[2] ** 2 > line_tolerance**2
            or error[3] ** 2 + error[4] ** 2 + error[5] ** 2 > line_tolerance**2
        ):
            return False
    return True
