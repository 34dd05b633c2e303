"""How far the heights of surfaces are off by noise, told by how they differ from their neighbours'.

Surfaces lie where many noisy points do, so they may be told far better than each of these; how much
better is a matter of how dense the points are, and whether the sensor errs alike over a while.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.types import Array

_APART = 3
"""Columns between heights that share no points: these are moved to the plane of 27 cells."""
_TIMES = 4.0
"""Standard deviations of heights that noise may make."""
_NEAR = 6.0
"""Times the noise of the points by which heights of one surface differ at most."""
_FEWEST = 30
"""Heights that are needed for a judgement."""


def height_noise(
    columns: tuple[int, int], start: npt.NDArray[np.int64], height: Array, noise: float
) -> float:
    """m by which noise makes heights differ; that of the points at most.

    Taken from the median of what heights differ by from the middle between those to either side, so
    that slopes count for nothing, and steps and edges for little.

    Args:
        columns: of cells along x and y.
        start: (nx * ny + 1,) first surface of each column, the highest last, and their number.
        height: (s,) of the surfaces, metres.
        noise: standard deviation of the points, metres.
    """
    if noise == 0.0:
        return 0.0
    top = np.full(len(start) - 1, np.nan)
    held = np.diff(start) > 0
    top[held] = height[start[1:][held] - 1]
    found = []
    for along in (top.reshape(columns), top.reshape(columns).T):
        middle = 0.5 * (along[: -2 * _APART] + along[2 * _APART :])
        found.append(np.abs(along[_APART:-_APART] - middle).ravel())
    bends = np.concatenate(found)
    bends = bends[bends <= _NEAR * noise]  # NaN is not
    if len(bends) < _FEWEST:
        return noise
    deviation = 1.4826 * float(np.median(bends)) / np.sqrt(1.5)  # of one of the three heights
    return min(noise, _TIMES * deviation)
