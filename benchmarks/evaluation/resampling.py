"""Bootstrap intervals of means over cases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.errors import ParameterError

DRAWS = 4000


@dataclass(frozen=True, slots=True, eq=False)
class Interval:
    """A mean and its percentile bootstrap interval.

    Attributes:
        mean, low, high: numbers, or arrays where the values were.
    """

    mean: npt.NDArray[np.float64]
    low: npt.NDArray[np.float64]
    high: npt.NDArray[np.float64]


def mean_interval(
    groups: Sequence[npt.ArrayLike],
    rng: np.random.Generator,
    level: float = 0.95,
    draws: int = DRAWS,
) -> Interval:
    """The mean of the groups' means, each group counting the same.

    Runs are drawn anew within each group, because the cases are fixed and the seeds are not. For
    paired differences give the differences.

    Args:
        groups: of each case, (n, ...) values of its n runs; n ≥ 1.
        level: of the interval, for example 0.95.
    """
    arrays = [np.asarray(group, dtype=np.float64) for group in groups]
    if not arrays or any(len(array) == 0 for array in arrays):
        raise ParameterError("groups", [len(array) for array in arrays], "give one value or more")
    means = np.zeros((draws, *arrays[0].shape[1:]))
    for array in arrays:
        rows = rng.integers(len(array), size=(draws, len(array)))
        counts = np.zeros((draws, len(array)))
        np.add.at(counts, (np.arange(draws)[:, None], rows), 1.0)
        means += np.tensordot(counts / len(array), array, axes=1)
    means /= len(arrays)
    low, high = np.quantile(means, [(1 - level) / 2, (1 + level) / 2], axis=0)
    mean = np.mean([array.mean(axis=0) for array in arrays], axis=0)
    return Interval(np.asarray(mean), np.asarray(low), np.asarray(high))
