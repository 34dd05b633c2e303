"""What the runs say: curves, first solutions, differences between variants, gaps to the best."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.cases import Case
from benchmarks.evaluation.relative import area_under_curve, time_to_reach, values_at
from benchmarks.evaluation.resampling import Interval, holm, mean_interval
from benchmarks.evaluation.results import EvaluationResults, final
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
class CaseDifference:
    """Reference minus another variant on one case, area under the curve, paired by seed.

    Attributes:
        interval: of the mean difference, at the level given.
        adjusted_p: after Holm across all cases of the comparison.
    """

    case: Case
    interval: Interval
    adjusted_p: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """The reference minus one other variant.

    Attributes:
        pooled: the mean difference over all cases.
        by_case: each case's, in the order of the results.
    """

    other: str
    pooled: Interval
    by_case: tuple[CaseDifference, ...]

    def worse_by(self, margin: float) -> list[Case]:
        """Cases where the reference is worse by more than that, after Holm at 5 %."""
        return [
            d.case for d in self.by_case if float(d.interval.mean) < -margin and d.adjusted_p < 0.05
        ]


def compare(results: EvaluationResults, other: str) -> Comparison | None:
    """The reference against another variant on all cases both were run on; None without any."""
    rng = np.random.default_rng(_SEED)
    cases, groups = [], []
    for case in results.cases_of(REFERENCE, other):
        ours, theirs = areas(results, REFERENCE, case), areas(results, other, case)
        differences = [ours[seed] - theirs[seed] for seed in ours if seed in theirs]
        if differences:
            cases.append(case)
            groups.append(differences)
    if not groups:
        return None
    intervals = [mean_interval([group], rng) for group in groups]
    adjusted = holm([interval.p for interval in intervals])
    by_case = tuple(map(CaseDifference, cases, intervals, adjusted))
    return Comparison(other, mean_interval(groups, rng), by_case)


def first_times(results: EvaluationResults, variant: str, cases: Sequence[Case]) -> Array:
    """(n,) seconds to the first placement of every run; inf where there is none."""
    return np.array(
        [
            record["solutions"][0]["time"] if record["solutions"] else np.inf
            for case in cases
            for record in results.of_variant(variant, case)
        ]
    )


def sample_rates(results: EvaluationResults, variant: str) -> Array:
    """(n,) goal samples per second of search of every run that ended without an error."""
    return np.array(
        [
            record["samples"] / (record["elapsed"] - record["preparation"])
            for case in results.cases
            for record in results.of_variant(variant, case)
            if record["elapsed"] > record["preparation"]
        ]
    )


def rejections(results: EvaluationResults, variant: str, cases: Sequence[Case]) -> dict[str, float]:
    """Constraint -> share of all samples it rejected; `goals` is the share that passed."""
    total: Counter[str] = Counter()
    samples = 0
    for record in itertools.chain.from_iterable(results.of_variant(variant, c) for c in cases):
        total.update(record["rejected"])
        samples += record["samples"]
    shares = {name: number / max(samples, 1) for name, number in total.items()}
    return {**shares, "goals": 1.0 - sum(shares.values())} if samples else {}


def times_to_pass_baseline(results: EvaluationResults) -> Array:
    """(n,) seconds until each run of the reference has what the baseline ended with (its median).

    inf where it never does.
    """
    times = []
    for case in results.cases_of(REFERENCE, BASELINE):
        wanted = float(
            np.median([final(results.steps(r)) for r in results.of_variant(BASELINE, case)])
        )
        times += [
            time_to_reach(results.steps(r), wanted) for r in results.of_variant(REFERENCE, case)
        ]
    return np.array(times)


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
