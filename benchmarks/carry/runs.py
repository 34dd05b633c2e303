"""Runs with a limit on the tilt, each beside one with the same rests and no limit on the way."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.carry.starts import upright_task
from benchmarks.cases import Case, boxes_ready, build_problem, read_inputs
from benchmarks.record import RecordedRun, failure_of, last_line, save_placement, warm_process
from benchmarks.text_table import TextTable
from placement_planner_ros.core.carry.settings import CarrySettings
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.wishes.settings import TurnSettings

RUNS_FILE = "carry.jsonl"
SOLUTIONS = "carry"


@dataclass(frozen=True, slots=True)
class CarryJob:
    """A case with a limit.

    Attributes:
        degrees: `carry.max_tilt`.
        seconds: of processor time of either run, the environment's construction included.
        opposite: see `upright_task`.
        solutions: folder of the limited runs' first placements.
    """

    case: Case
    seed: int
    degrees: float
    seconds: float
    opposite: bool
    solutions: Path

    @property
    def work(self) -> float:
        """Seconds at most."""
        return 2.0 * self.seconds

    @property
    def key(self) -> str:
        """Tells jobs apart."""
        turned = " opposite" if self.opposite else ""
        return f"{self.case} {self.seed} {self.degrees:g}{turned} {self.seconds:g}"


def run_carry(job: CarryJob) -> dict[str, Any]:
    """Both runs as a dictionary of plain values; errors are in it, not raised."""
    entry: dict[str, Any] = asdict(job.case) | {
        "key": job.key,
        "seed": job.seed,
        "degrees": job.degrees,
        "opposite": job.opposite,
        "failure": "",
    }
    entry["failure"] = failure_of(_run_both, job, entry) or entry["failure"]
    return entry


def _run_both(job: CarryJob, entry: dict[str, Any]) -> None:
    warm_process()
    inputs = read_inputs(job.case, np.random.default_rng(job.seed))
    began = time.process_time()
    problem, objective = build_problem(inputs, job.case.objective)
    boxes_ready(problem)
    entry["environment"] = time.process_time() - began
    task = upright_task(problem, objective, job.seed, job.opposite)
    if task is None:
        entry["failure"] = "no start"
        return
    upright, up = task
    turns = TurnSettings(up=tuple(up.tolist()))
    free = PlannerSettings(turns=turns)
    limited = replace(free, carry=CarrySettings(max_tilt=math.radians(job.degrees)))
    for name, settings in (("free", free), ("limited", limited)):
        run = RecordedRun(job.seed, job.seconds)
        started = time.process_time() - entry["environment"]
        rng = np.random.default_rng(job.seed)
        planner = PlacementPlanner(upright, objective, settings, rng)
        first = next(run.follow(planner, started), None)
        entry[name] = {"time": run.elapsed, "found": first is not None, "why": run.failure}
        if first is not None:
            entry[name]["duration"] = first.trajectory.duration
        if first is not None and settings is limited:
            arm = upright.arms[0]
            save_placement(
                solution_file(job.solutions, entry),
                first,
                q_start=upright.q_start,
                up=up,
                T_tip_object=arm.grasps[0].homogeneous,
                tip_frame=arm.tip_frame,
            )


def solution_file(folder: Path, entry: Mapping[str, Any]) -> Path:
    """Where the first placement of the limited run is."""
    return folder / f"{str(entry['key']).replace('/', '-').replace(' ', '_')}.npz"


def describe_carry(entry: Mapping[str, Any]) -> str:
    """A run in a line."""
    if entry["failure"]:
        return f"{entry['key']}: {last_line(entry['failure'])}"
    times = [
        f"{name} {entry[name]['time']:.2f} s" if entry[name]["found"] else f"{name}: nothing"
        for name in ("free", "limited")
    ]
    return f"{entry['key']}: {', '.join(times)}"


def carry_table(entries: Sequence[Mapping[str, Any]]) -> str:
    """A row for each limit and kind of start, as Markdown."""
    rows = []
    for degrees, opposite in sorted({(e["degrees"], e["opposite"]) for e in entries}, reverse=True):
        kind = [e for e in entries if (e["degrees"], e["opposite"]) == (degrees, opposite)]
        made = [e for e in kind if not e["failure"]]
        both = [e for e in made if e["free"]["found"] and e["limited"]["found"]]
        if not both:
            continue
        free, limited = (np.array([e[name]["time"] for e in both]) for name in ("free", "limited"))
        moved = [np.median([e[name]["duration"] for e in both]) for name in ("free", "limited")]
        environment = np.array([e["environment"] for e in both])
        ratios = (limited / free, (limited - environment) / (free - environment))
        rows.append(
            (
                f"{degrees:g}°",
                "opposite" if opposite else "near",
                str(len(made)),
                *(str(sum(e[name]["found"] for e in made)) for name in ("free", "limited")),
                f"{np.median(free):.2f}",
                f"{np.median(limited):.2f}, {limited.max():.2f}",
                *(f"{np.median(r):.2f}, {np.quantile(r, 0.95):.2f}" for r in ratios),
                f"{moved[0]:.1f}, {moved[1]:.1f}",
            )
        )
    header = (
        "limit", "starts", "runs", "solved without a limit", "solved with it",
        "first placement without, s: median", "with, s: median, worst", "ratio: median, 95 %",
        "ratio of the searches alone", "motions, s: without, with",
    )  # fmt: skip
    return TextTable(header, rows).markdown()
