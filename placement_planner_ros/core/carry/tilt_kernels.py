"""Tilt of a held axis over whole edges, and the way back to where it is small.

Let v be the axis in the world, c = v · z the cosine of its tilt, and a_i the axis of joint i, where
that turns. Then

    ∂c/∂q_i = z · (a_i × v),    ∂²c/∂q_i∂q_j = (z × a_i) · (a_j × v)  for i ≤ j,

so joints with vertical axes change nothing, and nothing changes fast while v is near the vertical.
Let the joints move by at most δ_i from q. Then |z × a_i| = √(1 − (a_i · z)²) stays below

    h_i = |z × a_i| + Σ_{j<i} δ_j h_j,

as only joints further in turn a_i, by no more than that, and |a_j × v| below

    k_j = |a_j × v| + Σ_{i>j} δ_i k_i,

as only joints further out change the angle between the two. By Taylor's theorem c is then at least
c(q) + Σ_i ∂c/∂q_i (q'_i − q_i) − ½ Σ_j δ_j k_j (δ_j h_j + 2 Σ_{i<j} δ_i h_i).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit

from placement_planner_ros.core.reach.kinematics import chain_frames
from placement_planner_ros.core.types import Array, Mask
from placement_planner_ros.core.uncounted import Uncounted

_AIM_SHARE = 0.7
"""Share of the planned limit that projected configurations lean by: straight edges between two of
them bulge outwards."""
_MAX_INTERVALS = 1000
"""Of one edge, after which it is given up."""
_NEWTON_STEPS = 40
"""After which a configuration is given up."""


class TiltedChain(NamedTuple):
    """An arm's joints (n), with an axis that its tip carries, and room to work in."""

    fixed: Array
    """(n + 1, 4, 4) and `prismatic` (n,): of `kinematics.Chain`, as are the limits (n,)."""
    prismatic: Mask
    lower: Array
    upper: Array
    up: Array
    """(3,) the axis in the frame of the tip."""
    frames: Array
    """(n + 1, 4, 4); `work` (5, n)."""
    work: Array


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _tilt_and_slopes(prismatic: Mask, up: Array, frames: Array, work: Array) -> tuple[float, float]:
    """cos and sin of the tilt at frames of `chain_frames`; work[0] = ∂c/∂q, [1] = h, [2] = k."""
    # The axis in the world.
    tip = frames[-1]
    x = tip[0, 0] * up[0] + tip[0, 1] * up[1] + tip[0, 2] * up[2]
    y = tip[1, 0] * up[0] + tip[1, 1] * up[1] + tip[1, 2] * up[2]
    z = tip[2, 0] * up[0] + tip[2, 1] * up[1] + tip[2, 2] * up[2]
    # A joint that slides changes no tilt.
    for i in range(len(prismatic)):
        if prismatic[i]:
            work[0, i], work[1, i], work[2, i] = 0.0, 0.0, 0.0
            continue
        # The joint's axis, and its cross product with the held axis.
        ax, ay, az = frames[i, 0, 2], frames[i, 1, 2], frames[i, 2, 2]
        cx, cy, cz = ay * z - az * y, az * x - ax * z, ax * y - ay * x
        # The derivative of c, and the lengths that bound the second one.
        work[0, i] = cz
        work[1, i] = math.sqrt(ax * ax + ay * ay)
        work[2, i] = math.sqrt(cx * cx + cy * cy + cz * cz)
    return z, math.sqrt(x * x + y * y)


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _second_order_bound(delta: Array, prismatic: Mask, work: Array) -> float:
    """Σ_j δ_j k_j (δ_j h_j + 2 Σ_{i<j} δ_i h_i), with what `_tilt_and_slopes` filled in."""
    # k_j from the outermost joint inward.
    dof = len(prismatic)
    turned = 0.0
    for j in range(dof - 1, -1, -1):
        if not prismatic[j]:
            work[2, j] = min(work[2, j] + turned, 1.0)
            turned += delta[j] * work[2, j]
    # h_j from the innermost outward, and with it the sum.
    bend = 0.0
    leant = 0.0
    for j in range(dof):
        if not prismatic[j]:
            h = min(work[1, j] + leant, 1.0)
            bend += delta[j] * work[2, j] * (delta[j] * h + 2.0 * leant)
            leant += delta[j] * h
    return bend


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def edge_keeps_tilt(chain: TiltedChain, a: Array, b: Array, deviation: Array, least: float) -> bool:
    """Whether c ≥ least on the straight motion from a to b (n,), strayed from by `deviation` (n,).

    From a on, interval after interval, each certified by this module's bound around its middle;
    one that is not is halved.
    """
    fixed, prismatic, up = chain.fixed, chain.prismatic, chain.up
    frames, work = chain.frames, chain.work
    # The configuration and the ranges of the joints, in the work space; the first interval is all.
    dof = len(a)
    q, delta = work[3], work[4]
    begin, length = 0.0, 1.0
    for _ in range(_MAX_INTERVALS):
        # The interval's middle, and how far each joint moves within it and beside it.
        half = 0.5 * length
        middle = begin + half
        for i in range(dof):
            q[i] = a[i] + middle * (b[i] - a[i])
            delta[i] = half * abs(b[i] - a[i]) + deviation[i]
        # The tilt at the middle, which must keep the bound itself.
        chain_frames(fixed, prismatic, q, frames)
        c, _sin = _tilt_and_slopes(prismatic, up, frames, work)
        if not c >= least:
            return False
        # By how much c falls to first order along the edge, and beside it.
        along = 0.0
        aside = 0.0
        for i in range(dof):
            along += work[0, i] * (b[i] - a[i])
            aside += abs(work[0, i]) * deviation[i]
        # Certified, with the second order's bound: on to the next, twice as long.
        if (
            c - half * abs(along) - aside - 0.5 * _second_order_bound(delta, prismatic, work)
            >= least
        ):
            begin += length
            if begin >= 1.0:
                return True
            length = min(2.0 * length, 1.0 - begin)
        else:
            length = half
    return False


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def project_tilt(chain: TiltedChain, q: Array, most: float) -> bool:
    """Bring q (n,) to a tilt of at most `most` by Newton steps of least norm.

    Joints at a limit that a step would lead out of take no part in it.

    Returns:
        False where it does not come there; q is then anything.
    """
    frames, work, lower, upper = chain.frames, chain.work, chain.lower, chain.upper
    dof = len(q)
    # The tilt at q: there already, or straight up or down, where it has no slope.
    for _ in range(_NEWTON_STEPS):
        chain_frames(chain.fixed, chain.prismatic, q, frames)
        c, s = _tilt_and_slopes(chain.prismatic, chain.up, frames, work)
        tilt = math.atan2(s, c)
        if tilt <= most:
            return True
        if not s > 0.0:
            return False
        # The gradient of c, but for joints at a limit that it leads out of.
        squared = 0.0
        for i in range(dof):
            rise = work[0, i]
            if (rise > 0.0 and q[i] >= upper[i]) or (rise < 0.0 and q[i] <= lower[i]):
                work[0, i] = 0.0
            squared += work[0, i] * work[0, i]
        # How fast the tilt falls along the gradient, as -∂tilt/∂q_i = ∂c/∂q_i / sin.
        if not squared > 0.0:
            return False
        slope = math.sqrt(squared) / s
        # A step towards the aim along it, within limits; no longer than a joint that turns the
        # axis straight up would take.
        step = min((tilt - _AIM_SHARE * most) / slope, tilt)
        for i in range(dof):
            q[i] += step * work[0, i] / (s * slope)
            q[i] = min(max(q[i], lower[i]), upper[i])
    return False
