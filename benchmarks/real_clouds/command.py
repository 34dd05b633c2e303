"""`python -m benchmarks clouds`: the bundled objects on the tables of real clouds."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cases import in_words
from benchmarks.household import HOUSEHOLD, OBJECT_NAMES
from benchmarks.jobs import say
from benchmarks.machine import versions
from benchmarks.real_clouds.pcd_file import read_pcd
from benchmarks.real_clouds.runs import RealRun, place_on
from benchmarks.real_clouds.table import on_table
from benchmarks.record import warm_process
from benchmarks.text_table import TextTable
from placement_planner_ros.core.errors import ParameterError


def add_clouds_command(commands: Any) -> None:
    """Add `clouds`, which sets `command_function`.

    Args:
        commands: what `ArgumentParser.add_subparsers` returned.
    """
    clouds = commands.add_parser("clouds", help="bundled objects on the tables of real clouds")
    clouds.add_argument("folder", type=Path, help="with PCD files, each of a table")
    clouds.add_argument("--seconds", type=float, default=5.0, help="processor time of a run")
    clouds.add_argument("--seed", type=int, default=0)
    clouds.add_argument("--object", choices=OBJECT_NAMES + HOUSEHOLD, action="append")
    clouds.add_argument("--output", type=Path, default=Path("results/clouds"))
    clouds.set_defaults(command_function=run_clouds)


def run_clouds(arguments: argparse.Namespace) -> int:
    """Place each object on each cloud, and draw them; 1 where one was not placed.

    Raises:
        ParameterError: the folder holds no cloud, or one without a table.
    """
    from benchmarks.drawing.cloud_picture import draw_real_cloud

    files = sorted(arguments.folder.glob("*.pcd"))
    if not files:
        raise ParameterError("folder", str(arguments.folder), "holds no .pcd files")
    warm_process()
    arguments.output.mkdir(parents=True, exist_ok=True)
    every: list[RealRun] = []
    rows = []
    for file in files:
        cloud = on_table(read_pcd(file), np.random.default_rng(arguments.seed))
        runs = []
        for thing in arguments.object or OBJECT_NAMES + HOUSEHOLD:
            runs.append(place_on(cloud, thing, arguments.seconds, arguments.seed))
            rows.append((file.stem, *_row_of(runs[-1])))
            say(", ".join(rows[-1]))
        picture = arguments.output / f"cloud_{file.stem}.png"
        draw_real_cloud(picture, cloud, runs, file.name)
        say(f"wrote {picture}")
        every += runs
    placed = sum(run.pose is not None for run in every)
    note = f"{placed} of {len(every)} placed; of commit {versions()['commit']}."
    header = ("cloud", "object", "first placement", "inside it at most", "a foot's nearest point")
    text = TextTable(header, rows, note).markdown()
    (arguments.output / "clouds.md").write_text(text, encoding="utf-8")
    say(note)
    return int(placed < len(every))


def _row_of(run: RealRun) -> tuple[str, str, str, str]:
    thing = in_words(run.thing)
    if run.pose is None:
        return thing, f"none: {run.failure}", "", ""
    inside, foot = (f"{1e3 * metres:.1f} mm" for metres in (run.deepest, run.farthest))
    return thing, f"{run.seconds:.2f} s", inside, foot
