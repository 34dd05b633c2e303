"""`python -m benchmarks wishes`: weighted objectives beside a dense search."""

from __future__ import annotations

import argparse
from typing import Any

from benchmarks.cases import all_cases
from benchmarks.jobs import run_jobs, say
from benchmarks.json_lines import read_lines
from benchmarks.options import (
    add_case_options,
    add_grid_options,
    add_job_options,
    grid_resolution,
    wanted_cases,
    workers_of,
)
from benchmarks.wishes.comparison import WishesJob, describe_wishes, run_wishes, wishes_table
from benchmarks.wishes.mixtures import MIXTURES

RUNS_FILE = "wishes.jsonl"


def add_wishes_command(commands: Any) -> None:
    """Add `wishes`, which sets `command_function`.

    Args:
        commands: what `ArgumentParser.add_subparsers` returned.
    """
    parser = commands.add_parser(
        "wishes", help="weighted objectives, beside the best of a dense search; resumes"
    )
    parser.add_argument("--mixture", choices=tuple(MIXTURES), action="append")
    parser.add_argument("--seeds", type=int, default=1, help="runs of each")
    parser.add_argument("--seconds", type=float, default=10.0, help="processor time of a run")
    parser.add_argument(
        "--dense-seconds", type=float, default=60.0, help="for reaching the grid's best poses"
    )
    add_grid_options(parser, 10.0, 5.0)
    add_case_options(parser)
    add_job_options(parser, "results/wishes")
    parser.set_defaults(command_function=run_wishes_command)


def run_wishes_command(arguments: argparse.Namespace) -> int:
    """1 where a run failed."""
    path = arguments.output / RUNS_FILE
    budget = tuple(range(arguments.seeds)), arguments.seconds, arguments.dense_seconds
    jobs = [
        WishesJob(case, mixture, *budget, grid_resolution(arguments))
        for case in wanted_cases(all_cases(), arguments)
        for mixture in arguments.mixture or MIXTURES
    ]
    run_jobs(run_wishes, jobs, path, describe_wishes, workers_of(arguments))
    entries = read_lines(path)
    say(wishes_table(entries))
    return int(any(entry["failure"] for entry in entries))
