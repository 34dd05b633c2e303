"""Whether two convex sets keep a distance, with proof.

The minimum-norm point of A ⊖ B is found by Wolfe's algorithm (P. Wolfe, Finding the nearest point
in a polytope, 1976), which on the support function is Gilbert-Johnson-Keerthi with a general
sub-algorithm. Every iterate v lies in A ⊖ B, so |v| bounds the distance from above; every support
w in direction v bounds it from below by v·w/|v|. That sets are apart rests on the lower bound
alone, so a numerical failure inside can cost an answer but never make it wrong.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted

BOUND_TOLERANCE_M = 1e-6
"""Metres by which a bound must pass its threshold to decide."""

PointRange = tuple[Array, int, int]
"""Points of which those from the second to before the third stand for their hull; where they are
(., 6) lower and upper corners, the first of these boxes."""


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def minimum_norm_point(simplex: Array, weights: Array, edges: Array, count: int) -> int:
    """Reduce a simplex of `count` ≤ 4 points to the face that holds its point next to the origin.

    The minor cycle of Wolfe's algorithm. `simplex` (4, 3) and `weights` (8,) are changed in place;
    the point is weights[:4] @ simplex.

    Args:
        edges: (3, 4) work space.

    Returns:
        The number of points left, or -1 where the simplex is degenerate.
    """
    alpha = weights[4:8]
    while True:
        # The edges from the first corner, each less what lies along those before it, by
        # Gram-Schmidt; the square of its length behind.
        for i in range(count - 1):
            x = simplex[i + 1, 0] - simplex[0, 0]
            y = simplex[i + 1, 1] - simplex[0, 1]
            z = simplex[i + 1, 2] - simplex[0, 2]
            whole = x * x + y * y + z * z
            for j in range(i):
                along = (x * edges[j, 0] + y * edges[j, 1] + z * edges[j, 2]) / edges[j, 3]
                x -= along * edges[j, 0]
                y -= along * edges[j, 1]
                z -= along * edges[j, 2]
            left = x * x + y * y + z * z
            if left <= 1e-14 * whole + 1e-30:
                return -1
            edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3] = x, y, z, left
        # From the first corner to the point next to the origin of their affine hull, the last edge
        # first: along it as far as no other edge leads there, as alpha @ simplex.
        x, y, z = simplex[0, 0], simplex[0, 1], simplex[0, 2]
        alpha[0] = 1.0
        for i in range(count - 2, -1, -1):
            along = -(x * edges[i, 0] + y * edges[i, 1] + z * edges[i, 2]) / edges[i, 3]
            x += along * (simplex[i + 1, 0] - simplex[0, 0])
            y += along * (simplex[i + 1, 1] - simplex[0, 1])
            z += along * (simplex[i + 1, 2] - simplex[0, 2])
            alpha[i + 1] = along
            alpha[0] -= along
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
def sets_keep(first: PointRange, second: PointRange, distance: float, work: Array) -> bool:
    """Whether two convex sets are certainly `distance` apart.

    Args:
        first: A is the hull of points (., 3) in the world; `second`: B that of others, or a box.
        work: (9, 4) work space; work[5, :3] is the start, from B to A, of any length, and where
            the sets are apart the direction in which they are.
    """
    # Room for the simplex and the weights of its corners.
    simplex, weights, edges = work[:3].reshape(4, 3), work[3:5].reshape(8), work[6:9]
    vertices, others = first[0], second[0]
    distance += BOUND_TOLERANCE_M
    x, y, z = work[5, 0], work[5, 1], work[5, 2]
    upper = np.inf
    count = 0
    while True:
        # How far v is from the origin.
        norm = np.sqrt(x * x + y * y + z * z)
        if norm < 1e-12:
            # The origin itself lies in A ⊖ B: the sets meet.
            if count > 0:
                return False
            # No start was given.
            x, norm = 1.0, 1.0
        # The support of A ⊖ B against v: the corner of A furthest back, of B furthest ahead.
        a = _support_vertex(vertices, first[1], first[2], -x, -y, -z)
        b, cx, cy, cz = second[1], 0, 1, 2
        if others.shape[1] == 6:
            # The corner of the box, coordinate by coordinate.
            cx, cy, cz = 3 if x > 0 else 0, 4 if y > 0 else 1, 5 if z > 0 else 2
        else:
            b = _support_vertex(others, second[1], second[2], x, y, z)
        wx = vertices[a, 0] - others[b, cx]
        wy = vertices[a, 1] - others[b, cy]
        wz = vertices[a, 2] - others[b, cz]
        # All of A ⊖ B lies beyond the plane through w across v.
        bound = (x * wx + y * wy + z * wz) / norm
        if bound >= distance:
            work[5, 0], work[5, 1], work[5, 2] = x, y, z
            return True
        # v is the nearest point already, or rounding keeps the simplex from shrinking.
        if upper - bound < 1e-9 or count == 4:
            return False
        # Add w to the simplex, and reduce that to the face next to the origin.
        simplex[count, 0], simplex[count, 1], simplex[count, 2] = wx, wy, wz
        weights[count] = 0.0 if count > 0 else 1.0
        count = minimum_norm_point(simplex, weights, edges, count + 1)
        if count < 0:
            return False
        # The next v: that face's point next to the origin, which lies in A ⊖ B.
        x = y = z = 0.0
        for i in range(count):
            x += weights[i] * simplex[i, 0]
            y += weights[i] * simplex[i, 1]
            z += weights[i] * simplex[i, 2]
        nearer = np.sqrt(x * x + y * y + z * z)
        # It is too near, or rounding keeps it from coming nearer.
        if nearer < distance or nearer >= upper:
            return False
        upper = nearer
