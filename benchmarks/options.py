"""Options that several commands share."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path

from benchmarks.cases import OBJECTIVES, PARTS, Case
from benchmarks.household import ALL_OBJECTS, OBJECT_NAMES
from placement_planner_ros.scenes.scenes import SCENE_NAMES


def add_case_options(parser: argparse.ArgumentParser) -> None:
    """`--scene`, `--object` and `--objective`, each to be given several times."""
    for name, choices in (
        ("--scene", (*SCENE_NAMES, *PARTS)),
        ("--object", ALL_OBJECTS),
        ("--objective", OBJECTIVES),
    ):
        parser.add_argument(name, choices=choices, action="append")


def wanted_cases(cases: Iterable[Case], arguments: argparse.Namespace) -> tuple[Case, ...]:
    """Those that the case options let pass; all of the paper's objects where none is given."""
    return tuple(
        case
        for case in cases
        if case.scene in (arguments.scene or [case.scene])
        and case.object in (arguments.object or OBJECT_NAMES)
        and case.objective in (arguments.objective or OBJECTIVES)
    )


def add_job_options(parser: argparse.ArgumentParser, folder: str) -> None:
    """`--processes` and `--output`."""
    parser.add_argument("--processes", type=int, default=1, help="that share the runs")
    parser.add_argument("--output", type=Path, default=Path(folder))


def add_table_options(
    parser: argparse.ArgumentParser, folder: str | None, rows: Sequence[str] = ()
) -> None:
    """`--page` and `--report-only`; `--rows` and `--output` where there are rows and a folder."""
    if rows:
        parser.add_argument(
            "--rows", nargs="+", choices=rows, default=rows,
            help="only these; what the folder holds of others is kept",
        )  # fmt: skip
    if folder is not None:
        parser.add_argument("--output", type=Path, default=Path(folder))
    parser.add_argument("--page", type=Path, help="a page: replace what is between its marks")
    parser.add_argument("--report-only", action="store_true", help="show what the folder holds")
