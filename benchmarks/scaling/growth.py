"""What the scaling runs say: the time to a good placement, and the exponent it grows with."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.evaluation.relative import Scale, time_to_reach
from placement_planner_ros.core.types import Array

WANTED = 0.9
"""The relative objective that is waited for."""
_DRAWS = 2000


@dataclass(frozen=True, slots=True, eq=False)
class Growth:
    """One axis and objective.

    Attributes:
        factors: (k,) ascending.
        sizes: (k,) m³, points, or things.
        times: per factor, seconds until each run had 0.9; inf where it never had.
        medians: (k,) of the times.
        exponent: slope of the medians over the factors, both as logarithms: below 1 is sub-linear.
            Infinite where a median is.
        interval: 95 % percentile bootstrap of the exponent over the runs.
    """

    axis: str
    objective: str
    factors: Array
    sizes: Array
    times: tuple[Array, ...]
    medians: Array
    exponent: float
    interval: tuple[float, float]


def growths(records: Sequence[Mapping[str, Any]]) -> list[Growth]:
    """One for each axis and objective of which two factors or more were run.

    A setting's scale is from its random placements (0) to the best of its runs (1); settings in
    which no run is better than random have no times and count as never reached.
    """
    groups: defaultdict[tuple[str, str], defaultdict[int, list[Mapping[str, Any]]]]
    groups = defaultdict(lambda: defaultdict(list))
    for record in records:
        groups[record["axis"], record["case"]["objective"]][record["factor"]].append(record)
    return [
        _growth_of(axis, objective, dict(sorted(by_factor.items())))
        for (axis, objective), by_factor in groups.items()
        if len(by_factor) > 1
    ]


def _growth_of(
    axis: str, objective: str, by_factor: Mapping[int, Sequence[Mapping[str, Any]]]
) -> Growth:
    factors = np.array(list(by_factor), dtype=np.float64)
    times = tuple(_times_of(records) for records in by_factor.values())
    sizes = np.array([_known_size(records) for records in by_factor.values()])
    rng = np.random.default_rng(0)
    drawn = np.array(
        [
            _log_slope(factors, np.array([_upper_median(rng.choice(t, len(t))) for t in times]))
            for _ in range(_DRAWS)
        ]
    )
    medians = np.array([_upper_median(t) for t in times])
    low, high = np.quantile(drawn, [0.025, 0.975], method="nearest")
    slope = _log_slope(factors, medians)
    return Growth(axis, objective, factors, sizes, times, medians, slope, (float(low), float(high)))


def _known_size(records: Sequence[Mapping[str, Any]]) -> float:
    return next((float(r["size"]) for r in records if r["size"] is not None), float("nan"))


def _times_of(records: Sequence[Mapping[str, Any]]) -> Array:
    random = next((r["random"] for r in records if r["random"] is not None), None)
    best = max((s["objective"] for r in records for s in r["solutions"]), default=None)
    if random is None or best is None or best <= random:
        return np.full(len(records), np.inf)
    scale = Scale(best, random)
    return np.array(
        [
            time_to_reach(
                [(s["time"], scale.relative(s["objective"])) for s in r["solutions"]], WANTED
            )
            for r in records
        ]
    )


def _upper_median(times: Array) -> float:
    return float(np.quantile(times, 0.5, method="higher"))  # an endless half is endless


def _log_slope(factors: Array, medians: Array) -> float:
    if not np.isfinite(medians).all():
        return float("inf")
    return float(np.polyfit(np.log(factors), np.log(medians), 1)[0])
