"""Motion of a point of a held object on a timed curve of the arm's joints.

Of joints i ≤ j ≤ k that all turn, the derivatives of the point p are z_k × (p − o_k), that turned
by z_j ×, and that by z_i ×, none longer than ρ_k, the furthest that p is ever from the axis of k;
where k slides, none is longer than 1. So with W_k = Σ_{i≤k} |q_i'| and A_k = Σ_{i≤k} |q_i''|

    |p'''| ≤ Σ_k ρ_k (|q_k'''| + 3 (W_k A_k − W_{k-1} A_{k-1}) + W_k³ − W_{k-1}³).
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from numba import njit
from toppra.constraint import DiscretizationType, LinearConstraint
from toppra.constraint.linear_constraint import canlinear_colloc_to_interpolate
from toppra.interpolator import AbstractGeometricPath

from placement_planner_ros.core.reach.kinematics import Chain, chain_frames
from placement_planner_ros.core.reach.reach_bound import lever_arms
from placement_planner_ros.core.timing.quintic import halved_pieces
from placement_planner_ros.core.types import ROUNDING, Array, Mask, kernel_input

_BOUND_SLACK = 0.01
"""By which, as a share, the bound may be above what is reached."""
_DIRECTIONS = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
_FACETS = _DIRECTIONS / np.linalg.norm(_DIRECTIONS, axis=1)[:, None]
"""(26, 3) normals of the polytope that stands in for a ball."""


@njit(cache=True, nogil=True)
def _point_derivatives(
    fixed: Array, prismatic: Mask, point: Array, Q: Array, V: Array, A: Array, out: Array
) -> None:
    """out (n, 2, 3): p' and p'' of a point (3,) of the tip, for q, q' and q'' (n, dof).

    Joint after joint outwards: with ω, α the turning of a link and a the acceleration of its
    origin, a point r away has v + ω × r and a + α × r + ω × (ω × r).
    """
    # The frames at each sample.
    dof = len(prismatic)
    frames = np.zeros((dof + 1, 4, 4))
    for n in range(len(Q)):
        chain_frames(fixed, prismatic, Q[n], frames)
        tip = frames[-1]
        # Turning of the link, velocity and acceleration of its origin, and where that is.
        wx = wy = wz = bx = by = bz = 0.0
        vx = vy = vz = ax = ay = az = 0.0
        ox = oy = oz = 0.0
        for i in range(dof + 1):
            # The next joint's origin, and after the last one the point.
            if i < dof:
                x, y, z = frames[i, 0, 3], frames[i, 1, 3], frames[i, 2, 3]
            else:
                x, y, z = (
                    tip[0, 3] + tip[0, 0] * point[0] + tip[0, 1] * point[1] + tip[0, 2] * point[2],
                    tip[1, 3] + tip[1, 0] * point[0] + tip[1, 1] * point[1] + tip[1, 2] * point[2],
                    tip[2, 3] + tip[2, 0] * point[0] + tip[2, 1] * point[1] + tip[2, 2] * point[2],
                )
            # From the last origin to it.
            rx, ry, rz = x - ox, y - oy, z - oz
            ox, oy, oz = x, y, z
            # ω × r, carried on by the link that the joint stands on.
            sx, sy, sz = wy * rz - wz * ry, wz * rx - wx * rz, wx * ry - wy * rx
            vx, vy, vz = vx + sx, vy + sy, vz + sz
            # α × r + ω × (ω × r).
            ax += by * rz - bz * ry + wy * sz - wz * sy
            ay += bz * rx - bx * rz + wz * sx - wx * sz
            az += bx * ry - by * rx + wx * sy - wy * sx
            if i == dof:
                break
            # The joint's axis, its velocity and acceleration, and ω × z.
            zx, zy, zz = frames[i, 0, 2], frames[i, 1, 2], frames[i, 2, 2]
            v, a = V[n, i], A[n, i]
            tx, ty, tz = wy * zz - wz * zy, wz * zx - wx * zz, wx * zy - wy * zx
            if prismatic[i]:
                # A joint that slides adds to the origin's velocity and acceleration, with the
                # Coriolis term.
                vx, vy, vz = vx + v * zx, vy + v * zy, vz + v * zz
                ax += a * zx + 2.0 * v * tx
                ay += a * zy + 2.0 * v * ty
                az += a * zz + 2.0 * v * tz
            else:
                # A joint that turns adds to the link's turning.
                bx += a * zx + v * tx
                by += a * zy + v * ty
                bz += a * zz + v * tz
                wx, wy, wz = wx + v * zx, wy + v * zy, wz + v * zz
        out[n, 0, 0], out[n, 0, 1], out[n, 0, 2] = vx, vy, vz
        out[n, 1, 0], out[n, 1, 1], out[n, 1, 2] = ax, ay, az


class CarriedPoint:
    """A point of the held object, and the acceleration that it must not exceed.

    Args:
        chain: the arm.
        point: (3,) in the frame of the tip.
        limit: m/s², above zero.

    Attributes:
        limit: as given.
    """

    def __init__(self, chain: Chain, point: Array, limit: float) -> None:
        self.limit = limit
        self._chain = chain
        self._point = kernel_input(point)
        self._levers = lever_arms(chain, self._point[None])

    def derivatives(self, Q: Array, V: Array, A: Array) -> tuple[Array, Array]:
        """p' and p'' (n, 3) where the joints' q, q' and q'' are (n, dof)."""
        out = np.empty((len(Q), 2, 3))
        chain = self._chain
        _point_derivatives(
            chain.fixed,
            chain.prismatic,
            self._point,
            kernel_input(Q),
            kernel_input(V),
            kernel_input(A),
            out,
        )
        return out[:, 0], out[:, 1]

    def largest_acceleration(self, points: Array, durations: Array) -> float:
        """A bound on |p''| over a whole curve, 1 % above what is reached at most.

        Branch and bound: what a piece reaches in its middle, and at most elsewhere by how much
        p'' may change from there; pieces that may exceed the most seen are halved.

        Args:
            points: (m, 6, dof) Bézier control points of the curve's pieces.
            durations: (m,) seconds.
        """
        most = 0.0
        h = np.asarray(durations, dtype=np.float64)
        # Derivatives of each piece by its control points.
        while len(points):
            first = 5.0 * np.diff(points, axis=1) / h[:, None, None]
            second = 4.0 * np.diff(first, axis=1) / h[:, None, None]
            third = 3.0 * np.diff(second, axis=1) / h[:, None, None]
            # What is reached in the middle of each piece.
            middle = [halved_pieces(values)[::2, -1] for values in (points, first, second)]
            reached = np.linalg.norm(self.derivatives(*middle)[1], axis=1)
            most = max(most, float(reached.max()))
            # Bounds of speed, acceleration and jerk of each joint; W and A of all up to each joint.
            speed, strength, jerk = (np.abs(v).max(axis=1) for v in (first, second, third))
            W, A = np.cumsum(speed, axis=1), np.cumsum(strength, axis=1)
            turning = np.diff(3.0 * W * A + W**3, axis=1, prepend=0.0)
            # How fast p'' may change over a piece, by each joint's lever.
            change = (jerk + turning) @ self._levers
            # Go on with pieces that may exceed the most seen.
            open_ones = reached + 0.5 * h * change > (1.0 + _BOUND_SLACK) * most + ROUNDING
            points, h = halved_pieces(points[open_ones]), np.repeat(0.5 * h[open_ones], 2)
        return (1.0 + _BOUND_SLACK) * most + ROUNDING


class PointAccelerationConstraint(LinearConstraint):
    """A limit on |p''| as toppra reads limits: p'(s) u + p''(s) x lies in a polytope.

    Its facets touch the ball of the limit in 26 directions, so the ball is exceeded by 13 % at
    most, which a slower pace of the whole makes good.
    """

    def __init__(self, carried: CarriedPoint) -> None:
        super().__init__()
        self._carried = carried
        self.identical = True
        self.set_discretization_type(DiscretizationType.Interpolation)

    def compute_constraint_params(
        self, path: AbstractGeometricPath, gridpoints: Array, *args: Any, **kwargs: Any
    ) -> Any:
        """The coefficients a, b, c, F, g of a u + b x + c = v, F v ≤ g at the grid points."""
        # p' and p'' along the path, against each facet.
        first, second = self._carried.derivatives(
            path(gridpoints), path(gridpoints, order=1), path(gridpoints, order=2)
        )
        none = np.zeros_like(first)
        within = np.full(len(_FACETS), self._carried.limit)
        return canlinear_colloc_to_interpolate(
            first, second, none, _FACETS, within, None, None, gridpoints, identical=True
        )
