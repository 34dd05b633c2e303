"""Distance between convex sets, bounded from both sides with proof.

The minimum-norm point of A ⊖ B is found by Wolfe's algorithm (P. Wolfe, Finding the nearest point
in a polytope, 1976), which on the support function is Gilbert-Johnson-Keerthi with a general
sub-algorithm. Every iterate v lies in A ⊖ B, so |v| bounds the distance from above; every support
w in direction v bounds it from below by v·w/|v|. Answers rest on these two bounds alone, so a
numerical failure inside can cost an answer (`UNDECIDED`) but never make it wrong.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement_planner_ros.core.types import Array

FREE = 0
COLLIDING = 1
UNDECIDED = 2

TOLERANCE = 1e-6
"""Metres by which a bound must pass its threshold to decide."""

_ITERATIONS = 40


@njit(cache=True)
def minimum_norm_point(simplex: Array, weights: Array, count: int) -> int:
    """Reduce a simplex of `count` ≤ 4 points to the face that holds its point next to the origin.

    `simplex` (4, 3) and `weights` (4,) are changed in place; the point is weights @ simplex.

    Returns:
        The number of points left, or -1 where the simplex is degenerate.
    """
    alpha = weights[4:8]
    for _ in range(6):
        if count == 1:
            weights[0] = 1.0
            return 1
        # Affine minimiser: G beta = -E^T s_0 with E the edges from s_0.
        ax = simplex[1, 0] - simplex[0, 0]
        ay = simplex[1, 1] - simplex[0, 1]
        az = simplex[1, 2] - simplex[0, 2]
        sx = simplex[0, 0]
        sy = simplex[0, 1]
        sz = simplex[0, 2]
        aa = ax * ax + ay * ay + az * az
        ra = -(ax * sx + ay * sy + az * sz)
        if count == 2:
            if aa <= 1e-30:
                return -1
            alpha[1] = ra / aa
            alpha[0] = 1.0 - alpha[1]
        else:
            bx = simplex[2, 0] - sx
            by = simplex[2, 1] - sy
            bz = simplex[2, 2] - sz
            bb = bx * bx + by * by + bz * bz
            ab = ax * bx + ay * by + az * bz
            rb = -(bx * sx + by * sy + bz * sz)
            if count == 3:
                det = aa * bb - ab * ab
                if det <= 1e-14 * aa * bb:
                    return -1
                alpha[1] = (ra * bb - rb * ab) / det
                alpha[2] = (rb * aa - ra * ab) / det
                alpha[0] = 1.0 - alpha[1] - alpha[2]
            else:
                cx = simplex[3, 0] - sx
                cy = simplex[3, 1] - sy
                cz = simplex[3, 2] - sz
                # Four points: the affine hull is all of space and holds the origin itself.
                nx = by * cz - bz * cy
                ny = bz * cx - bx * cz
                nz = bx * cy - by * cx
                det = ax * nx + ay * ny + az * nz
                cc = cx * cx + cy * cy + cz * cz
                if det * det <= 1e-20 * aa * bb * cc:
                    return -1
                alpha[1] = -(sx * nx + sy * ny + sz * nz) / det
                alpha[2] = (
                    -(
                        sx * (cy * az - cz * ay)
                        + sy * (cz * ax - cx * az)
                        + sz * (cx * ay - cy * ax)
                    )
                    / det
                )
                alpha[3] = (
                    -(
                        sx * (ay * bz - az * by)
                        + sy * (az * bx - ax * bz)
                        + sz * (ax * by - ay * bx)
                    )
                    / det
                )
                alpha[0] = 1.0 - alpha[1] - alpha[2] - alpha[3]
        inside = True
        theta = 1.0
        for i in range(count):
            if alpha[i] <= 0.0:
                inside = False
                step = weights[i] - alpha[i]
                theta = min(theta, weights[i] / step) if step > 0.0 else 0.0
        if inside:
            for i in range(count):
                weights[i] = alpha[i]
            return count
        kept = 0
        total = 0.0
        dropped = False
        for i in range(count):
            value = (1.0 - theta) * weights[i] + theta * alpha[i]
            if value <= 1e-14 and alpha[i] <= 0.0:
                dropped = True
                continue
            weights[kept] = max(value, 0.0)
            total += weights[kept]
            for j in range(3):
                simplex[kept, j] = simplex[i, j]
            kept += 1
        if not dropped or kept == 0 or total <= 0.0:
            return -1
        for i in range(kept):
            weights[i] /= total
        count = kept
    return -1


@njit(cache=True)
def separate_box(
    vertices: Array,
    first: int,
    last: int,
    corners: Array,
    box: int,
    free_at: float,
    hit_below: float,
    work: Array,
) -> int:
    """Whether the hull of vertices[first:last] and an axis-aligned box keep their distance.

    Args:
        vertices: (n, 3) world.
        corners: (m, 6) lower and upper corners; the box is row `box`.
        free_at, hit_below: FREE for certain from the one on, COLLIDING for certain below the other,
            UNDECIDED in between.
        work: (6, 4) work space; work[5, :3] is the start, from box to hull, of any length.
    """
    simplex = work[:3].reshape(4, 3)
    weights = work[3:5].reshape(8)
    free_at += TOLERANCE
    hit_below = max(hit_below - TOLERANCE, 1e-9)
    vx, vy, vz = work[5, 0], work[5, 1], work[5, 2]
    count = 0
    upper_bound = np.inf
    lower_bound = -np.inf
    for _ in range(_ITERATIONS):
        norm = np.sqrt(vx * vx + vy * vy + vz * vz)
        if norm < 1e-12:
            if count == 0:
                vx = 1.0
                norm = 1.0
            else:
                return COLLIDING
        best = first
        value = np.inf
        for i in range(first, last):
            dot = vertices[i, 0] * vx + vertices[i, 1] * vy + vertices[i, 2] * vz
            if dot < value:
                value = dot
                best = i
        wx = vertices[best, 0] - corners[box, 3 if vx > 0 else 0]
        wy = vertices[best, 1] - corners[box, 4 if vy > 0 else 1]
        wz = vertices[best, 2] - corners[box, 5 if vz > 0 else 2]
        bound = (vx * wx + vy * wy + vz * wz) / norm
        if bound >= free_at:
            return FREE
        lower_bound = max(lower_bound, bound)
        if upper_bound - bound < 1e-9 or count == 4:
            break
        if upper_bound < free_at and lower_bound >= hit_below:
            break
        simplex[count, 0], simplex[count, 1], simplex[count, 2] = wx, wy, wz
        weights[count] = 0.0 if count > 0 else 1.0
        count = minimum_norm_point(simplex, weights, count + 1)
        if count < 0:
            break
        vx = vy = vz = 0.0
        for i in range(count):
            vx += weights[i] * simplex[i, 0]
            vy += weights[i] * simplex[i, 1]
            vz += weights[i] * simplex[i, 2]
        upper_bound = np.sqrt(vx * vx + vy * vy + vz * vz)
        if upper_bound < hit_below:
            return COLLIDING
    return UNDECIDED


@njit(cache=True)
def separate_hulls(
    vertices: Array,
    first_a: int,
    last_a: int,
    first_b: int,
    last_b: int,
    free_at: float,
    hit_below: float,
    work: Array,
) -> int:
    """`separate_box` for the hulls a and b of two ranges of `vertices`.

    Args:
        work: (6, 4) work space; work[5, :3] is the start, from b to a, of any length, and after
            FREE a direction in which a and b are apart.
    """
    simplex = work[:3].reshape(4, 3)
    weights = work[3:5].reshape(8)
    free_at += TOLERANCE
    hit_below = max(hit_below - TOLERANCE, 1e-9)
    vx, vy, vz = work[5, 0], work[5, 1], work[5, 2]
    count = 0
    upper_bound = np.inf
    lower_bound = -np.inf
    for _ in range(_ITERATIONS):
        norm = np.sqrt(vx * vx + vy * vy + vz * vz)
        if norm < 1e-12:
            if count == 0:
                vx = 1.0
                norm = 1.0
            else:
                return COLLIDING
        a = first_a
        value = np.inf
        for i in range(first_a, last_a):
            dot = vertices[i, 0] * vx + vertices[i, 1] * vy + vertices[i, 2] * vz
            if dot < value:
                value = dot
                a = i
        b = first_b
        value = -np.inf
        for i in range(first_b, last_b):
            dot = vertices[i, 0] * vx + vertices[i, 1] * vy + vertices[i, 2] * vz
            if dot > value:
                value = dot
                b = i
        wx = vertices[a, 0] - vertices[b, 0]
        wy = vertices[a, 1] - vertices[b, 1]
        wz = vertices[a, 2] - vertices[b, 2]
        bound = (vx * wx + vy * wy + vz * wz) / norm
        if bound >= free_at:
            work[5, 0], work[5, 1], work[5, 2] = vx, vy, vz
            return FREE
        lower_bound = max(lower_bound, bound)
        if upper_bound - bound < 1e-9 or count == 4:
            break
        if upper_bound < free_at and lower_bound >= hit_below:
            break
        simplex[count, 0], simplex[count, 1], simplex[count, 2] = wx, wy, wz
        weights[count] = 0.0 if count > 0 else 1.0
        count = minimum_norm_point(simplex, weights, count + 1)
        if count < 0:
            break
        vx = vy = vz = 0.0
        for i in range(count):
            vx += weights[i] * simplex[i, 0]
            vy += weights[i] * simplex[i, 1]
            vz += weights[i] * simplex[i, 2]
        upper_bound = np.sqrt(vx * vx + vy * vy + vz * vz)
        if upper_bound < hit_below:
            return COLLIDING
    work[5, 0], work[5, 1], work[5, 2] = vx, vy, vz
    return UNDECIDED
