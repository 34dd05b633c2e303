"""Seeds for inverse kinematics that begin near the pose: a table of configurations and their tips.

A seed whose tip is already close converges more often and in fewer iterations than a random one,
and as the table spans all limits, the seeds near a pose still spread over the null space.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from placement_planner_ros.core.reach.ik_kernels import ROTATION_SCALE_M
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.types import Array, frozen_array

WINDOW_ROWS = 512
"""Rows of the table that are compared for one pose."""


class SeedTable:
    """Random configurations of an arm, looked up by where they put the tip.

    Args:
        chain: the arm.
        rng: draws the table.
        size: rows, no fewer than `WINDOW_ROWS`.
    """

    def __init__(self, chain: Chain, rng: np.random.Generator, size: int = 8192) -> None:
        Q = chain.random(rng, (size,))
        # The first rows again after the last, so that every window is in one piece.
        self._configurations = frozen_array(np.concatenate([Q, Q[: WINDOW_ROWS - 1]]))
        self._features = frozen_array(_pose_features(chain.forward_batch(self._configurations)))
        self._squares = frozen_array((self._features**2).sum(axis=1))
        self._size = size

    def near(self, T_world_tip: Array, count: int, rng: np.random.Generator) -> Array:
        """The nearest of a random window of `WINDOW_ROWS` rows, for (n, 4, 4) poses.

        Args:
            count: at most `WINDOW_ROWS`.

        Returns:
            (n, count, dof), nearest first; another call looks at another window.
        """
        seeds = np.empty((len(T_world_tip), count, self._configurations.shape[1]))
        starts = rng.integers(self._size, size=len(T_world_tip))
        for n, wanted in enumerate(_pose_features(T_world_tip)):
            # Squared distances of the window's features, less what is the same for all.
            window = slice(starts[n], starts[n] + WINDOW_ROWS)
            away = self._squares[window] - 2.0 * (self._features[window] @ wanted)
            seeds[n] = self._configurations[window][np.argsort(away, kind="stable")[:count]]
        return seeds


@functools.lru_cache(maxsize=8)
def seed_table(chain: Chain) -> SeedTable:
    """The table of a chain, remembered; drawn from a generator of its own, so always the same."""
    return SeedTable(chain, np.random.default_rng(0))


def _pose_features(T: Array) -> Array:
    """(n, 12): squared differences of these are those of position and (small) rotation."""
    rotation = (ROTATION_SCALE_M / math.sqrt(2.0)) * T[:, :3, :3].reshape(-1, 9)
    return np.ascontiguousarray(np.concatenate([T[:, :3, 3], rotation], axis=1))
