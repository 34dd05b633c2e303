"""Runs with a limit on the tilt, each beside one with the same rests and no limit on the way."""

from __future__ import annotations

import math
import time
import traceback
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.carry.starts import UprightTask, upright_task
from benchmarks.cases import Case, build_problem, read_inputs
from benchmarks.record import boxes_ready, warm_process
from placement_planner_ros.core.carry.settings import CarrySettings
from placement_planner_ros.core.objective.objective import Objective
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.types import Placement
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
    entry: dict[str, Any] = {
        "key": job.key,
        "scene": job.case.scene,
        "object": job.case.object,
        "objective": job.case.objective,
        "seed": job.seed,
        "degrees": job.degrees,
        "opposite": job.opposite,
        "failure": "",
    }
    try:
        _run(job, entry)
    except Exception:
        entry["failure"] = traceback.format_exc()
    return entry


def _run(job: CarryJob, entry: dict[str, Any]) -> None:
    warm_process()
    started = time.process_time()
    inputs = read_inputs(job.case, np.random.default_rng(job.seed))
    began = time.process_time()
    problem, objective = build_problem(inputs, job.case.objective)
    boxes_ready(problem)
    environment = time.process_time() - began
    task = upright_task(problem, objective, job.seed, job.opposite)
    if task is None:
        entry["failure"] = "no start"
        return
    entry |= {
        "arm": task.arm,
        "grasp": task.grasp,
        "up": task.up.tolist(),
        "start_tilt": math.degrees(task.tilt),
        "turned": task.turned,
        "made": time.process_time() - started,
        "environment": environment,
    }
    turns = TurnSettings(up=tuple(task.up.tolist()))
    free = PlannerSettings(turns=turns)
    limited = replace(free, carry=CarrySettings(max_tilt=math.radians(job.degrees)))
    for name, settings in (("free", free), ("limited", limited)):
        seconds, first, why = _first(task, objective, settings, job, environment)
        entry[name] = {"time": seconds, "found": first is not None, "why": why}
        if first is not None:
            entry[name]["duration"] = first.trajectory.duration
        if first is not None and settings is limited:
            _save(job, task, first)


def _first(
    task: UprightTask,
    objective: Objective,
    settings: PlannerSettings,
    job: CarryJob,
    environment: float,
) -> tuple[float, Placement | None, str]:
    """Seconds of processor time until the first placement, that, and why there is none."""
    began = time.process_time() - environment
    planner = PlacementPlanner(task.problem, objective, settings, np.random.default_rng(job.seed))
    search = planner.run(lambda: time.process_time() - began > job.seconds)
    first = next(search, None)
    seconds = time.process_time() - began
    return seconds, first, "" if first is not None else planner.explain().short


def solution_file(folder: Path, entry: Mapping[str, Any]) -> Path:
    """Where the first placement of the limited run is."""
    return folder / f"{str(entry['key']).replace('/', '-').replace(' ', '_')}.npz"


def _save(job: CarryJob, task: UprightTask, placement: Placement) -> None:
    job.solutions.mkdir(parents=True, exist_ok=True)
    trajectory = placement.trajectory
    np.savez(
        solution_file(job.solutions, {"key": job.key}),
        q_start=task.problem.q_start,
        up=task.up,
        T_tip_object=task.problem.arms[0].grasps[0].homogeneous,
        tip_frame=task.problem.arms[0].tip_frame,
        pose=placement.T_world_object.homogeneous,
        approach_start=placement.approach_start,
        objective=placement.objective,
        joints=np.array(trajectory.joints),
        times=trajectory.times,
        positions=trajectory.positions,
        velocities=trajectory.velocities,
        accelerations=trajectory.accelerations,
    )


def describe(entry: Mapping[str, Any]) -> str:
    """A run in a line."""
    if entry["failure"]:
        return f"{entry['key']}: {entry['failure'].splitlines()[-1]}"
    times = [
        f"{name} {entry[name]['time']:.2f} s" if entry[name]["found"] else f"{name}: nothing"
        for name in ("free", "limited")
    ]
    return f"{entry['key']}: {', '.join(times)}"
