"""Polylines with rounded corners, twice continuously differentiable."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BPoly, PPoly

from placement_planner_ros.core.timing.quintic import control_points
from placement_planner_ros.core.types import Array

_DEVIATION_PER_CUT = 0.1875
"""A blend's distance from its corner, over cut length times |v - u| (at its middle: 6/32)."""

_SHARPEST = np.cos(np.radians(150.0))


def rounded_polyline(waypoints: Array, cuts: Array) -> PPoly:
    """Straight segments joined by quintic blends: a piecewise polynomial of degree 5.

    A blend leaves the incoming segment `cut` before the corner and joins the outgoing one `cut`
    after it, with unit speed and no curvature at both ends, so the curve is C2 in its parameter s
    (the arc length, on the straight parts). A blend lies in the triangle of its ends and the
    corner.

    Args:
        waypoints: (n, dof), consecutive ones distinct, n ≥ 2.
        cuts: (n,) cut lengths; the first and last are zero, the others above zero, and two
            neighbours together shorter than the segment between them.
    """
    # Lengths and directions of the segments.
    steps = np.diff(waypoints, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    pieces, spans = [], []
    for i, direction in enumerate(steps / lengths[:, None]):
        # The blend at the segment's start.
        if cuts[i] > 0.0:
            pieces.append(blend_control_points(waypoints, cuts, i))
            spans.append(2.0 * cuts[i])
        # What is left of the segment between both cuts.
        ends = waypoints[i] + cuts[i] * direction, waypoints[i + 1] - cuts[i + 1] * direction
        pieces.append(np.linspace(*ends, 6))
        spans.append(lengths[i] - cuts[i] - cuts[i + 1])
    breaks = np.concatenate([[0.0], np.cumsum(spans)])
    return PPoly.from_bernstein_basis(BPoly(np.stack(pieces, axis=1), breaks))


def blend_control_points(waypoints: Array, cuts: Array, corner: int) -> Array:
    """Bézier control points (6, dof) of the blend around a waypoint."""
    # Velocities at both ends of the blend, which has no acceleration there.
    u = waypoints[corner] - waypoints[corner - 1]
    v = waypoints[corner + 1] - waypoints[corner]
    u, v = cuts[corner] * u / np.linalg.norm(u), cuts[corner] * v / np.linalg.norm(v)
    ends = waypoints[corner] + np.array([-u, v])
    # unit speed over a span of twice the cut
    return control_points(np.array([0.0, 2.0]), ends, np.array([u, v]), np.zeros_like(ends))[0]


def largest_cuts(waypoints: Array, deviation: float) -> Array:
    """Cut lengths (n,) for which no blend is further than `deviation` from its corner.

    Zero (stop there) at both ends and where the path nearly turns back.
    """
    steps = np.diff(waypoints, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    directions = steps / lengths[:, None]
    # How far the direction changes at each corner, and what its segments leave room for.
    cuts = np.zeros(len(waypoints))
    turns = np.linalg.norm(np.diff(directions, axis=0), axis=1)
    room = 0.49 * np.minimum(lengths[:-1], lengths[1:])
    # The cut at which the blend's middle is as far from the corner as it may be.
    cuts[1:-1] = np.minimum(room, deviation / (_DEVIATION_PER_CUT * np.maximum(turns, 1e-12)))
    cuts[1:-1][(directions[:-1] * directions[1:]).sum(axis=1) < _SHARPEST] = 0.0
    return cuts
