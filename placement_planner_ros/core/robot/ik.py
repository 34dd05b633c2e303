"""Inverse kinematics of one arm by damped least squares, many seeds at once.

Each iteration solves min |J dq - e|² + λ |dq|² with λ proportional to the squared error (Sugihara,
"Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", 2011), over the
joints that are not pressed against a limit. A redundant arm reaches a pose in many ways; which one
comes out depends on the seed, so spread seeds give a spread over the null space.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.robot.kinematics import (
    Chain,
    Flags,
    chain_frames,
    frames_jacobian,
    kernel_input,
)
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


@dataclass(frozen=True, slots=True)
class IKSettings:
    """When a pose counts as reached, and how much to try.

    Attributes:
        position_tolerance: m.
        rotation_tolerance: rad.
        max_iterations: per seed.
        max_solutions: seeds left over once so many distinct solutions are found are not tried.
        min_difference: rad or m; solutions closer than this in every joint are the same one.
        max_joint_step: rad or m; a larger change between waypoints of `track` is a jump.
        line_tolerance: m (and rad); how far the tip may be from the middle between two waypoints
            of `track` when the joints are.
    """

    position_tolerance: float = 1e-5
    rotation_tolerance: float = 1e-4
    max_iterations: int = 60
    max_solutions: int = 8
    min_difference: float = 0.1
    max_joint_step: float = 0.2
    line_tolerance: float = 5e-4

    def __post_init__(self) -> None:
        for name in ("max_iterations", "max_solutions"):
            if getattr(self, name) < 1:
                raise ParameterError(f"ik.{name}", getattr(self, name), "must be at least 1")
        for name in (
            "position_tolerance",
            "rotation_tolerance",
            "min_difference",
            "max_joint_step",
            "line_tolerance",
        ):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ParameterError(f"ik.{name}", getattr(self, name), "must be positive")


@numba.njit(cache=True, fastmath=False)
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


@numba.njit(cache=True, fastmath=False)
def _solve_spd(M: Array, b: Array) -> None:
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


@numba.njit(cache=True, fastmath=False)
def _descend(
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
            _solve_spd(M, y)
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


@numba.njit(cache=True, fastmath=False)
def _differs(a: Array, b: Array, prismatic: Flags, min_difference: float) -> bool:
    """Whether two configurations differ in some joint by more than full turns explain."""
    for i in range(len(a)):
        d = abs(a[i] - b[i])
        if not prismatic[i]:
            d = abs(d - 2.0 * math.pi * math.floor(d / (2.0 * math.pi) + 0.5))
        if d > min_difference:
            return True
    return False


@numba.njit(cache=True, fastmath=False, nogil=True)
def _solve_batch(
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
            if not _descend(
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
                if not _differs(solutions[n, k], q, prismatic, min_difference):
                    new = False
                    break
            if new:
                solutions[n, count] = q
                count += 1
        counts[n] = count


@numba.njit(cache=True, fastmath=False, nogil=True)
def _track(
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
        if not _descend(
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


class InverseKinematics:
    """Solves T_world_tip(q) = T for one arm.

    Every configuration returned has been checked to lie within the joint limits and the
    tolerances of the settings.

    Args:
        chain: the arm.
        settings: tolerances and effort.
    """

    def __init__(self, chain: Chain, settings: IKSettings | None = None) -> None:
        self.chain = chain
        self.settings = settings or IKSettings()
        self._reach = _Reach.of(chain)

    def random_seeds(self, rng: np.random.Generator, shape: int | tuple[int, ...]) -> Array:
        """(*shape, dof) configurations, uniform within the limits."""
        shape = (shape,) if isinstance(shape, int) else shape
        return rng.uniform(self.chain.lower, self.chain.upper, (*shape, self.chain.dof))

    def reachable(self, T_world_tip: Array) -> bool:
        """False where the pose (4, 4) is further away than the arm is long: no q reaches it."""
        return bool(self.reachable_batch(T_world_tip[None])[0])

    def reachable_batch(self, T_world_tip: Array) -> npt.NDArray[np.bool_]:
        """`reachable` of (n, 4, 4) poses."""
        reach = self._reach
        wrist = T_world_tip[:, :3, :3] @ reach.wrist + T_world_tip[:, :3, 3]
        distance = np.linalg.norm(wrist - reach.shoulder, axis=1)
        slack = (
            self.settings.position_tolerance
            + self.settings.rotation_tolerance * np.linalg.norm(reach.wrist)
        )
        return np.asarray(distance <= reach.length + slack)

    def solve(self, T_world_tip: Array, seeds: Array) -> Array:
        """Distinct solutions (k, dof) for a pose (4, 4) from seeds (s, dof), in seed order.

        k <= settings.max_solutions; k = 0 where no seed led to one. Solutions that differ by full
        turns of a joint count as one: see `full_turns`.
        """
        solutions, counts = self.solve_batch(T_world_tip[None], seeds[None])
        return np.asarray(solutions[0, : counts[0]])

    def solve_batch(self, T_world_tip: Array, seeds: Array) -> tuple[Array, npt.NDArray[np.int64]]:
        """`solve` for (n, 4, 4) poses from (n, s, dof) seeds.

        Returns:
            solutions (n, max_solutions, dof), of which the first counts[i] (n,) are filled (the
            rest is NaN).
        """
        chain, settings = self.chain, self.settings
        T = kernel_input(T_world_tip)
        Q = kernel_input(seeds)
        solutions = np.full((len(T), settings.max_solutions, chain.dof), np.nan)
        counts = np.zeros(len(T), dtype=np.int64)
        _solve_batch(
            chain.fixed,
            chain.prismatic,
            chain.lower,
            chain.upper,
            T,
            Q,
            settings.position_tolerance,
            settings.rotation_tolerance,
            settings.max_iterations,
            settings.min_difference,
            solutions,
            counts,
        )
        return solutions, counts

    def full_turns(self, q: Array) -> Array:
        """q (dof,) and all that differ from it by full turns within the limits: (k, dof).

        All put the links in the same place; only the way there differs. q itself comes first.
        """
        chain = self.chain
        options = []
        for value, low, high, slides in zip(
            q, chain.lower, chain.upper, chain.prismatic, strict=True
        ):
            turns = () if slides else (-4.0 * math.pi, -2.0 * math.pi, 2.0 * math.pi, 4.0 * math.pi)
            options.append([value] + [value + t for t in turns if low <= value + t <= high])
        return np.array(list(itertools.product(*options)))

    def track(self, T_world_tip: Sequence[Array] | Array, q0: Array) -> Array | None:
        """Follow poses (n, 4, 4), each close to the one before, from q0 (dof,) near the first.

        Returns:
            (n, dof), each within limits and tolerances; None where a pose is not reached, a joint
            jumps, or the tip leaves the straight line between two poses by more than
            settings.line_tolerance (then denser poses may succeed).
        """
        chain, settings = self.chain, self.settings
        T = kernel_input(T_world_tip)
        path = np.empty((len(T), chain.dof))
        tracked = _track(
            chain.fixed,
            chain.prismatic,
            chain.lower,
            chain.upper,
            T,
            np.clip(np.asarray(q0, dtype=np.float64), chain.lower, chain.upper),
            settings.position_tolerance,
            settings.rotation_tolerance,
            settings.max_joint_step,
            settings.line_tolerance,
            path,
        )
        return path if tracked else None


@dataclass(frozen=True, slots=True, eq=False)
class _Reach:
    """No configuration takes `wrist` further than `length` from `shoulder`.

    A point on a joint's axis stays where it is when the joint turns, so the distance from a point
    on the first axis to one on the last is at most the sum of the distances between the points
    chosen on consecutive axes. They are chosen to make that sum small. A sliding joint counts
    from the middle of its range and adds half of it.

    Attributes:
        shoulder: (3,) point on the first axis, in the world.
        wrist: (3,) point on the last axis, in the tip frame.
        length: m.
    """

    shoulder: Array
    wrist: Array
    length: float

    @classmethod
    def of(cls, chain: Chain) -> _Reach:
        middle = np.where(chain.prismatic, 0.5 * (chain.lower + chain.upper), 0.0)
        half = np.where(chain.prismatic, 0.5 * (chain.upper - chain.lower), 0.0)

        def gaps(along: Array) -> Array:
            """(dof - 1, 3) vectors between points at `along` on consecutive axes."""
            links = chain.fixed[1:-1]
            ahead = links[:, :3, 3] + links[:, :3, 2] * (along + middle)[1:, None]
            behind = np.zeros_like(ahead)
            behind[:, 2] = along[:-1]
            return ahead - behind

        def total(along: Array) -> float:
            return float(np.linalg.norm(gaps(along), axis=1).sum())

        along = np.asarray(minimize(total, np.zeros(chain.dof), method="Powell").x).reshape(-1)
        T_last_tip = chain.fixed[-1]
        on_last = np.array([0.0, 0.0, along[-1]])
        on_first = np.array([0.0, 0.0, along[0] + middle[0], 1.0])
        return cls(
            shoulder=(chain.fixed[0] @ on_first)[:3],
            wrist=T_last_tip[:3, :3].T @ (on_last - T_last_tip[:3, 3]),
            length=total(along) + float(half.sum()) + 1e-9,
        )
