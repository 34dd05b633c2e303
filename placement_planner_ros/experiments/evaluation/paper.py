"""The paper's protocol: every variant on every case with several seeds, resumable."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from placement_planner_ros.experiments.cases import Case, all_cases
from placement_planner_ros.experiments.json_lines import append_line, read_lines
from placement_planner_ros.experiments.spread import spread
from placement_planner_ros.experiments.trial import Trial, run_trial
from placement_planner_ros.experiments.variants import PAPER_VARIANTS

RUNS_FILE = "runs.jsonl"
_START_UP = 2.0
"""Seconds that a trial takes beside its time limit, for the estimate of the time left."""


@dataclass(frozen=True, slots=True)
class Preset:
    """How much is run.

    Attributes:
        seeds, seconds: runs per case and their time limit, for each variant but the baseline.
        baseline_seeds, baseline_seconds: the same of the baseline.
    """

    cases: tuple[Case, ...]
    seeds: int
    seconds: float
    baseline_seeds: int
    baseline_seconds: float


PRESETS: Mapping[str, Preset] = {
    "smoke": Preset(
        (
            Case("table", "small_crayons_box", "maximize_clearance"),
            Case("cabinet_low_clutter", "wine_glass", "minimize_clearance"),
        ),
        seeds=1,
        seconds=3.0,
        baseline_seeds=1,
        baseline_seconds=5.0,
    ),
    "quick": Preset(tuple(all_cases()), 5, 10.0, 2, 60.0),
    "full": Preset(tuple(all_cases()), 20, 120.0, 5, 60.0),
}


def preset_trials(preset: Preset, variants: Sequence[str] = PAPER_VARIANTS) -> list[Trial]:
    """Its trials seed by seed, so that a part of them is a smaller evaluation."""
    trials = []
    for seed in range(max(preset.seeds, preset.baseline_seeds)):
        for case in preset.cases:
            for variant in variants:
                baseline = variant == "baseline"
                if seed < (preset.baseline_seeds if baseline else preset.seeds):
                    seconds = preset.baseline_seconds if baseline else preset.seconds
                    trials.append(Trial(case, variant, seed, seconds))
    return trials


def run_paper(
    trials: Sequence[Trial],
    folder: Path,
    processes: int = 1,
    scheduler: str | None = None,
    tell: Callable[[str], None] = print,
    run: Callable[[Trial], dict[str, Any]] = run_trial,
) -> int:
    """Run the trials that the folder has no record of; one line each in `runs.jsonl`.

    Args:
        processes, scheduler: see `spread`.
        tell: gets a line of progress after each trial.
        run: what makes the record of a trial.

    Returns:
        How many of the trials run now ended without a solution.
    """
    path = folder / RUNS_FILE
    recorded = {record_key(record) for record in read_lines(path)}
    open_trials = [trial for trial in trials if trial.key not in recorded]
    tell(f"{len(trials) - len(open_trials)} of {len(trials)} runs are recorded in {path}")
    work = sum(trial.time_limit + _START_UP for trial in open_trials)
    done, failed, started = 0.0, 0, time.monotonic()
    for number, record in enumerate(spread(run, open_trials, processes, scheduler), start=1):
        append_line(path, record)
        done += record["time_limit"] + _START_UP
        failed += not record["solutions"]
        left = (time.monotonic() - started) / done * (work - done)
        tell(f"[{number}/{len(open_trials)}, {_duration(left)} left] {describe(record)}")
    return failed


def record_key(record: dict[str, Any]) -> str:
    """The key of the trial that a record is of."""
    case = Case(**record["case"])
    return Trial(case, record["variant"], record["seed"], record["time_limit"]).key


def describe(record: dict[str, Any]) -> str:
    """One line for the terminal."""
    head = f"{Case(**record['case'])!s:<62} {record['variant']:<10} seed {record['seed']:<2}"
    solutions = record["solutions"]
    if not solutions:
        return f"{head}  FAILED: {record['failure'].strip().splitlines()[-1]}"
    first, last = solutions[0], solutions[-1]
    return (
        f"{head}  first {first['time']:5.2f} s  {len(solutions):2d} solutions  "
        f"objective {first['objective']:+.4f} -> {last['objective']:+.4f}"
    )


def _duration(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds > 90 else f"{seconds:.0f} s"
