"""The placement regions as they are published, and their surface in small pieces."""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.types import Array

PIECE = 0.02
"""m, the longest side of a piece."""
MOST_PIECES = 6_000
"""More than these, and pieces are made larger."""


def rectangles(corners: Array) -> Array:
    """(k, 4, 3) corners in order of the rectangles that (6 k, 3) triangle corners make up.

    What is left over at the end is left out.
    """
    whole = corners[: len(corners) // 6 * 6].reshape(-1, 6, 3)
    return np.asarray(whole[:, [0, 1, 2, 5]])


def pieces(of: Array) -> Array:
    """(n, 4, 3): rectangles (k, 4, 3), each cut evenly into pieces of at most `PIECE`."""
    if len(of) == 0:
        return np.zeros((0, 4, 3))
    sides = np.stack(
        [np.linalg.norm(of[:, 1] - of[:, 0], axis=1), np.linalg.norm(of[:, 3] - of[:, 0], axis=1)],
        axis=1,
    )
    longest = PIECE
    while np.maximum(1, np.ceil(sides / longest)).prod(axis=1).sum() > MOST_PIECES:
        longest *= 1.5
        if longest > 10.0:
            break
    counts = np.maximum(1, np.ceil(sides / longest)).astype(int)
    each = counts.prod(axis=1)
    which = np.repeat(np.arange(len(of)), each)
    number = np.arange(len(which)) - np.repeat(np.cumsum(each) - each, each)
    place = np.column_stack(np.divmod(number, counts[which, 1]))
    a, b, d = of[which, 0], of[which, 1] - of[which, 0], of[which, 3] - of[which, 0]
    corners = []
    for step in ((0, 0), (1, 0), (1, 1), (0, 1)):
        u, v = ((place + step) / counts[which]).T
        corners.append(a + u[:, None] * b + v[:, None] * d)
    return np.stack(corners, axis=1)
