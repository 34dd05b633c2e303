"""`python -m benchmarks clouds`: the bundled objects on the tables of real clouds."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from benchmarks.cases import in_words
from benchmarks.household import HOUSEHOLD, OBJECT_NAMES
from benchmarks.jobs import say
from benchmarks.machine import versions
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
    clouds.add_argument("folder", type=Path, help="with PLY files, each of a table")
    clouds.add_argument("--seconds", type=float, default=5.0, help="processor time of a run")
    clouds.add_argument("--seed", type=int, default=0)
    clouds.add_argument("--object", choices=OBJECT_NAMES + HOUSEHOLD, action="append")
    clouds.add_argument("--output", type=Path, default=Path("results/clouds"))
    clouds.set_defaults(command_function=run_clouds)


def run_clouds(arguments: argparse.Namespace) -> int:
    """Place each object on each cloud; 1 where one was not placed.

    Raises:
        ParameterError: the folder holds no cloud, or one without a table.
    """
    files = sorted(arguments.folder.glob("*.ply"))
    if not files:
        raise ParameterError("folder", str(arguments.folder), "holds no .ply files")
    warm_process()
    arguments.output.mkdir(parents=True, exist_ok=True)
    placed, rows = 0, []
    for file in files:
        measured: Any = trimesh.load(file)
        cloud = on_table(np.asarray(measured.vertices), np.random.default_rng(arguments.seed))
        for thing in arguments.object or OBJECT_NAMES + HOUSEHOLD:
            run = place_on(cloud, thing, arguments.seconds, arguments.seed)
            placed += run.pose is not None
            rows.append((file.stem, *_row_of(run)))
            say(", ".join(rows[-1]))
    note = f"{placed} of {len(rows)} placed; of commit {versions()['commit']}."
    header = ("cloud", "object", "first placement", "inside it at most", "a foot's nearest point")
    text = TextTable(header, rows, note).markdown()
    (arguments.output / "clouds.md").write_text(text, encoding="utf-8")
    say(note)
    return int(placed < len(rows))


def _row_of(run: RealRun) -> tuple[str, str, str, str]:
    thing = in_words(run.thing)
    if run.pose is None:
        return thing, f"none: {run.failure}", "", ""
    inside, foot = (f"{1e3 * metres:.1f} mm" for metres in (run.deepest, run.farthest))
    return thing, f"{run.seconds:.2f} s", inside, foot
