"""`python -m benchmarks speed`: every speed figure beside its target, in one command."""

from __future__ import annotations

import argparse
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cases import Case, all_cases
from benchmarks.jobs import WorkProgress, say
from benchmarks.json_lines import append_line, lines_told_by, read_lines, replace_lines
from benchmarks.options import add_case_options, add_table_options, wanted_cases
from benchmarks.page import between_marks, require_marks
from benchmarks.record import RUNS_FILE, Trial, warm_process
from benchmarks.speed.clouds import measure_clouds
from benchmarks.speed.queries import QueryBench
from benchmarks.speed.recorder import RecordingSettings, record_queries
from benchmarks.speed.rows import MADE_WITH, ROWS, Entry, lines_of, made_with, speed_table
from benchmarks.speed.searches import measure_first, measure_sampling
from benchmarks.variants import VARIANTS
from placement_planner_ros.core.errors import ParameterError

RAW_FILE, TABLE_FILE = "raw.jsonl", "speed.md"
_RECORDED = ("configurations", "edges")
"""Rows measured on the queries of recorded runs."""
_BROUGHT = {"first": ("checked",), "node": ("memory",)}
"""Rows that come with others."""
_SEED = 0
_SAMPLING_SECONDS = 1.5
_FIRST_SEEDS, _FIRST_LIMIT = 5, 10.0
_CLOUD_REPEATS = 5
_LOAD_SECONDS = 300.0


_VERIFY = """
import json, sys
from pathlib import Path
from by_hand.verify_cases import verify
runs, refusals = verify(Path(sys.argv[1]))
checked = sum(len(run["solutions"]) for run in runs)
told = {"row": "checked", "checked": checked, "refused": len(refusals), "refusals": refusals}
print(json.dumps(told))
"""
"""What has `test/by_hand/verify_cases.py` check a folder of placements."""


@dataclass(frozen=True, slots=True)
class SpeedJob:
    """A piece of work, about so many seconds long, that yields raw entries."""

    name: str
    rows: tuple[str, ...]
    seconds: float
    run: Callable[[], Iterable[Entry]]


def add_speed_command(commands: Any) -> None:
    """Add `speed`, which sets `command_function`.

    Args:
        commands: what `ArgumentParser.add_subparsers` returned.
    """
    speed = commands.add_parser("speed", help="every speed figure beside its target")
    add_case_options(speed)
    add_table_options(speed, "results/speed", ROWS)
    for name, default, what in (
        ("runs", 3, "recorded per case"),
        ("samples", 2000, "goal samples of a recorded run"),
        ("stops", 30, "runs of the node, stopped anywhere"),
        ("minutes", 1.0, "of the node's search, for its memory"),
    ):
        speed.add_argument(f"--{name}", type=type(default), default=default, help=what)
    speed.set_defaults(command_function=run_speed)


def run_speed(arguments: argparse.Namespace) -> int:
    """Measure, then write raw numbers and table; 1 where a job failed.

    Raises:
        ParameterError: there is nothing to measure or to show, or the page has no marks.
    """
    raw = arguments.output / RAW_FILE
    if arguments.page is not None:
        require_marks(arguments.page)
    entries = read_lines(raw) if arguments.report_only else _measure_rows(arguments, raw)
    if not entries:
        raise ParameterError("output", str(raw), "holds no figures yet: run without --report-only")
    text = speed_table(lines_of(entries), entries)
    (arguments.output / TABLE_FILE).write_text(text, encoding="utf-8")
    say(f"{text}\nwrote {arguments.output}")
    if arguments.page is not None:
        between_marks(arguments.page, text)
    return 1 if any("error" in entry for entry in entries) else 0


def _measure_rows(arguments: argparse.Namespace, raw: Path) -> list[Entry]:
    """All entries: the new ones, and those of other rows that the file held before."""
    jobs = list(_jobs_of(arguments))
    if not jobs:
        raise ParameterError("rows", arguments.rows, "have nothing to measure in the chosen cases")
    again = {name for row in arguments.rows for name in (row, *_BROUGHT.get(row, ()))}
    entries = []
    for entry in read_lines(raw):
        if entry["row"] == MADE_WITH:
            entry["rows"] = [row for row in entry["rows"] if row not in again]
            if not entry["rows"]:
                continue
        if entry["row"] not in again:
            entries.append(entry)
    entries.append(made_with(arguments.rows))
    say("warming up")
    warm_process()
    replace_lines(raw, entries)
    for entry in _run_all(jobs):
        entries.append(entry)
        append_line(raw, entry)
    return entries


def _run_all(jobs: list[SpeedJob]) -> Iterator[Entry]:
    """Every job's entries; one that fails leaves an entry with `error`, and the rest goes on."""
    progress = WorkProgress([job.seconds for job in jobs])
    for job in jobs:
        began, failed = time.monotonic(), ""
        try:
            yield from job.run()
        except Exception as raised:
            failed = "  FAILED"
            traceback.print_exc()
            for row in job.rows:
                yield {"row": row, "job": job.name, "error": f"{type(raised).__name__}: {raised}"}
        progress.done(f"{job.name}: {time.monotonic() - began:.1f} s{failed}", job.seconds)


def _jobs_of(arguments: argparse.Namespace) -> Iterator[SpeedJob]:
    rows = set(arguments.rows)
    cases = wanted_cases(all_cases(), arguments)
    scenes = [case.scene for case in cases]
    recorded = [row for row in _RECORDED if row in rows]
    for case in cases:
        if recorded:
            run = partial(_recorded_entries, case, recorded, arguments)
            seconds = 5.0 + 2.0 * len(recorded)
            yield SpeedJob(f"recorded queries of {case}", tuple(recorded), seconds, run)
    if "samples" in rows:
        for case in cases:
            seconds, run = 1.5 + _SAMPLING_SECONDS, partial(_sampling_entries, case)
            yield SpeedJob(f"sampling, {case}", ("samples",), seconds, run)
    if "clouds" in rows:
        for scene in dict.fromkeys(scenes):
            rng = np.random.default_rng(_SEED)
            run = partial(measure_clouds, scene, _CLOUD_REPEATS, rng)
            yield SpeedJob(f"clouds, {scene}", ("clouds",), 5.0 + _CLOUD_REPEATS, run)
    if "first" in rows and cases:
        seconds, run = (
            2.5 * _FIRST_SEEDS * len(cases),
            partial(_first_entries, cases, arguments.output),
        )
        yield SpeedJob("first placements", ("first", "checked"), seconds, run)
    if "node" in rows:
        seconds = 30.0 + 2.5 * arguments.stops + 60.0 * arguments.minutes
        options = ["--stops", str(arguments.stops), "--minutes", str(arguments.minutes)]
        run = partial(lines_told_by, "-m", "benchmarks.node.node_speed", *options)
        yield SpeedJob("the node", ("node", "memory"), seconds, run)
    if "load" in rows:
        run = partial(lines_told_by, "-m", "benchmarks.node.node_load")
        yield SpeedJob("the node beside large clouds", ("load",), _LOAD_SECONDS, run)


def _recorded_entries(
    case: Case, rows: list[str], arguments: argparse.Namespace
) -> Iterator[Entry]:
    settings = RecordingSettings(runs=arguments.runs, samples=arguments.samples)
    recording = record_queries(case, _SEED, settings)
    rng = np.random.default_rng([_SEED, *str(case).encode()])  # differs from case to case
    bench = QueryBench(recording, rng)
    for row, measure in (
        ("configurations", bench.configurations),
        ("edges", bench.edges),
    ):
        if row in rows:
            yield measure()


def _sampling_entries(case: Case) -> Iterator[Entry]:
    yield measure_sampling(case, _SEED, _SAMPLING_SECONDS)


def _first_entries(cases: tuple[Case, ...], output: Path) -> Iterator[Entry]:
    """The first one of a process is not counted: it fills what no warm-up reaches."""
    folder = output / "first"
    variant = next(iter(VARIANTS))
    measure_first(Trial(cases[0], variant, _SEED, _FIRST_LIMIT))
    runs = []
    for case in cases:
        for seed in range(_SEED, _SEED + _FIRST_SEEDS):
            trial = Trial(case, variant, seed, _FIRST_LIMIT, solutions=folder / "solutions")
            entry, run = measure_first(trial)
            runs.append(run)
            yield entry
    replace_lines(folder / RUNS_FILE, runs)
    yield from lines_told_by("-c", _VERIFY, str(folder))
