"""Options that several commands share."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

from benchmarks.cases import OBJECTIVES, Case
from placement_planner_ros.scenes.objects import ALL_OBJECTS, OBJECT_NAMES
from placement_planner_ros.scenes.scenes import SCENE_NAMES


def add_case_options(parser: argparse.ArgumentParser) -> None:
    """`--scene`, `--object` and `--objective`, each to be given several times."""
    for name, choices in (
        ("--scene", SCENE_NAMES),
        ("--object", ALL_OBJECTS),
        ("--objective", OBJECTIVES),
    ):
        parser.add_argument(name, choices=choices, action="append")


def wanted_cases(cases: Iterable[Case], arguments: argparse.Namespace) -> tuple[Case, ...]:
    """Those that the case options let pass; all of the paper's objects where none is given."""
    return tuple(
        case
        for case in cases
        if case.scene in (arguments.scene or SCENE_NAMES)
        and case.object in (arguments.object or OBJECT_NAMES)
        and case.objective in (arguments.objective or OBJECTIVES)
    )


def add_job_options(parser: argparse.ArgumentParser, folder: str) -> None:
    """`--processes`, `--dask-scheduler` and `--output`."""
    parser.add_argument("--processes", type=int, default=1, help="on this machine")
    parser.add_argument(
        "--dask-scheduler", metavar="ADDRESS", help="have the workers of a dask cluster do it"
    )
    parser.add_argument("--output", type=Path, default=Path(folder))
