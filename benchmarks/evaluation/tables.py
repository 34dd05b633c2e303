"""The tables of the evaluation, for the page and for the documentation alike."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.cases import Case, case_label, in_words
from benchmarks.evaluation.comparisons import (
    BASELINE,
    REFERENCE,
    Comparison,
    curve,
    finals,
    first_times,
    solved_in_every_run,
)
from benchmarks.evaluation.resampling import Interval
from benchmarks.evaluation.results import EvaluationResults
from benchmarks.record import last_line
from benchmarks.text_table import TextTable
from benchmarks.yardstick.exhaustive_search import BETTER


def aims_table(results: EvaluationResults, comparisons: Sequence[Comparison]) -> TextTable:
    """What the search is to reach on the 24 cases within 10 s, and what it has reached."""
    rows = []
    if REFERENCE in results.variants:
        solved = solved_in_every_run(results, REFERENCE)
        cases = len(results.cases_of(REFERENCE))
        rows.append((f"cases solved in every run by {REFERENCE}", "all", f"{solved} of {cases}"))
        for seconds, wanted in ((2.0, 0.85), (10.0, 0.95)):
            if seconds <= results.horizon:
                found = curve(results, REFERENCE, results.cases, np.array([seconds]))
                what = f"mean relative objective of {REFERENCE} after {seconds:g} s"
                rows.append((what, f"≥ {wanted}", _mean_at(found, 0)))
    for comparison in comparisons:
        if comparison.other != BASELINE:
            what = f"{REFERENCE} minus {comparison.other}, area under the curve, pooled"
            rows.append((what, "interval above 0", _signed_mean(comparison.pooled)))
    return TextTable(("what", "aim", "reached"), rows)


def level_table(results: EvaluationResults) -> TextTable:
    """Mean relative objective after some seconds, all cases and by scene and objective."""
    early = [t for t in (1.0, 2.0, 5.0, 10.0, 30.0) if t < results.horizon]
    moments = np.array([*early, results.horizon])
    groups: dict[str, list[Case]] = {"all cases": list(results.cases)}
    for case in results.cases:
        sign = "max" if case.objective == "maximize_clearance" else "min"
        groups.setdefault(f"{in_words(case.scene)}, {sign}", []).append(case)
    rows = []
    for name, cases in groups.items():
        for variant in results.variants:
            if any(results.of_variant(variant, case) for case in cases):
                found = curve(results, variant, cases, moments)
                cells = (_mean_at(found, k) for k in range(len(moments)))
                rows.append((name, variant, *cells))
    return TextTable(
        ("cases", "variant", *(f"after {t:g} s" for t in moments)),
        rows,
        "Means over cases and runs; 95 % bootstrap intervals where cases have several runs.",
    )


def first_solution_table(results: EvaluationResults) -> TextTable:
    """How soon the first placement is there."""
    rows = []
    for variant in results.variants:
        times = first_times(results, variant, results.cases)
        solved = int(np.isfinite(times).sum())
        quantiles = np.quantile(times, [0.5, 0.95, 1.0], method="higher")
        rows.append((variant, f"{solved} of {len(times)}", *(_in_seconds(q) for q in quantiles)))
    return TextTable(
        ("variant", "runs with a placement", "median", "95 %", "slowest"),
        rows,
        "Seconds from the start, the environment's construction included; runs without a "
        "placement count as endless.",
    )


def difference_table(comparisons: Sequence[Comparison]) -> TextTable:
    """What each part contributes."""
    rows = []
    for comparison in comparisons:
        by_case = np.array(list(comparison.by_case.values()))
        worst = min(comparison.by_case, key=lambda case: comparison.by_case[case])
        rows.append(
            (
                f"{REFERENCE} minus {comparison.other}",
                _signed_mean(comparison.pooled),
                f"{int((by_case > 0.0).sum())} of {len(by_case)}",
                f"{by_case.min():+.3f}, {case_label(worst)}",
            )
        )
    return TextTable(
        ("difference", "area under the curve", "cases better", "worst case"),
        rows,
        "Paired by seed, 95 % bootstrap intervals.",
    )


def gap_table(results: EvaluationResults) -> TextTable:
    """Each case's scale, and how near the reference and the best run come to its top."""
    rows = []
    for case in results.cases:
        yardstick, scale = results.yardsticks[case], results.scales[case]
        best, dense = results.best_run(case), yardstick["best"]
        word = "" if yardstick["complete"] else " (cut off)"
        if best is not None and dense is not None:
            found = best["solutions"][-1]["objective"]
            word = " (beaten)" if found - dense > BETTER * (dense - scale.random) else word
        reached = finals(results, REFERENCE, case)
        cells = [case_label(case), f"{scale.random:+.4f}"]
        cells.append("none" if dense is None else f"{dense:+.4f}{word}")
        cells += (
            ["none", ""]
            if best is None
            else [f"{best['solutions'][-1]['objective']:+.4f}", best["variant"]]
        )
        cells += [f"{each(reached):.2f}" if len(reached) else "" for each in (np.mean, np.min)]
        rows.append(cells)
    header = (
        "case", "ξ random [m]", "ξ exhaustive search [m]", "ξ best run [m]", "by",
        f"{REFERENCE} after {results.horizon:g} s, mean", "worst run",
    )  # fmt: skip
    note = "Beaten: by a run, by more than complete searches leave. Relative objective: 0 is the "
    note += "median of random feasible placements, 1 the best known by the search or any run."
    return TextTable(header, rows, note)


def failure_table(results: EvaluationResults) -> TextTable:
    """Runs without a placement, and why."""
    rows = [
        (
            case_label(Case(**record["case"])),
            str(record["variant"]),
            str(record["seed"]),
            last_line(record["failure"]),
        )
        for record in results.failed()
    ]
    return TextTable(("case", "variant", "seed", "why"), rows)


def _mean_at(found: Interval, k: int) -> str:
    mean, low, high = found.mean[k], found.low[k], found.high[k]
    return f"{mean:.3f}{_in_brackets(float(low), float(high), '.3f')}"


def _signed_mean(found: Interval) -> str:
    return f"{float(found.mean):+.3f}{_in_brackets(float(found.low), float(found.high), '+.3f')}"


def _in_brackets(low: float, high: float, form: str) -> str:
    """Nothing where the interval has no width, as with one run per case."""
    return f" [{low:{form}}, {high:{form}}]" if high > low else ""


def _in_seconds(value: float) -> str:
    return f"{value:.2f} s" if np.isfinite(value) else "never"
