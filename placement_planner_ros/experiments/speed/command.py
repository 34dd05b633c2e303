"""`placement_benchmark speed`: every speed figure beside its target, in one command."""

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

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.experiments.baselines.plain import PlainPlanner
from placement_planner_ros.experiments.cases import OBJECTIVES, Case, all_cases
from placement_planner_ros.experiments.json_lines import read_lines
from placement_planner_ros.experiments.speed.checking import check_recorded
from placement_planner_ros.experiments.speed.clouds import measure_clouds
from placement_planner_ros.experiments.speed.goal_sets import measure_goal_sets
from placement_planner_ros.experiments.speed.node import measure_node
from placement_planner_ros.experiments.speed.provenance import MADE_WITH, made_with
from placement_planner_ros.experiments.speed.queries import Bench, CompareSettings
from placement_planner_ros.experiments.speed.recorder import RecordSettings, record
from placement_planner_ros.experiments.speed.report import (
    draw,
    fill_page,
    markdown,
    plain_text,
    require_marks,
)
from placement_planner_ros.experiments.speed.rows import ROWS, Entry, lines_of
from placement_planner_ros.experiments.speed.searches import measure_first, measure_sampling
from placement_planner_ros.experiments.trial import warm_process
from placement_planner_ros.scenes.objects import OBJECT_NAMES
from placement_planner_ros.scenes.scenes import SCENE_NAMES

RAW_FILE, TABLE_FILE, PICTURE_FILE = "raw.jsonl", "speed.md", "speed.png"
_RECORDED = ("configurations", "answers", "edges", "ik", "agreement", "goal_sets")
"""Rows measured on the queries of recorded runs."""
_BROUGHT = {"first": ("checked",), "node": ("memory",)}
"""Rows that come with others."""
_FIRST_FOLDER = "first"


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
    speed.add_argument("--scene", choices=SCENE_NAMES, action="append")
    speed.add_argument("--object", choices=OBJECT_NAMES, action="append")
    speed.add_argument("--objective", choices=OBJECTIVES, action="append")
    speed.add_argument("--seed", type=int, default=0, help="of everything random")
    count = _at_least_one
    speed.add_argument("--runs", type=count, default=3, help="recorded per case")
    speed.add_argument("--samples", type=count, default=2000, help="goal samples of a recorded run")
    speed.add_argument(
        "--agreement",
        type=count,
        default=2000,
        metavar="N",
        help="configurations per scene put to the exact check too; 1000000 takes some hours",
    )
    speed.add_argument("--sampling-seconds", type=_positive, default=1.5, help="of search per case")
    speed.add_argument("--seeds", type=count, default=5, help="first placements per case")
    speed.add_argument(
        "--plain-seeds", type=count, default=1, help="the same by the plain path, per case"
    )
    speed.add_argument(
        "--limit", type=_positive, default=10.0, help="seconds until a run counts as unsolved"
    )
    speed.add_argument("--plain-queries", type=count, default=1, help="goal sets per case")
    speed.add_argument(
        "--query-limit", type=_positive, default=5.0, help="seconds until a goal set is given up"
    )
    speed.add_argument("--cloud-repeats", type=count, default=5, help="per scene and kind")
    speed.add_argument("--stops", type=count, default=30, help="runs of the node, stopped anywhere")
    speed.add_argument(
        "--minutes", type=_positive, default=1.0, help="of the node's search, for its memory"
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


def _at_least_one(text: str) -> int:
    if int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: give at least 1")
    return int(text)


def _positive(text: str) -> float:
    if not 0.0 < float(text) < float("inf"):
        raise argparse.ArgumentTypeError(f"{text}: give a number above zero")
    return float(text)


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
    text, picture = markdown(lines, entries), draw(lines, entries)
    (arguments.output / TABLE_FILE).write_text(text, encoding="utf-8")
    (arguments.output / PICTURE_FILE).write_bytes(picture)
    if arguments.page is not None:
        fill_page(arguments.page, text, picture)
    print(plain_text(lines))
    met = sum(line.met for line in lines)
    print(f"{met} of {len(lines)} targets met; wrote {arguments.output}")
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
    print("warming up", flush=True)
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
    started, done, total = time.monotonic(), 0.0, sum(job.seconds for job in jobs)
    for number, job in enumerate(jobs, start=1):
        began = time.monotonic()
        error = ""
        try:
            yield from job.run()
        except Exception as raised:
            error = f"{type(raised).__name__}: {raised}"
            traceback.print_exc()
            for row in job.rows:
                yield {"row": row, "job": job.name, "error": error}
        done += job.seconds
        left = (time.monotonic() - started) / done * (total - done)
        print(
            f"[{number}/{len(jobs)}, {left / 60:.0f} min left] {job.name}: "
            f"{time.monotonic() - began:.1f} s{'  FAILED' if error else ''}",
            flush=True,
        )


def _jobs(arguments: argparse.Namespace) -> Iterator[Job]:
    rows = set(arguments.only)
    cases = [case for case in all_cases() if _wanted(case, arguments)]
    recorded = tuple(row for row in _RECORDED if row in rows)
    by_scene = {scene: [c for c in cases if c.scene == scene] for scene in SCENE_NAMES}
    for case in cases:
        wanted = [row for row in recorded if row != "goal_sets" or "cabinet" in case.scene]
        if wanted:
            share = -(-arguments.agreement // len(by_scene[case.scene]))
            seconds = 5.0 + 2.0 * len(wanted) + 2e-4 * share * ("agreement" in rows)
            yield Job(
                f"recorded queries of {case}",
                tuple(wanted),
                seconds,
                partial(_recorded, case, wanted, share, arguments),
            )
    if "samples" in rows:
        for case in cases:
            yield Job(
                f"sampling, {case}",
                ("samples",),
                1.5 + arguments.sampling_seconds,
                partial(_sampling, case, arguments),
            )
    if "clouds" in rows:
        for scene in (scene for scene, own in by_scene.items() if own):
            yield Job(
                f"clouds, {scene}",
                ("clouds",),
                5.0 + arguments.cloud_repeats,
                partial(_clouds, scene, arguments),
            )
    if "first" in rows:
        yield Job(
            "first placements",
            ("first", "checked"),
            2.5 * arguments.seeds * len(cases),
            partial(_first_placements, cases, arguments),
        )
    if "plain" in rows:
        for case in cases:
            yield Job(
                f"first placements by the plain path, {case}",
                ("plain",),
                10.0 * arguments.plain_seeds,
                partial(_plain_placements, case, arguments),
            )
    if "node" in rows:
        yield Job(
            "the node",
            ("node", "memory"),
            30.0 + 2.5 * arguments.stops + 60.0 * arguments.minutes,
            partial(measure_node, arguments.stops, arguments.minutes, arguments.seed),
        )


def _wanted(case: Case, arguments: argparse.Namespace) -> bool:
    return (
        (not arguments.scene or case.scene in arguments.scene)
        and (not arguments.object or case.object in arguments.object)
        and (not arguments.objective or case.objective in arguments.objective)
    )


def _recorded(
    case: Case, rows: list[str], agreement: int, arguments: argparse.Namespace
) -> Iterator[Entry]:
    settings = RecordSettings(runs=arguments.runs, samples=arguments.samples)
    recording = record(case, arguments.seed, settings)
    rng = np.random.default_rng([arguments.seed, *str(case).encode()])  # differs from case to case
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
        yield from measure_goal_sets(recording, arguments.plain_queries, arguments.query_limit, rng)


def _sampling(case: Case, arguments: argparse.Namespace) -> Iterator[Entry]:
    yield measure_sampling(case, arguments.seed, arguments.sampling_seconds)


def _clouds(scene: str, arguments: argparse.Namespace) -> Iterator[Entry]:
    rng = np.random.default_rng(arguments.seed)
    yield from measure_clouds(scene, arguments.cloud_repeats, rng)


def _first_placements(cases: list[Case], arguments: argparse.Namespace) -> Iterator[Entry]:
    """The first one of a process is not counted: it fills what no warm-up reaches."""
    folder = arguments.output / _FIRST_FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    measure_first(cases[0], arguments.seed, arguments.limit, folder)
    with (folder / "runs.jsonl").open("w", encoding="utf-8") as runs:
        for case in cases:
            for seed in range(arguments.seed, arguments.seed + arguments.seeds):
                entry, run = measure_first(case, seed, arguments.limit, folder)
                runs.write(run.to_json() + "\n")
                yield entry
    checked = check_recorded(folder)
    if checked is not None:
        yield checked


def _plain_placements(case: Case, arguments: argparse.Namespace) -> Iterator[Entry]:
    for seed in range(arguments.seed, arguments.seed + arguments.plain_seeds):
        entry, _ = measure_first(
            case,
            seed,
            arguments.limit,
            arguments.output / "plain",
            PlainPlanner,
            "plain",
            PlainPlanner.register,
        )
        yield entry
