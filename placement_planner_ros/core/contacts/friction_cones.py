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

import functools
import math

import numpy as np
from scipy.optimize import nnls

from placement_planner_ros.core.types import SINGLE_ROUNDING, Array, Mask

TILT_RAD = math.radians(3.0)
"""rad that gravity may be tilted by in any direction."""
CONE_SIDES, DIRECTIONS = 8, 8
"""Sides of the pyramids; directions of the wrench."""


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
    # Forces (k, 3) by column, of unit push, and where they act.
    x, y, z = np.hstack([np.tile(_cone_sides(friction), len(floor)), np.zeros((3, len(wall)))])
    pushes = slice(len(floor) * CONE_SIDES, None)
    x[pushes], z[pushes] = math.cos(tilt), math.sin(tilt)
    a, b, c = (np.vstack([np.repeat(floor, CONE_SIDES, axis=0), wall]) - center).T
    # With their moments about the centre, by the size of the contacts.
    moments = np.stack([b * z - c * y, c * x - a * z, a * y - b * x])
    size = max(float(np.abs([a, b, c]).max()), 1e-6)
    wrenches = np.vstack([x, y, z, moments / size])
    # in balance, but for rounding by the weight
    return all(nnls(wrenches, -load)[1] <= SINGLE_ROUNDING for load in _disturbed_loads(margin))


def could_stay(center: Array, wall: Array, tilt: float, friction: float, margin: float) -> Mask:
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


@functools.cache
def _cone_sides(friction: float) -> Array:
    """(3, `CONE_SIDES`) sides of the pyramid that stands for a friction cone."""
    turns = 2.0 * math.pi * np.arange(CONE_SIDES) / CONE_SIDES
    return np.stack([friction * np.cos(turns), friction * np.sin(turns), np.ones(CONE_SIDES)])


@functools.cache
def _disturbed_loads(margin: float) -> Array:
    """(`DIRECTIONS`, 6) weight with the wrench; those out of the wall and into it first."""
    aside = _aside(margin)
    turns = 2.0 * math.pi * np.arange(DIRECTIONS) / DIRECTIONS
    loads = np.zeros((DIRECTIONS, 6))
    loads[:, 0], loads[:, 1], loads[:, 2] = aside * np.cos(turns), aside * np.sin(turns), -1.0
    return loads[np.argsort(-np.abs(loads[:, 0]), kind="stable")]


def _aside(margin: float) -> float:
    """Horizontal force by the weight that the wrench and gravity's tilt come to, at a corner of the
    polygon around all directions."""
    return (margin + math.tan(TILT_RAD)) / math.cos(math.pi / DIRECTIONS)
