"""Standing an object up with an arm of few joints, and moving it about upright."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.types import Array

_DRAWN_CONFIGURATIONS = 1024
"""Configurations of which the most upright are made more so."""
_TRIED_CONFIGURATIONS = 4
_STILL_M_PER_UNIT = 1e-3
"""m per rad or m; what moves the object by less does not move it."""
_UPRIGHT_RAD = 1e-6
"""rad, beyond which nothing more upright is looked for."""
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class UprightMotion:
    """How a face of the held object is brought to lie below it.

    Attributes:
        tilt: rad, the least between its normal and the vertical that was found.
        directions: of x, y and z, in which it can then be moved without leaning more.
    """

    tilt: float
    directions: int

    def hindrance(self, tolerance: float) -> str:
        """Why the object, upright to that many radians, does not get to places all around; ''
        where it does."""
        if self.tilt > tolerance:
            angle = math.degrees(self.tilt)
            return f"has the object lean by {angle:.2g} degrees at least on each of its rests"
        if self.directions < len(_UP):
            return f"moves an upright object in {self.directions} directions of three only"
        return ""


def most_upright(chain: Chain, T_tip_face: Iterable[Array], tolerance: float) -> UprightMotion:
    """The best of some faces (4, 4) of what the tip holds; the first that nothing hinders."""
    best = UprightMotion(np.pi, 0)
    for face in T_tip_face:
        found = upright_motion(chain, face)
        better = max(found.tilt, tolerance), -found.directions
        if better < (max(best.tilt, tolerance), -best.directions):
            best = found
        if not best.hindrance(tolerance):
            break
    return best


def upright_motion(chain: Chain, T_tip_face: Array) -> UprightMotion:
    """Of a face (4, 4) of what the tip holds, z along its normal into the object.

    The configurations that have z most upright among random ones are improved by least squares;
    nothing is looked at but joint limits.
    """
    # The most upright of many configurations, drawn at random.
    rng = np.random.default_rng(0)
    axis = T_tip_face[:3, 2]
    Q = chain.random(rng, (_DRAWN_CONFIGURATIONS,))
    most = np.argsort(-chain.forward_batch(Q)[:, 2, :3] @ axis)[:_TRIED_CONFIGURATIONS]

    def off(q: Array) -> Array:
        return np.asarray(chain.forward(q)[:3, :3] @ axis - _UP)

    def turning(q: Array) -> Array:
        """∂z/∂q (3, dof)."""
        return np.cross(chain.jacobian(q, T_tip_face)[3:].T, off(q) + _UP).T

    bounds = chain.lower, chain.upper
    best = UprightMotion(np.pi, 0)
    for seed in Q[most]:
        # Bring the axis upright, and see how the face can then move.
        q = least_squares(off, seed, turning, bounds, xtol=1e-12, ftol=1e-15).x
        tilt = 2.0 * float(np.arcsin(min(0.5 * float(np.linalg.norm(off(q))), 1.0)))
        directions = _upright_dimensions(chain, q, turning(q), T_tip_face)
        best = UprightMotion(min(tilt, best.tilt), max(directions, best.directions))
        if not best.hindrance(_UPRIGHT_RAD):
            break
    return best


def _upright_dimensions(chain: Chain, q: Array, turning: Array, T_tip_face: Array) -> int:
    """Dimensions of the velocities of the face's origin at q (dof,) that do not turn its normal."""
    _, sizes, V = np.linalg.svd(turning)
    still = V[np.append(sizes, np.zeros(len(V) - len(sizes))) <= _STILL_M_PER_UNIT]
    moved = chain.jacobian(q, T_tip_face)[:3] @ still.T
    return int(np.linalg.matrix_rank(moved, tol=_STILL_M_PER_UNIT))
