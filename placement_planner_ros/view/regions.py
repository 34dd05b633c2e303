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
    cut = []
    for corners, counts in zip(
        of, np.maximum(1, np.ceil(sides / longest)).astype(int), strict=True
    ):
        u, v = (np.linspace(0.0, 1.0, n + 1) for n in counts)
        a, b, d = corners[0], corners[1] - corners[0], corners[3] - corners[0]
        grid = a + u[:, None, None] * b + v[None, :, None] * d
        cut.append(
            np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=2).reshape(
                -1, 4, 3
            )
        )
    return np.vstack(cut)
