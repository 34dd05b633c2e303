"""`python -m benchmarks speed`: every speed figure beside its target, in one command."""

from __future__ import annotations

import argparse
import json
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.baselines.plain import PlainPlanner
from benchmarks.cases import Case, all_cases
from benchmarks.jobs import Progress, say
from benchmarks.json_lines import read_lines
from benchmarks.options import add_case_options, wanted_cases
from benchmarks.page import require_marks
from benchmarks.record import RUNS_FILE, warm_process
from benchmarks.speed.clouds import measure_clouds
from benchmarks.speed.processes import check_recorded, measure_load, measure_node
from benchmarks.speed.queries import Bench, CompareSettings
from benchmarks.speed.recorder import RecordSettings, record
from benchmarks.speed.report import fill_page, markdown, plain_text
from benchmarks.speed.rows import MADE_WITH, ROWS, Entry, lines_of, made_with
from benchmarks.speed.searches import measure_first, measure_goal_sets, measure_sampling
from placement_planner_ros.core.errors import ParameterError

RAW_FILE, TABLE_FILE, PICTURE_FILE = "raw.jsonl", "speed.md", "speed.png"
_RECORDED = ("configurations", "answers", "edges", "ik", "agreement", "goal_sets")
"""Rows measured on the queries of recorded runs."""
_BROUGHT = {"first": ("checked",), "node": ("memory",)}
"""Rows that come with others."""
_SEED = 0
_SAMPLING_SECONDS = 1.5
_FIRST_SEEDS, _PLAIN_SEEDS, _FIRST_LIMIT = 5, 1, 10.0
_PLAIN_QUERIES, _QUERY_LIMIT = 1, 5.0
_CLOUD_REPEATS = 5
_LOAD_SECONDS = 300.0


@dataclass(frozen=True, slots=True)
class Job:
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
    speed.add_argument(
        "--only",
        type=_row_names,
        default=ROWS,
        metavar="ROW,ROW",
        help=f"of {', '.join(ROWS)}; what the folder holds of other rows is kept",
    )
    add_case_options(speed)
    for name, default, what in (
        ("runs", 3, "recorded per case"),
        ("samples", 2000, "goal samples of a recorded run"),
        (
            "agreement",
            2000,
            "configurations per scene put to the exact check too; 1000000 takes some hours",
        ),
        ("stops", 30, "runs of the node, stopped anywhere"),
        ("minutes", 1.0, "of the node's search, for its memory"),
    ):
        speed.add_argument(
            f"--{name}", type=partial(_positive, type(default)), default=default, help=what
        )
    speed.add_argument("--output", type=Path, default=Path("results/speed"))
    speed.add_argument(
        "--page",
        type=Path,
        help="a markdown page: replace the table between its marks, and images/speed.png beside it",
    )
    speed.add_argument(
        "--report-only", action="store_true", help="measure nothing: show what the folder holds"
    )
    speed.set_defaults(command_function=run_speed)


def _row_names(text: str) -> tuple[str, ...]:
    rows = tuple(dict.fromkeys(text.split(",")))
    unknown = [row for row in rows if row not in ROWS]
    if unknown:
        raise argparse.ArgumentTypeError(
            f"no row {', '.join(unknown)}; choose from {', '.join(ROWS)}"
        )
    return rows


def _positive(kind: Callable[[str], float], text: str) -> float:
    if not 0.0 < kind(text) < float("inf"):
        raise argparse.ArgumentTypeError(f"{text}: give a number above zero")
    return kind(text)


def run_speed(arguments: argparse.Namespace) -> int:
    """Measure, then write raw numbers, table and picture; 1 where a job failed.

    Raises:
        ParameterError: there is nothing to measure or to show, or the page has no marks.
    """
    raw = arguments.output / RAW_FILE
    if arguments.page is not None:
        require_marks(arguments.page)
    entries = read_lines(raw) if arguments.report_only else _measure(arguments, raw)
    if not entries:
        raise ParameterError("output", str(raw), "holds no figures yet: run without --report-only")
    lines = lines_of(entries)
    text = markdown(lines, entries)
    (arguments.output / TABLE_FILE).write_text(text, encoding="utf-8")
    say(plain_text(lines))
    met = sum(line.met for line in lines)
    say(f"{met} of {len(lines)} targets met; wrote {arguments.output}")
    from benchmarks.speed.picture import draw

    picture = draw(lines, entries)
    (arguments.output / PICTURE_FILE).write_bytes(picture)
    if arguments.page is not None:
        fill_page(arguments.page, text, picture)
    return 1 if any("error" in entry for entry in entries) else 0


def _measure(arguments: argparse.Namespace, raw: Path) -> list[Entry]:
    """All entries: the new ones, and those of other rows that the file held before."""
    jobs = list(_jobs(arguments))
    if not jobs:
        raise ParameterError(
            "only",
            ",".join(arguments.only),
            "these rows have nothing to measure in the chosen cases",
        )
    again = {name for row in arguments.only for name in (row, *_BROUGHT.get(row, ()))}
    entries = []
    for entry in read_lines(raw):
        if entry["row"] == MADE_WITH:
            entry["rows"] = [row for row in entry["rows"] if row not in again]
            if not entry["rows"]:
                continue
        if entry["row"] not in again:
            entries.append(entry)
    entries.append(made_with(arguments.only))
    raw.parent.mkdir(parents=True, exist_ok=True)
    say("warming up")
    warm_process()
    with raw.open("w", encoding="utf-8") as file:
        for entry in entries:
            file.write(json.dumps(entry) + "\n")
        for entry in _run_all(jobs):
            entries.append(entry)
            file.write(json.dumps(entry) + "\n")
            file.flush()
    return entries


def _run_all(jobs: list[Job]) -> Iterator[Entry]:
    """Every job's entries; one that fails leaves an entry with `error`, and the rest goes on."""
    progress = Progress([job.seconds for job in jobs])
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


def _jobs(arguments: argparse.Namespace) -> Iterator[Job]:
    rows = set(arguments.only)
    cases = wanted_cases(all_cases(), arguments)
    scenes = [case.scene for case in cases]
    recorded = [row for row in _RECORDED if row in rows]
    for case in cases:
        wanted = [row for row in recorded if row != "goal_sets" or "cabinet" in case.scene]
        if wanted:
            share = -(-arguments.agreement // scenes.count(case.scene))
            seconds = 5.0 + 2.0 * len(wanted) + 2e-4 * share * ("agreement" in rows)
            run = partial(_recorded, case, wanted, share, arguments)
            yield Job(f"recorded queries of {case}", tuple(wanted), seconds, run)
    if "samples" in rows:
        for case in cases:
            seconds, run = 1.5 + _SAMPLING_SECONDS, partial(_sampling, case)
            yield Job(f"sampling, {case}", ("samples",), seconds, run)
    if "clouds" in rows:
        for scene in dict.fromkeys(scenes):
            rng = np.random.default_rng(_SEED)
            run = partial(measure_clouds, scene, _CLOUD_REPEATS, rng)
            yield Job(f"clouds, {scene}", ("clouds",), 5.0 + _CLOUD_REPEATS, run)
    if "first" in rows and cases:
        seconds, run = 2.5 * _FIRST_SEEDS * len(cases), partial(_first, cases, arguments.output)
        yield Job("first placements", ("first", "checked"), seconds, run)
    if "plain" in rows:
        for case in cases:
            name = f"first placements by the plain path, {case}"
            run = partial(_plain, case, arguments.output / "plain")
            yield Job(name, ("plain",), 10.0 * _PLAIN_SEEDS, run)
    if "node" in rows:
        seconds = 30.0 + 2.5 * arguments.stops + 60.0 * arguments.minutes
        run = partial(measure_node, arguments.stops, arguments.minutes, _SEED)
        yield Job("the node", ("node", "memory"), seconds, run)
    if "load" in rows:
        run = partial(measure_load, _SEED)
        yield Job("the node beside large clouds", ("load",), _LOAD_SECONDS, run)


def _recorded(
    case: Case, rows: list[str], agreement: int, arguments: argparse.Namespace
) -> Iterator[Entry]:
    settings = RecordSettings(runs=arguments.runs, samples=arguments.samples)
    recording = record(case, _SEED, settings)
    rng = np.random.default_rng([_SEED, *str(case).encode()])  # differs from case to case
    bench = Bench(recording, CompareSettings(), rng)
    for row, measure in (
        ("configurations", bench.configurations),
        ("answers", bench.answers),
        ("edges", bench.edges),
        ("ik", bench.kinematics),
    ):
        if row in rows:
            yield measure()
    if "agreement" in rows:
        yield from bench.agreement(agreement)
    if "goal_sets" in rows:
        yield from measure_goal_sets(recording, _PLAIN_QUERIES, _QUERY_LIMIT, rng)


def _sampling(case: Case) -> Iterator[Entry]:
    yield measure_sampling(case, _SEED, _SAMPLING_SECONDS)


def _first(cases: tuple[Case, ...], output: Path) -> Iterator[Entry]:
    """The first one of a process is not counted: it fills what no warm-up reaches."""
    folder = output / "first"
    folder.mkdir(parents=True, exist_ok=True)
    measure_first(cases[0], _SEED, _FIRST_LIMIT, folder)
    with (folder / RUNS_FILE).open("w", encoding="utf-8") as runs:
        for case in cases:
            for seed in range(_SEED, _SEED + _FIRST_SEEDS):
                entry, run = measure_first(case, seed, _FIRST_LIMIT, folder)
                runs.write(json.dumps(run) + "\n")
                yield entry
    yield from check_recorded(folder)


def _plain(case: Case, folder: Path) -> Iterator[Entry]:
    for seed in range(_SEED, _SEED + _PLAIN_SEEDS):
        make, ready = PlainPlanner, PlainPlanner.register
        yield measure_first(case, seed, _FIRST_LIMIT, folder, make, "plain", ready)[0]
