"""The subcommands of `placement_benchmark` that reproduce and extend the paper's evaluation."""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from placement_planner_ros.experiments.cases import OBJECTIVES, Case
from placement_planner_ros.experiments.evaluation.paper import (
    PRESETS,
    RUNS_FILE,
    describe,
    preset_trials,
    run_paper,
)
from placement_planner_ros.experiments.evaluation.report import write_report
from placement_planner_ros.experiments.evaluation.results import Results
from placement_planner_ros.experiments.json_lines import append_line, read_lines
from placement_planner_ros.experiments.scaling.growth import growths
from placement_planner_ros.experiments.scaling.report import draw_scaling
from placement_planner_ros.experiments.scaling.runs import (
    AXES,
    SCALING_FILE,
    job_key,
    run_scaling_job,
    scaling_jobs,
)
from placement_planner_ros.experiments.spread import spread
from placement_planner_ros.experiments.variants import PAPER_VARIANTS, VARIANTS
from placement_planner_ros.experiments.yardstick.dense_search import YardstickJob, measure
from placement_planner_ros.experiments.yardstick.placement_grid import GridResolution
from placement_planner_ros.scenes.objects import OBJECT_NAMES
from placement_planner_ros.scenes.scenes import SCENE_NAMES

YARDSTICK_FILE = "yardstick.jsonl"
_FOLDER = Path("results/paper")


def add_evaluation_commands(commands: Any) -> None:
    """Add `paper`, `yardstick`, `scaling` and `report`; each sets `command_function`.

    Args:
        commands: what `ArgumentParser.add_subparsers` returned.
    """
    _add_paper(commands)
    _add_yardstick(commands)
    _add_scaling(commands)
    _add_report(commands)


def _add_paper(commands: Any) -> None:
    paper = commands.add_parser("paper", help="run the paper's protocol; resumes where it was cut")
    paper.add_argument("--preset", choices=tuple(PRESETS), default="quick")
    paper.add_argument("--variant", choices=tuple(VARIANTS), action="append")
    paper.add_argument("--seeds", type=int, help="runs per case, instead of the preset's")
    paper.add_argument("--seconds", type=float, help="time limit, instead of the preset's")
    _add_common(paper)
    paper.set_defaults(command_function=_run_paper)


def _add_yardstick(commands: Any) -> None:
    yardstick = commands.add_parser(
        "yardstick", help="search each case densely for the best placement; takes minutes per case"
    )
    yardstick.add_argument("--preset", choices=tuple(PRESETS), default="quick")
    yardstick.add_argument("--step", type=float, default=5.0, help="of positions, mm")
    yardstick.add_argument("--turn", type=float, default=2.0, help="of angles, degrees")
    yardstick.add_argument(
        "--seconds",
        type=float,
        default=300.0,
        help="processor time for reaching the best ones, per objective",
    )
    _add_common(yardstick)
    yardstick.set_defaults(command_function=_run_yardstick)


def _add_scaling(commands: Any) -> None:
    scaling = commands.add_parser(
        "scaling", help="time to a good placement as V, the cloud and clutter double three times"
    )
    scaling.add_argument("--axis", choices=tuple(AXES), action="append")
    scaling.add_argument("--seeds", type=int, default=5, help="runs per setting")
    scaling.add_argument("--seconds", type=float, default=20.0, help="processor time of a run")
    _add_spread(scaling)
    scaling.set_defaults(command_function=_run_scaling)


def _add_report(commands: Any) -> None:
    report = commands.add_parser("report", help="figures and tables of recorded runs")
    report.add_argument("folder", type=Path, help="what paper and yardstick wrote to")
    report.add_argument("--yardstick", type=Path, help=f"instead of the folder's {YARDSTICK_FILE}")
    report.add_argument("--no-pictures", action="store_true", help="leave out the placements")
    report.set_defaults(command_function=_run_report)


def _add_common(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scene", choices=SCENE_NAMES, action="append")
    parser.add_argument("--object", choices=OBJECT_NAMES, action="append")
    parser.add_argument("--objective", choices=OBJECTIVES, action="append")
    _add_spread(parser)


def _add_spread(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--processes", type=int, default=1, help="on this machine")
    parser.add_argument(
        "--dask-scheduler", metavar="ADDRESS", help="have the workers of a dask cluster do it"
    )
    parser.add_argument("--output", type=Path, default=_FOLDER)


def _cases(arguments: argparse.Namespace) -> tuple[Case, ...]:
    """The preset's cases that are wanted."""
    return tuple(
        case
        for case in PRESETS[arguments.preset].cases
        if (not arguments.scene or case.scene in arguments.scene)
        and (not arguments.object or case.object in arguments.object)
        and (not arguments.objective or case.objective in arguments.objective)
    )


def _run_paper(arguments: argparse.Namespace) -> int:
    preset = replace(PRESETS[arguments.preset], cases=_cases(arguments))
    if arguments.seeds is not None:
        seeds = arguments.seeds
        preset = replace(preset, seeds=seeds, baseline_seeds=min(seeds, preset.baseline_seeds))
    if arguments.seconds is not None:
        preset = replace(preset, seconds=arguments.seconds)
    trials = preset_trials(preset, arguments.variant or PAPER_VARIANTS)
    failed = run_paper(trials, arguments.output, arguments.processes, arguments.dask_scheduler, say)
    say(f"{failed} runs without a placement; recorded in {arguments.output / RUNS_FILE}")
    return 0


def _run_yardstick(arguments: argparse.Namespace) -> int:
    path = arguments.output / YARDSTICK_FILE
    known = {Case(**entry["case"]) for entry in read_lines(path)}
    wanted: dict[tuple[str, str], list[str]] = {}
    for case in _cases(arguments):
        if case not in known:
            wanted.setdefault((case.scene, case.object), []).append(case.objective)
    resolution = GridResolution(arguments.step / 1000.0, math.radians(arguments.turn))
    jobs = [
        YardstickJob(scene, name, tuple(objectives), resolution, arguments.seconds)
        for (scene, name), objectives in wanted.items()
    ]
    say(f"{len(known)} cases are recorded in {path}")
    started = time.monotonic()
    measured = spread(measure, jobs, arguments.processes, arguments.dask_scheduler)
    for done, entries in enumerate(measured, start=1):
        left = (time.monotonic() - started) / done * (len(jobs) - done)
        for entry in entries:
            append_line(path, entry)
            say(f"[{done}/{len(jobs)}, {left / 60:.0f} min left] {_describe(entry)}")
    return 0


def _describe(entry: dict[str, Any]) -> str:
    best, random = (
        "none" if entry[key] is None else f"{entry[key]:+.4f}" for key in ("best", "random")
    )
    return (
        f"{Case(**entry['case'])!s:<62} best {best}{'' if entry['complete'] else ' (cut off)'}"
        f"  random {random}  {entry['free_poses']} free poses"
    )


def _run_scaling(arguments: argparse.Namespace) -> int:
    path = arguments.output / SCALING_FILE
    known = {job_key(record) for record in read_lines(path)}
    wanted = scaling_jobs(arguments.seeds, arguments.seconds, tuple(arguments.axis or ()))
    jobs = [job for job in wanted if job.key not in known]
    say(f"{len(wanted) - len(jobs)} of {len(wanted)} runs are recorded in {path}")
    started = time.monotonic()
    records = spread(run_scaling_job, jobs, arguments.processes, arguments.dask_scheduler)
    for done, record in enumerate(records, start=1):
        append_line(path, record)
        left = (time.monotonic() - started) / done * (len(jobs) - done)
        setting = f"{record['axis']:<8} x{record['factor']}"
        say(f"[{done}/{len(jobs)}, {left / 60:.0f} min left] {setting} {describe(record)}")
    (arguments.output / "scaling.png").write_bytes(draw_scaling(growths(read_lines(path))))
    say(f"wrote {arguments.output / 'scaling.png'}")
    return 0


def _run_report(arguments: argparse.Namespace) -> int:
    yardstick = arguments.yardstick or arguments.folder / YARDSTICK_FILE
    results = Results.read(arguments.folder / RUNS_FILE, yardstick)
    scaling = read_lines(arguments.folder / SCALING_FILE)
    pictures = not arguments.no_pictures
    for path in write_report(results, arguments.folder, pictures, scaling):
        say(f"wrote {path}")
    return 0


def say(line: str) -> None:
    """Print at once, also into a pipe."""
    print(line, flush=True)
