"""The one plane, if there is one, that carries an object's corners."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from placement_planner_ros.core.types import Array, Index

MAX_LEAN_SLOPE = 0.025
"""Of the surface under an object against its contact plane, at most; 1.4 degrees."""
_END_NOISES = 0.4
"""Times the noise of heights that these may differ by at two ends of an object."""
_ROCK_OVER_SPREAD = 2.0 * math.sqrt(2.0)
"""Times the spread of heights about their plane, over the width, by which an object rocks: of four
corners of a square one that is lower by d leaves d/2 of spread, and is d over the half diagonal."""
_SPREAD_NOISES = 0.6
"""Times the noise that heights may spread about their plane by."""


@njit(cache=True, nogil=True)
def coplanar_support(points: Array, gaps: Array, first: Index, noise: float) -> tuple[Array, Array]:
    """What carries the corners of each object, where it is one plane, and how it lies.

    The plane fitted to the surface under the corners leans against theirs by `MAX_LEAN_SLOPE` at
    most, or by what noise makes of so short a distance: on steps, and on surfaces that slope
    differently, the object would come to stand otherwise than it was placed. What is left of the
    heights does not let it rock by more than that either: on posts of which one is lower, and on
    twisted surfaces, a fitted plane need not lean.

    Args:
        points: (k, 3) corners of all objects.
        gaps: (k,) m, how far the surface is above each; NaN where there is none.
        first: (n + 1,) first corner of each object, and k.
        noise: m by which noise makes heights differ (`SupportMap.height_noise`).

    Returns:
        (n,) m across the corners where these are narrowest; 0 where no one plane carries them
        all. (n,) m, how far the plane is above them on average.
    """
    count = len(first) - 1
    widths, above = np.zeros(count), np.zeros(count)
    for n in range(count):
        # The mean of the object's corners, and of the gaps under them.
        begin, end = first[n], first[n + 1]
        corners = end - begin
        x = y = gap = 0.0
        for k in range(begin, end):
            x += points[k, 0] / corners
            y += points[k, 1] / corners
            gap += gaps[k] / corners
        # Some corner has no surface under it.
        if math.isnan(gap):
            continue
        # Second moments of the corners, and of corners with gaps.
        xx = xy = yy = falls_x = falls_y = 0.0
        for k in range(begin, end):
            a, b, off = points[k, 0] - x, points[k, 1] - y, gaps[k] - gap
            xx += a * a
            xy += a * b
            yy += b * b
            falls_x += a * off
            falls_y += b * off
        # The smaller principal moment, which gives the width across.
        least = 0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy)
        determinant = xx * yy - xy * xy
        if not (least > 0.0 and determinant > 0.0):
            continue  # corners in line
        width = 2.0 * math.sqrt(least / corners)
        # The plane fitted to the gaps by least squares, and whether it leans too much.
        slope_x = (yy * falls_x - xy * falls_y) / determinant
        slope_y = (xx * falls_y - xy * falls_x) / determinant
        if math.hypot(slope_x, slope_y) > MAX_LEAN_SLOPE + _END_NOISES * noise / width:
            continue
        # What the gaps keep about that plane, which must not let the object rock.
        low, high = math.inf, -math.inf
        for k in range(begin, end):
            left = gaps[k] - gap - slope_x * (points[k, 0] - x) - slope_y * (points[k, 1] - y)
            low, high = min(low, left), max(high, left)
        if high - low <= MAX_LEAN_SLOPE * width / _ROCK_OVER_SPREAD + _SPREAD_NOISES * noise:
            widths[n], above[n] = width, gap
    return widths, above
