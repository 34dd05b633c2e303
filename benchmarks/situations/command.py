"""`python -m benchmarks situations`: is what can be placed found, and nothing else placed?"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from benchmarks.jobs import run_jobs, say
from benchmarks.json_lines import read_lines
from benchmarks.options import add_job_options, add_table_options
from benchmarks.page import between_marks, require_marks
from benchmarks.situations.catalogue import all_situations
from benchmarks.situations.report import VERDICTS_FILE, situations_report
from benchmarks.situations.runs import (
    OUTCOMES,
    RUNS_FILE,
    SOLUTIONS,
    SituationJob,
    describe_situation,
    outcome,
    run_situation,
)
from benchmarks.situations.situation import CLOUDS

TABLE_FILE = "situations.md"


def add_situations_command(commands: Any) -> None:
    """Add `situations`, which sets `command_function`.

    Args:
        commands: what `ArgumentParser.add_subparsers` returned.
    """
    situations = commands.add_parser(
        "situations", help="situations whose true answer is known; resumes where it was cut"
    )
    situations.add_argument("--situation", action="append", metavar="NAME", help="only this one")
    situations.add_argument("--cloud", choices=CLOUDS, action="append")
    situations.add_argument("--seeds", type=int, default=1, help="sizes drawn anew for each")
    situations.add_argument("--first-seed", type=int, default=0)
    situations.add_argument("--seconds", type=float, default=5.0, help="processor time of a run")
    situations.add_argument("--enough", type=int, default=1, help="end a run after so many")
    add_table_options(situations, None)
    add_job_options(situations, "results/situations")
    situations.set_defaults(command_function=run_situations)


def run_situations(arguments: argparse.Namespace) -> int:
    """Run what is not recorded yet and write the table; 1 where something was placed that cannot
    be.

    Raises:
        ParameterError: no such situation, or the page has no marks.
    """
    if arguments.page is not None:
        require_marks(arguments.page)
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    path = arguments.output / RUNS_FILE
    if not arguments.report_only:
        jobs = _situation_jobs(arguments, seeds)
        run_jobs(run_situation, jobs, path, describe_situation, arguments.processes)
    entries = read_lines(path)
    text = situations_report(entries, read_lines(arguments.output / VERDICTS_FILE))
    arguments.output.mkdir(parents=True, exist_ok=True)
    (arguments.output / TABLE_FILE).write_text(text, encoding="utf-8")
    if arguments.page is not None:
        between_marks(arguments.page, text)
    say(text)
    return int(any(outcome(entry) in OUTCOMES[2:] for entry in entries))


def _situation_jobs(arguments: argparse.Namespace, seeds: range) -> list[SituationJob]:
    known = list(all_situations(np.random.default_rng(0)))
    limits = arguments.seconds, arguments.enough
    return [
        SituationJob(name, cloud, seed, *limits, arguments.output / SOLUTIONS)
        for seed in seeds
        for name in arguments.situation or known
        for cloud in arguments.cloud or CLOUDS
    ]
