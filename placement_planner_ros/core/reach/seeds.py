"""Seeds for inverse kinematics that begin near the pose: a table of configurations and their tips.

A seed whose tip is already close converges more often and in fewer iterations than a random one,
and as the table spans all limits, the seeds near a pose still spread over the null space.
"""

from __future__ import annotations

import functools
import math

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.reach.ik_kernels import ROTATION_SCALE_M
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.types import Array, frozen_array

WINDOW_ROWS = 512
"""Rows of the table that are compared for one pose."""


@njit(cache=True, nogil=True)
def _nearest_rows(
    features: Array,
    configurations: Array,
    wanted: Array,
    starts: npt.NDArray[np.int64],
    window: int,
    distance: Array,
    seeds: Array,
) -> None:
    """Fill seeds (n, s, dof) with the rows nearest to wanted (n, 12), nearest first.

    Of `window` rows from starts (n,) on, in a list of the best so far that each row is sorted into.
    """
    count = seeds.shape[1]
    rows = np.empty(count, dtype=np.int64)
    for n in range(len(wanted)):
        # The list of the best is empty.
        distance[:] = np.inf
        for k in range(window):
            # The next row of the window, which goes on at the first after the last.
            row = (starts[n] + k) % len(features)
            # How far its features are from those wanted.
            d = 0.0
            for a in range(12):
                d += (features[row, a] - wanted[n, a]) ** 2
            if d >= distance[count - 1]:
                continue
            # Move worse rows down, and put it in its place.
            place = count - 1
            while place > 0 and distance[place - 1] > d:
                distance[place] = distance[place - 1]
                rows[place] = rows[place - 1]
                place -= 1
            distance[place] = d
            rows[place] = row
        # The configurations of the best rows.
        for s in range(count):
            seeds[n, s] = configurations[rows[s]]


class SeedTable:
    """Random configurations of an arm, looked up by where they put the tip.

    Args:
        chain: the arm.
        rng: draws the table.
        size: rows.
    """

    def __init__(self, chain: Chain, rng: np.random.Generator, size: int = 8192) -> None:
        if size < WINDOW_ROWS:
            raise ParameterError("seed table size", size, f"must be at least {WINDOW_ROWS}")
        self._configurations = frozen_array(chain.random(rng, (size,)))
        self._features = frozen_array(_pose_features(chain.forward_batch(self._configurations)))

    def near(self, T_world_tip: Array, count: int, rng: np.random.Generator) -> Array:
        """The nearest of a random window of `WINDOW_ROWS` rows, for (n, 4, 4) poses.

        Returns:
            (n, count, dof), nearest first; another call looks at another window.

        Raises:
            ParameterError: count is not between 1 and `WINDOW_ROWS`.
        """
        if not 1 <= count <= WINDOW_ROWS:
            raise ParameterError("seed count", count, f"must be between 1 and {WINDOW_ROWS}")
        n = len(T_world_tip)
        seeds = np.empty((n, count, self._configurations.shape[1]))
        starts = rng.integers(len(self._features), size=n)
        _nearest_rows(
            self._features,
            self._configurations,
            _pose_features(T_world_tip),
            starts,
            WINDOW_ROWS,
            np.empty(count),
            seeds,
        )
        return seeds


@functools.lru_cache(maxsize=8)
def seed_table(chain: Chain) -> SeedTable:
    """The table of a chain, remembered; drawn from a generator of its own, so always the same."""
    return SeedTable(chain, np.random.default_rng(0))


def _pose_features(T: Array) -> Array:
    """(n, 12): squared differences of these are those of position and (small) rotation."""
    rotation = (ROTATION_SCALE_M / math.sqrt(2.0)) * T[:, :3, :3].reshape(-1, 9)
    return np.ascontiguousarray(np.concatenate([T[:, :3, 3], rotation], axis=1))
