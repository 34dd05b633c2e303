"""Statics of a body that a surface bears by friction cones, and a wall by pushing alone.

A body stays where it is put if such forces balance its weight, and also its weight with a wrench
more in any horizontal direction. Friction of the wall counts for nothing: which way it acts depends
on how the body came there, and bodies that need it were seen to slide down once released.

Each cone is replaced by a pyramid within it, the circle of directions by a polygon around it, so
that yes is certain. Whether forces are in balance is a linear program without an aim, solved as
non-negative least squares whose rest is zero.

Everything is in axes horizontally out of the wall, along its foot, and up.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy.optimize import nnls

from placement_planner_ros.core.types import Array

TILT_RAD = math.radians(3.0)
"""rad that gravity may be tilted by in any direction."""
CONE_SIDES, DIRECTIONS = 8, 8
"""Sides of the pyramids; directions of the wrench."""
BALANCED = 1e-6
"""Of the weight: forces that leave no more than this are in balance."""


def stays(
    floor: Array, wall: Array, tilt: float, center: Array, friction: float, margin: float
) -> bool:
    """Whether forces at contacts bear the weight and the wrench.

    Args:
        floor, wall: (k, 3) and (m, 3) where a level surface and a wall touch, metres.
        tilt: rad by which the wall leans back.
        center: (3,) of mass.
        friction: coefficient, of the surface.
        margin: share of the weight that acts at the centre in any horizontal direction.
    """
    turns = 2.0 * math.pi * np.arange(CONE_SIDES) / CONE_SIDES
    cone = np.column_stack(
        [friction * np.cos(turns), friction * np.sin(turns), np.ones(CONE_SIDES)]
    )
    normal = [math.cos(tilt), 0.0, math.sin(tilt)]
    forces = np.vstack([np.tile(cone, (len(floor), 1)), np.tile(normal, (len(wall), 1))])
    # Forces, and their moments about the centre by the size of the contacts.
    arms = np.vstack([np.repeat(floor, CONE_SIDES, axis=0), wall]) - center
    size = max(float(np.abs(arms).max()), 1e-6)
    wrenches = np.vstack([forces.T, np.cross(arms, forces).T / size])
    aside = _aside(margin) / math.cos(math.pi / DIRECTIONS)
    for angle in 2.0 * math.pi * np.arange(DIRECTIONS) / DIRECTIONS:
        load = np.array([aside * math.cos(angle), aside * math.sin(angle), -1.0, 0.0, 0.0, 0.0])
        if nnls(wrenches, -load)[1] > BALANCED:
            return False
    return True


def could_stay(
    center: Array, wall: Array, tilt: float, friction: float, margin: float
) -> npt.NDArray[np.bool_]:
    """(n,) where in the plane across the foot forces may bear weight and wrench: else `stays` never
    says yes.

    Args:
        center: (n, 2) of mass, out of the wall and up from the edge that is down, metres.
        wall: (n, 2) the highest place there that the wall touches.
    """
    aside = _aside(margin)
    out, up = math.cos(tilt), math.sin(tilt)
    # The wall's push by the weight, while the wrench is towards it and away from it.
    arm = wall[:, 1] * out - wall[:, 0] * up
    sign = np.array([1.0, -1.0])[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        push = (sign * aside * center[:, 1] - center[:, 0]) / arm
    # Away from it there is a push left, and friction holds the foot.
    slides = np.abs(push * out - sign * aside) > friction * (1.0 - push * up)
    return np.asarray((arm > 0.0) & (push[1] > 0.0) & ~slides.any(axis=0))


def _aside(margin: float) -> float:
    """Horizontal force by the weight that the wrench and gravity's tilt come to."""
    return margin + math.tan(TILT_RAD)
