"""The tables of the evaluation, for the page and for the documentation alike."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.cases import Case, case_label, words
from benchmarks.evaluation.comparisons import (
    BASELINE,
    REFERENCE,
    Comparison,
    curve,
    finals,
    first_times,
    sample_rates,
    solved_in_every_run,
    times_to_pass_baseline,
)
from benchmarks.evaluation.resampling import Interval
from benchmarks.evaluation.results import Results

MARGIN = 0.02
"""By how much a single case may be worse before it counts against the reference."""


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text under a header, with a sentence that says how to read them."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    def markdown(self) -> str:
        """As a Markdown table."""
        lines = [self.header, tuple("---" for _ in self.header), *self.rows]
        text = "\n".join("| " + " | ".join(line) + " |" for line in lines)
        return f"{text}\n\n{self.note}\n" if self.note else text + "\n"

    def page(self) -> str:
        """As HTML."""

        def row(cells: Sequence[str], tag: str) -> str:
            return "<tr>" + "".join(f"<{tag}>{html.escape(c)}</{tag}>" for c in cells) + "</tr>"

        body = "".join(row(cells, "td") for cells in self.rows)
        note = f"<p>{html.escape(self.note)}</p>" if self.note else ""
        return f"<table>{row(self.header, 'th')}{body}</table>{note}"


def aims_table(results: Results, comparisons: Sequence[Comparison]) -> Table:
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
                rows.append((what, f"≥ {wanted}", _number(found, 0)))
    passed = times_to_pass_baseline(results)
    if len(passed):
        never = int(np.isinf(passed).sum())
        rows.append(
            (
                f"time at which {REFERENCE} passes what the baseline ends with, median",
                "≤ 3 s",
                f"{_seconds(float(np.median(passed)))}; never in {never} of {len(passed)} runs",
            )
        )
    for comparison in comparisons:
        if comparison.other != BASELINE:
            what = f"{REFERENCE} minus {comparison.other}, area under the curve, pooled"
            rows.append((what, "interval above 0", _signed(comparison.pooled)))
            worse = comparison.worse_by(MARGIN)
            what = f"cases where {REFERENCE} is worse than {comparison.other} by over {MARGIN}"
            named = "none" if not worse else "; ".join(case_label(case) for case in worse)
            rows.append((what, "none after Holm", named))
    return Table(("what", "aim", "reached"), tuple(rows))


def level_table(results: Results) -> Table:
    """Mean relative objective after some seconds, all cases and by scene and objective."""
    early = [t for t in (1.0, 2.0, 5.0, 10.0, 30.0) if t < results.horizon]
    moments = np.array([*early, results.horizon])
    groups: dict[str, list[Case]] = {"all cases": list(results.cases)}
    for case in results.cases:
        sign = "max" if case.objective == "maximize_clearance" else "min"
        groups.setdefault(f"{words(case.scene)}, {sign}", []).append(case)
    rows = []
    for name, cases in groups.items():
        for variant in results.variants:
            if any(results.of_variant(variant, case) for case in cases):
                found = curve(results, variant, cases, moments)
                cells = (_number(found, k) for k in range(len(moments)))
                rows.append((name, variant, *cells))
    return Table(
        ("cases", "variant", *(f"after {t:g} s" for t in moments)),
        tuple(rows),
        "Means over cases and runs; 95 % bootstrap intervals where cases have several runs.",
    )


def first_solution_table(results: Results) -> Table:
    """How soon the first placement is there."""
    rows = []
    for variant in results.variants:
        times = first_times(results, variant, results.cases)
        solved = int(np.isfinite(times).sum())
        quantiles = np.quantile(times, [0.5, 0.95, 1.0], method="higher")
        rows.append((variant, f"{solved} of {len(times)}", *(_seconds(q) for q in quantiles)))
    return Table(
        ("variant", "runs with a placement", "median", "95 %", "slowest"),
        tuple(rows),
        "Seconds from the start, the environment's construction included; runs without a "
        "placement count as endless.",
    )


def difference_table(comparisons: Sequence[Comparison]) -> Table:
    """What each part contributes."""
    rows = []
    for comparison in comparisons:
        decided = [d for d in comparison.by_case if d.adjusted_p < 0.05]
        better = sum(float(d.interval.mean) > 0.0 for d in decided)
        cases = len(comparison.by_case)
        rows.append(
            (
                f"{REFERENCE} minus {comparison.other}",
                _signed(comparison.pooled),
                f"{better} of {cases}",
                f"{len(decided) - better} of {cases}",
                str(len(comparison.worse_by(MARGIN))),
            )
        )
    return Table(
        ("difference", "area under the curve", "cases better", "worse", f"worse by > {MARGIN}"),
        tuple(rows),
        "Paired by seed, 95 % bootstrap intervals; single cases after Holm at 5 %. With few seeds "
        "the bootstrap calls a case different as soon as all seeds agree.",
    )


def rate_table(results: Results) -> Table:
    """Samples per second."""
    rows = []
    for variant in results.variants:
        rates = sample_rates(results, variant)
        if len(rates):
            low, middle, high = np.quantile(rates, [0.25, 0.5, 0.75])
            rows.append((variant, f"{middle:.0f}", f"{low:.0f} … {high:.0f}"))
    return Table(
        ("variant", "goal samples per second, median of the runs", "quartiles"),
        tuple(rows),
        "Over the whole search, motion planning and local optimisation included.",
    )


def gap_table(results: Results) -> Table:
    """Each case's scale, and how near the reference and the best run come to its top."""
    rows = []
    for case in results.cases:
        yardstick, scale = results.yardsticks[case], results.scales[case]
        best = results.best_run(case)
        dense = yardstick["best"]
        reached = finals(results, REFERENCE, case)
        rows.append(
            (
                case_label(case),
                f"{scale.random:+.4f}",
                "none"
                if dense is None
                else f"{dense:+.4f}" + ("" if yardstick["complete"] else " (cut off)"),
                "none" if best is None else f"{best['solutions'][-1]['objective']:+.4f}",
                "" if best is None else str(best["variant"]),
                "" if len(reached) == 0 else f"{np.mean(reached):.2f}",
                "" if len(reached) == 0 else f"{np.min(reached):.2f}",
            )
        )
    return Table(
        (
            "case",
            "ξ random [m]",
            "ξ dense search [m]",
            "ξ best run [m]",
            "by",
            f"{REFERENCE} after {results.horizon:g} s, mean",
            "worst run",
        ),
        tuple(rows),
        "Relative objective: 0 is the median of random feasible placements, 1 the best known by "
        "the dense search or any run.",
    )


def failure_table(results: Results) -> Table:
    """Runs without a placement, and why."""
    rows = tuple(
        (
            case_label(Case(**record["case"])),
            str(record["variant"]),
            str(record["seed"]),
            str(record["failure"]).strip().splitlines()[-1],
        )
        for record in results.failed()
    )
    return Table(("case", "variant", "seed", "why"), rows)


def _number(found: Interval, k: int) -> str:
    mean, low, high = found.mean[k], found.low[k], found.high[k]
    return f"{mean:.3f}{_interval(float(low), float(high), '.3f')}"


def _signed(found: Interval) -> str:
    return f"{float(found.mean):+.3f}{_interval(float(found.low), float(found.high), '+.3f')}"


def _interval(low: float, high: float, form: str) -> str:
    """Nothing where the interval has no width, as with one run per case."""
    return f" [{low:{form}}, {high:{form}}]" if high > low else ""


def _seconds(value: float) -> str:
    return f"{value:.2f} s" if np.isfinite(value) else "never"
