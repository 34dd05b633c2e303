"""The subcommands of `python -m benchmarks` that run cases and report on them."""

from __future__ import annotations

import argparse
import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.carry.report import markdown as carry_table
from benchmarks.carry.runs import RUNS_FILE as CARRY_FILE
from benchmarks.carry.runs import SOLUTIONS as CARRIED
from benchmarks.carry.runs import CarryJob, run_carry
from benchmarks.carry.runs import describe as describe_carry
from benchmarks.cases import GROUPS, all_cases
from benchmarks.evaluation.paper import PRESETS, preset_trials
from benchmarks.evaluation.results import Results
from benchmarks.jobs import Entry, J, run_jobs, say
from benchmarks.json_lines import read_lines
from benchmarks.options import add_case_options, add_job_options, wanted_cases
from benchmarks.record import RUNS_FILE, Trial, describe, record_key, run_trial
from benchmarks.scaling.growth import growths
from benchmarks.scaling.runs import (
    AXES,
    SCALING_FILE,
    describe_scaling,
    run_scaling_job,
    scaling_jobs,
    scaling_key,
)
from benchmarks.variants import PAPER_VARIANTS, VARIANTS
from benchmarks.wishes.command import add_wishes_command
from benchmarks.yardstick.dense_search import (
    YardstickJob,
    describe_yardstick,
    measure,
    yardstick_key,
)
from benchmarks.yardstick.placement_grid import GridResolution
from placement_planner_ros.scenes.objects import ALL_OBJECTS

YARDSTICK_FILE = "yardstick.jsonl"
_FOLDER = "results/paper"


def add_evaluation_commands(commands: Any) -> None:
    """Add `cases`, `paper`, `yardstick`, `scaling` and `report`; each sets `command_function`.

    Args:
        commands: what `ArgumentParser.add_subparsers` returned.
    """
    cases = commands.add_parser(
        "cases", help="run the 24 cases, or others, and keep every solution"
    )
    cases.add_argument(
        "--group",
        choices=tuple(GROUPS),
        help="objects instead of the paper's, all of a group",
    )
    cases.add_argument("--seeds", type=int, default=3, help="runs per case (default %(default)s)")
    cases.add_argument("--seconds", type=float, default=30.0, help="time limit of a run")
    cases.add_argument("--enough", type=int, help="end a run after so many solutions")
    cases.add_argument("--cloud", choices=("complete", "cameras"), default="complete")
    cases.add_argument("--variant", choices=tuple(VARIANTS), default=next(iter(VARIANTS)))
    cases.add_argument(
        "--carry",
        type=float,
        nargs="?",
        const=15.0,
        metavar="DEGREES",
        help="first placements only, of an object that is held upright and must not lean more on "
        "its way, beside runs in which it may (default %(const)s)",
    )
    cases.add_argument(
        "--opposite", action="store_true", help="with --carry: the wrist starts turned away"
    )
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
    add_case_options(yardstick)
    add_job_options(yardstick, _FOLDER)
    yardstick.set_defaults(command_function=_run_yardstick)

    scaling = commands.add_parser(
        "scaling", help="time to a good placement as V, the cloud and clutter double three times"
    )
    scaling.add_argument("--axis", choices=tuple(AXES), action="append")
    scaling.add_argument("--seeds", type=int, default=5, help="runs per setting")
    scaling.add_argument("--seconds", type=float, default=20.0, help="processor time of a run")
    add_job_options(scaling, _FOLDER)
    scaling.set_defaults(command_function=_run_scaling)

    add_wishes_command(commands)

    report = commands.add_parser("report", help="figures and tables of recorded runs")
    report.add_argument("folder", type=Path, help="what paper and yardstick wrote to")
    report.add_argument("--yardstick", type=Path, help=f"instead of the folder's {YARDSTICK_FILE}")
    report.add_argument("--no-pictures", action="store_true", help="leave out the placements")
    report.set_defaults(command_function=_run_report)


def _run(
    run: Callable[[J], Entry | list[Entry]],
    jobs: list[J],
    name: str,
    key: Callable[[Mapping[str, Any]], str] | None,
    describe: Callable[[Mapping[str, Any]], str],
    arguments: argparse.Namespace,
) -> list[Entry]:
    """`run_jobs` into a file of the output folder."""
    path, scheduler = arguments.output / name, arguments.dask_scheduler
    return run_jobs(run, jobs, path, key, describe, arguments.processes, scheduler)


_run_trials = functools.partial(_run, run_trial, key=record_key, describe=describe)


def _run_cases(arguments: argparse.Namespace) -> int:
    """1 where a run, be it recorded before, has no solution."""
    if arguments.group is not None:
        arguments.object = GROUPS[arguments.group]
    if arguments.carry is not None:
        return _run_carried(arguments)
    jobs = [
        Trial(
            case,
            arguments.variant,
            seed,
            arguments.seconds,
            arguments.enough,
            arguments.output / "solutions",
        )
        for case in wanted_cases(all_cases(arguments.cloud, ALL_OBJECTS), arguments)
        for seed in range(arguments.seeds)
    ]
    _run_trials(jobs, RUNS_FILE, arguments=arguments)
    wanted = {job.key for job in jobs}
    records = [r for r in read_lines(arguments.output / RUNS_FILE) if record_key(r) in wanted]
    solved = sum(bool(record["solutions"]) for record in records)
    say(f"{solved} of {len(records)} runs solved; recorded in {arguments.output}")
    return 0 if solved == len(records) else 1


def _run_carried(arguments: argparse.Namespace) -> int:
    """1 where something is found without the limit alone."""
    folder = arguments.output / CARRIED
    jobs = [
        CarryJob(case, seed, arguments.carry, arguments.seconds, arguments.opposite, folder)
        for seed in range(arguments.seeds)
        for case in wanted_cases(all_cases(arguments.cloud, ALL_OBJECTS), arguments)
    ]
    _run(run_carry, jobs, CARRY_FILE, lambda e: str(e["key"]), describe_carry, arguments)
    entries = read_lines(arguments.output / CARRY_FILE)
    say(carry_table(entries))
    tried = [entry for entry in entries if not entry["failure"]]
    return int(any(e["free"]["found"] > e["limited"]["found"] for e in tried))


def _run_paper(arguments: argparse.Namespace) -> int:
    preset = PRESETS[arguments.preset]
    preset = replace(preset, cases=wanted_cases(preset.cases, arguments))
    if arguments.seeds is not None:
        seeds = arguments.seeds
        preset = replace(preset, seeds=seeds, baseline_seeds=min(seeds, preset.baseline_seeds))
    if arguments.seconds is not None:
        preset = replace(preset, seconds=arguments.seconds)
    trials = preset_trials(preset, arguments.variant or PAPER_VARIANTS)
    records = _run_trials(trials, RUNS_FILE, arguments=arguments)
    failed = sum(not record["solutions"] for record in records)
    say(f"{failed} runs without a placement; recorded in {arguments.output / RUNS_FILE}")
    return 0


def _run_yardstick(arguments: argparse.Namespace) -> int:
    """Objectives of one scene and object share the grid; those that are recorded are left out."""
    known = {yardstick_key(entry) for entry in read_lines(arguments.output / YARDSTICK_FILE)}
    wanted: dict[tuple[str, str], list[str]] = {}
    for case in wanted_cases(PRESETS[arguments.preset].cases, arguments):
        if str(case) not in known:
            wanted.setdefault((case.scene, case.object), []).append(case.objective)
    resolution = GridResolution(arguments.step / 1000.0, math.radians(arguments.turn))
    jobs = [
        YardstickJob(scene, name, tuple(objectives), resolution, arguments.seconds)
        for (scene, name), objectives in wanted.items()
    ]
    say(f"{len(known)} cases are recorded in {arguments.output / YARDSTICK_FILE}")
    _run(measure, jobs, YARDSTICK_FILE, None, describe_yardstick, arguments)
    return 0


def _run_scaling(arguments: argparse.Namespace) -> int:
    jobs = scaling_jobs(arguments.seeds, arguments.seconds, tuple(arguments.axis or ()))
    _run(run_scaling_job, jobs, SCALING_FILE, scaling_key, describe_scaling, arguments)
    from benchmarks.scaling.report import draw_scaling

    picture = arguments.output / "scaling.png"
    picture.write_bytes(draw_scaling(growths(read_lines(arguments.output / SCALING_FILE))))
    say(f"wrote {picture}")
    return 0


def _run_report(arguments: argparse.Namespace) -> int:
    from benchmarks.evaluation.report import write_report

    yardstick = arguments.yardstick or arguments.folder / YARDSTICK_FILE
    results = Results.read(arguments.folder / RUNS_FILE, yardstick)
    scaling = read_lines(arguments.folder / SCALING_FILE)
    for path in write_report(results, arguments.folder, not arguments.no_pictures, scaling):
        say(f"wrote {path}")
    return 0
