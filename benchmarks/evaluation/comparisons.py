"""What the runs say: curves, first solutions, differences between variants, gaps to the best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.cases import Case
from benchmarks.evaluation.relative import area_under_curve, values_at
from benchmarks.evaluation.resampling import Interval, mean_interval
from benchmarks.evaluation.results import EvaluationResults
from benchmarks.variants import VARIANTS
from placement_planner_ros.core.types import Array

REFERENCE = next(iter(VARIANTS))
"""The variant the others are compared with."""
BASELINE = "baseline"
_SEED = 0


def curve(
    results: EvaluationResults, variant: str, cases: Sequence[Case], times: Array
) -> Interval:
    """Mean relative objective at each of the (k,) times over the cases, each counting the same."""
    groups = [
        [values_at(times, results.steps(record)) for record in results.of_variant(variant, case)]
        for case in cases
        if results.of_variant(variant, case)
    ]
    return mean_interval(groups, np.random.default_rng(_SEED))


def areas(results: EvaluationResults, variant: str, case: Case) -> dict[int, float]:
    """Seed -> area under the curve up to the common horizon."""
    return {
        int(record["seed"]): area_under_curve(results.steps(record), results.horizon)
        for record in results.of_variant(variant, case)
    }


@dataclass(frozen=True, slots=True)
class Comparison:
    """The reference minus one other variant, area under the curve, paired by seed.

    Attributes:
        pooled: the mean difference over all cases.
        by_case: each case's mean difference.
    """

    other: str
    pooled: Interval
    by_case: Mapping[Case, float]


def compare(results: EvaluationResults, other: str) -> Comparison | None:
    """The reference against another variant on all cases both were run on; None without any."""
    groups: dict[Case, list[float]] = {}
    for case in results.cases_of(REFERENCE, other):
        ours, theirs = areas(results, REFERENCE, case), areas(results, other, case)
        differences = [ours[seed] - theirs[seed] for seed in ours if seed in theirs]
        if differences:
            groups[case] = differences
    if not groups:
        return None
    pooled = mean_interval(list(groups.values()), np.random.default_rng(_SEED))
    return Comparison(other, pooled, {case: float(np.mean(d)) for case, d in groups.items()})


def first_times(results: EvaluationResults, variant: str, cases: Sequence[Case]) -> Array:
    """(n,) seconds to the first placement of every run; inf where there is none."""
    return np.array(
        [
            record["solutions"][0]["time"] if record["solutions"] else np.inf
            for case in cases
            for record in results.of_variant(variant, case)
        ]
    )


def solved_in_every_run(results: EvaluationResults, variant: str) -> int:
    """Number of cases of which every run has a placement."""
    return sum(
        all(record["solutions"] for record in results.of_variant(variant, case))
        for case in results.cases_of(variant)
    )


def finals(results: EvaluationResults, variant: str, case: Case) -> Array:
    """(n,) relative objective each run of the case has at the common horizon."""
    horizon = np.array([results.horizon])
    return np.array(
        [values_at(horizon, results.steps(r))[0] for r in results.of_variant(variant, case)]
    )
