"""The subcommands of `python -m benchmarks` that run cases and report on them."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.cases import GROUPS, all_cases
from benchmarks.evaluation.paper import PRESETS, preset_trials
from benchmarks.evaluation.results import EvaluationResults
from benchmarks.household import ALL_OBJECTS
from benchmarks.jobs import run_jobs, say
from benchmarks.json_lines import read_lines
from benchmarks.options import add_case_options, add_job_options, wanted_cases
from benchmarks.record import RUNS_FILE, Trial, describe_run, run_trial
from benchmarks.variants import PAPER_VARIANTS, VARIANTS
from benchmarks.yardstick.exhaustive_search import (
    YardstickJob,
    case_of,
    describe_yardstick,
    measure_yardstick,
)

YARDSTICK_FILE = "yardstick.jsonl"
_FOLDER = "results/paper"


def add_evaluation_commands(commands: Any) -> None:
    """Add `cases`, `paper`, `yardstick` and `report`; each sets `command_function`.

    Args:
        commands: what `ArgumentParser.add_subparsers` returned.
    """
    cases = commands.add_parser("cases", help="run the 24 cases, or others; keeps all solutions")
    cases.add_argument(
        "--group", choices=tuple(GROUPS), help="objects instead of the paper's, all of a group"
    )
    cases.add_argument("--seeds", type=int, default=3, help="runs per case (default %(default)s)")
    cases.add_argument("--seconds", type=float, default=30.0, help="time limit of a run")
    cases.add_argument("--enough", type=int, help="end a run after so many solutions")
    cases.add_argument("--cloud", choices=("complete", "cameras"), default="complete")
    cases.add_argument("--variant", choices=tuple(VARIANTS), default=next(iter(VARIANTS)))
    add_case_options(cases)
    add_job_options(cases, "results/cases")
    cases.set_defaults(command_function=_run_cases)

    paper = commands.add_parser("paper", help="run the paper's protocol; resumes where it was cut")
    paper.add_argument("--preset", choices=tuple(PRESETS), default="quick")
    paper.add_argument("--variant", choices=tuple(VARIANTS), action="append")
    paper.add_argument("--seeds", type=int, help="runs per case, instead of the preset's")
    paper.add_argument("--seconds", type=float, help="time limit, instead of the preset's")
    add_case_options(paper)
    add_job_options(paper, _FOLDER)
    paper.set_defaults(command_function=_run_paper)

    yardstick = commands.add_parser(
        "yardstick", help="search each case exhaustively for the best; takes minutes per case"
    )
    yardstick.add_argument("--preset", choices=tuple(PRESETS), default="quick")
    yardstick.add_argument("--seconds", type=float, default=900.0, help="processor time per case")
    add_case_options(yardstick)
    add_job_options(yardstick, _FOLDER)
    yardstick.set_defaults(command_function=_run_yardstick)

    report = commands.add_parser("report", help="figures and tables of recorded runs")
    report.add_argument("folder", type=Path, help="what paper and yardstick wrote to")
    report.add_argument("--yardstick", type=Path, help=f"instead of the folder's {YARDSTICK_FILE}")
    report.set_defaults(command_function=_run_report)


def _run_cases(arguments: argparse.Namespace) -> int:
    """1 where a run, be it recorded before, has no solution."""
    if arguments.group is not None:
        arguments.object = GROUPS[arguments.group]
    path, given = arguments.output / RUNS_FILE, (arguments.seconds, arguments.enough)
    jobs = [
        Trial(case, arguments.variant, seed, *given, arguments.output / "solutions")
        for case in wanted_cases(all_cases(arguments.cloud, ALL_OBJECTS), arguments)
        for seed in range(arguments.seeds)
    ]
    run_jobs(run_trial, jobs, path, describe_run, arguments.processes)
    wanted = {job.key for job in jobs}
    records = [record for record in read_lines(path) if record.get("key") in wanted]
    solved = sum(bool(record["solutions"]) for record in records)
    say(f"{solved} of {len(records)} runs solved; recorded in {arguments.output}")
    return 0 if solved == len(records) else 1


def _run_paper(arguments: argparse.Namespace) -> int:
    preset, path = PRESETS[arguments.preset], arguments.output / RUNS_FILE
    preset = replace(preset, cases=wanted_cases(preset.cases, arguments))
    seeds = arguments.seeds or preset.seeds
    preset = replace(preset, seeds=seeds, baseline_seeds=min(seeds, preset.baseline_seeds))
    if arguments.seconds is not None:
        preset = replace(preset, seconds=arguments.seconds)
    trials = preset_trials(preset, arguments.variant or PAPER_VARIANTS)
    records = run_jobs(run_trial, trials, path, describe_run, arguments.processes)
    failed = sum(not record["solutions"] for record in records)
    say(f"{failed} runs without a placement; recorded in {path}")
    return 0


def _run_yardstick(arguments: argparse.Namespace) -> int:
    """Cases that are recorded are left out."""
    path = arguments.output / YARDSTICK_FILE
    known = {case_of(entry) for entry in read_lines(path)}
    cases = wanted_cases(PRESETS[arguments.preset].cases, arguments)
    jobs = [YardstickJob(case, arguments.seconds) for case in cases if case not in known]
    say(f"{len(known)} cases are recorded in {path}")
    run_jobs(measure_yardstick, jobs, path, describe_yardstick, arguments.processes)
    return 0


def _run_report(arguments: argparse.Namespace) -> int:
    from benchmarks.evaluation.report import write_report

    yardstick = arguments.yardstick or arguments.folder / YARDSTICK_FILE
    results = EvaluationResults.read(arguments.folder / RUNS_FILE, yardstick)
    for path in write_report(results, arguments.folder):
        say(f"wrote {path}")
    return 0
