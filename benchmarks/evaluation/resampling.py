"""Bootstrap intervals of means over cases, and Holm's correction for many comparisons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.types import Array

DRAWS = 4000


@dataclass(frozen=True, slots=True, eq=False)
class Interval:
    """A mean and its percentile bootstrap interval.

    Attributes:
        mean, low, high: numbers, or arrays where the values were.
        p: two-sided, of the mean being zero, for numbers; 1 where there is one run of each case,
            which says nothing about spread (the interval then is the mean alone).
    """

    mean: npt.NDArray[np.float64]
    low: npt.NDArray[np.float64]
    high: npt.NDArray[np.float64]
    p: float


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
    p = 1.0 if max(map(len, arrays)) == 1 else _p_value(means)
    return Interval(np.asarray(mean), np.asarray(low), np.asarray(high), p)


def _p_value(means: Array) -> float:
    """Twice the smaller share of draws on one side of zero, no less than the draws can resolve."""
    draws = len(means)
    share = min(int((means <= 0).sum()), int((means >= 0).sum())) / means.size
    return float(min(1.0, max(2.0 * share, 2.0 / (draws + 1))))


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values adjusted so that comparing each with α keeps the family-wise error below α."""
    p = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(p, kind="stable")
    compared = np.arange(len(p), 0, -1)
    adjusted = np.empty(len(p))
    adjusted[order] = np.maximum.accumulate(np.minimum(1.0, compared * p[order]))
    return [float(each) for each in adjusted]
