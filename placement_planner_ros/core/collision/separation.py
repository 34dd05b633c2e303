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
from placement_planner_ros.core.uncounted import Uncounted

FREE = 0
COLLIDING = 1
UNDECIDED = 2
_OPEN = -1

BOUND_TOLERANCE_M = 1e-6
"""Metres by which a bound must pass its threshold to decide."""

_WOLFE_ITERATIONS = 40


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def minimum_norm_point(simplex: Array, weights: Array, count: int) -> int:
    """Reduce a simplex of `count` ≤ 4 points to the face that holds its point next to the origin.

    The minor cycle of Wolfe's algorithm. `simplex` (4, 3) and `weights` (4,) are changed in place;
    the point is weights @ simplex.

    Returns:
        The number of points left, or -1 where the simplex is degenerate.
    """
    alpha = weights[4:8]
    for _ in range(6):
        # A single point is the answer itself.
        if count == 1:
            weights[0] = 1.0
            return 1
        # The point of the simplex's affine hull next to the origin: s_0 + E beta with E the edges
        # from s_0, where Eᵀ E beta = -Eᵀ s_0; by Cramer's rule.
        ax = simplex[1, 0] - simplex[0, 0]
        ay = simplex[1, 1] - simplex[0, 1]
        az = simplex[1, 2] - simplex[0, 2]
        sx = simplex[0, 0]
        sy = simplex[0, 1]
        sz = simplex[0, 2]
        aa = ax * ax + ay * ay + az * az
        ra = -(ax * sx + ay * sy + az * sz)
        # A segment: the foot of the origin's perpendicular, unless it has no length.
        if count == 2:
            if aa <= 1e-30:
                return -1
            alpha[1] = ra / aa
            alpha[0] = 1.0 - alpha[1]
        else:
            bx = simplex[2, 0] - sx
            by = simplex[2, 1] - sy
            # A triangle or more: the second edge.
            bz = simplex[2, 2] - sz
            bb = bx * bx + by * by + bz * bz
            ab = ax * bx + ay * by + az * bz
            rb = -(bx * sx + by * sy + bz * sz)
            if count == 3:
                # A triangle: two equations in two unknowns, unless it is a line.
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
                # Four points in a plane span no space.
                if det * det <= 1e-20 * aa * bb * cc:
                    return -1
                # Shares of the edges, each a volume by the other two and s_0 over that of all
                # three.
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
        # Where it lies within the simplex it is the answer; else walk towards it up to the face
        # that is met first, ...
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
        # ... drop the corners that do not span this face, and go on with the others.
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


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _wolfe_step(
    simplex: Array,
    weights: Array,
    count: int,
    v: tuple[float, float, float],
    w: tuple[float, float, float],
    norm: float,
    bounds: tuple[float, float],
    free_at: float,
    hit_below: float,
) -> tuple[int, int, tuple[float, float, float], tuple[float, float]]:
    """One step of Wolfe's algorithm from v with its support w, both in A ⊖ B.

    Returns:
        the answer or `_OPEN`, the size of the simplex, the next v, lower and upper bound so far.
    """
    lower, upper = bounds
    # All of A ⊖ B lies beyond the plane through w across v.
    bound = (v[0] * w[0] + v[1] * w[1] + v[2] * w[2]) / norm
    if bound >= free_at:
        return FREE, count, v, bounds
    lower = max(lower, bound)
    # v is the nearest point already, or rounding keeps the simplex from shrinking.
    if upper - bound < 1e-9 or count == 4:
        return UNDECIDED, count, v, bounds
    # The distance lies between the thresholds.
    if upper < free_at < np.inf and lower >= hit_below:
        return UNDECIDED, count, v, bounds
    simplex[count, 0], simplex[count, 1], simplex[count, 2] = w
    weights[count] = 0.0 if count > 0 else 1.0
    # Add w to the simplex, and reduce that to the face next to the origin.
    count = minimum_norm_point(simplex, weights, count + 1)
    if count < 0:
        return UNDECIDED, count, v, bounds
    # The next v: that face's point next to the origin.
    x = y = z = 0.0
    for i in range(count):
        x += weights[i] * simplex[i, 0]
        y += weights[i] * simplex[i, 1]
        z += weights[i] * simplex[i, 2]
    # The new v is a point of A ⊖ B.
    upper = np.sqrt(x * x + y * y + z * z)
    if upper < hit_below:
        return COLLIDING, count, (x, y, z), (lower, upper)
    return _OPEN, count, (x, y, z), (lower, upper)


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _support_vertex(vertices: Array, first: int, last: int, x: float, y: float, z: float) -> int:
    """Which of vertices[first:last] lies furthest in direction (x, y, z)."""
    # Along the direction, the largest of the products.
    best = first
    value = -np.inf
    for i in range(first, last):
        dot = vertices[i, 0] * x + vertices[i, 1] * y + vertices[i, 2] * z
        if dot > value:
            value = dot
            best = i
    return best


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def check_separation(
    vertices: Array,
    first: int,
    last: int,
    others: Array,
    first_other: int,
    last_other: int,
    free_at: float,
    hit_below: float,
    work: Array,
) -> int:
    """Whether two convex sets keep their distance: the bounds of this module, until they decide.

    Args:
        vertices: (., 3) world; A is the hull of vertices[first:last].
        others: B is the hull of others[first_other:last_other] where they are (., 3), and the box
            of row `first_other` where they are (., 6) lower and upper corners.
        free_at, hit_below: FREE for certain from the one on, COLLIDING for certain below the other,
            UNDECIDED in between. `free_at` may be infinite, to find the direction in which A and B
            are furthest apart.
        work: (6, 4) work space; work[5, :3] is the start, from B to A, of any length, and after
            FREE a direction in which A and B are apart.
    """
    # Room for the simplex and the weights of its corners.
    simplex = work[:3].reshape(4, 3)
    weights = work[3:5].reshape(8)
    # Thresholds with the tolerance added or taken off.
    free_at += BOUND_TOLERANCE_M
    hit_below = max(hit_below - BOUND_TOLERANCE_M, 1e-9)
    box = others.shape[1] == 6
    # Where to start, and no bounds yet.
    v = (work[5, 0], work[5, 1], work[5, 2])
    bounds = (-np.inf, np.inf)
    count = 0
    answer = _OPEN
    for _ in range(_WOLFE_ITERATIONS):
        # How far v is from the origin.
        x, y, z = v
        norm = np.sqrt(x * x + y * y + z * z)
        # The origin itself lies in A ⊖ B: the sets meet.
        if norm < 1e-12:
            if count > 0:
                return COLLIDING
            # No start was given.
            v = (1.0, y, z)
            x, norm = 1.0, 1.0
        # The support of A ⊖ B against v: the corner of A furthest back, of B furthest ahead.
        a = _support_vertex(vertices, first, last, -x, -y, -z)
        b = first_other
        cx, cy, cz = 0, 1, 2
        # The corner of the box, coordinate by coordinate.
        if box:
            cx, cy, cz = 3 if x > 0 else 0, 4 if y > 0 else 1, 5 if z > 0 else 2
        else:
            b = _support_vertex(others, first_other, last_other, x, y, z)
        # The point of A ⊖ B that is furthest against v.
        w = (
            vertices[a, 0] - others[b, cx],
            vertices[a, 1] - others[b, cy],
            vertices[a, 2] - others[b, cz],
        )
        # A step of the algorithm, until it has an answer.
        answer, count, v, bounds = _wolfe_step(
            simplex, weights, count, v, w, norm, bounds, free_at, hit_below
        )
        if answer != _OPEN:
            break
    # Where it ended, for the next time.
    work[5, 0], work[5, 1], work[5, 2] = v
    return UNDECIDED if answer == _OPEN else answer
