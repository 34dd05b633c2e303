"""One run of the planner in one situation, and what it said, as a JSON line."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cases import build_problem, inputs_of
from benchmarks.record import RecordedRun, failure_of, save_placement, warm_process
from benchmarks.situations.catalogue import situation_by_name
from benchmarks.situations.observing import observe
from benchmarks.situations.situation import Cloud, Situation
from placement_planner_ros.core.objective.objective import Objective
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem

OBJECTIVE = "maximize_clearance"
RUNS_FILE, SOLUTIONS = "situations.jsonl", "solutions"
OUTCOMES = "right", "possible, not found", "placed though impossible", "failed"


@dataclass(frozen=True, slots=True)
class SituationJob:
    """What is to be run.

    Attributes:
        seed: draws the situation's sizes, the cloud's noise and the search.
        time_limit: seconds of processor time, the environment's construction included.
        enough: placements after which the run ends.
        solutions: folder where each placement is written.
    """

    name: str
    cloud: Cloud
    seed: int
    time_limit: float
    enough: int
    solutions: Path

    @property
    def work(self) -> float:
        """Seconds at most."""
        return self.time_limit

    @property
    def key(self) -> str:
        """Tells jobs apart."""
        return f"{self.name}-{self.cloud}-{self.seed}"


def job_key(entry: Mapping[str, Any]) -> str:
    """Of the job that an entry is of."""
    return f"{entry['name']}-{entry['cloud']}-{entry['seed']}"


def situation_problem(
    situation: Situation, cloud: Cloud, rng: np.random.Generator
) -> tuple[Problem, Objective]:
    """The task as a node would have it.

    Args:
        rng: noise of the camera.
    """
    seen = observe(situation, cloud, rng)
    inputs = inputs_of(situation.thing, situation.scene.volume, seen.points)
    below = situation.unknown == "occupied_below"
    if situation.unknown == "free":
        return build_problem(inputs, OBJECTIVE, sights=seen.sights)
    return build_problem(inputs, OBJECTIVE, lambda e: e.with_unknown(below), sights=seen.sights)


def run_situation(job: SituationJob) -> dict[str, Any]:
    """The situation, its true answer and the `RecordedRun` as plain values; errors are in it.

    Further keys: possible (the true answer), pose_exists (whether the object could stand there,
    robot or not) and why.
    """
    warm_process()
    situation = situation_by_name(job.name, job.seed)
    run = RecordedRun(job.seed, job.time_limit)
    run.failure = failure_of(_place_object, job, situation, run) or run.failure
    return {
        "name": job.name,
        "group": situation.group,
        "thing": situation.thing,
        "cloud": job.cloud,
        "support": situation.support,
        "why": _why_of(situation, job.cloud),
        "possible": situation.possible(job.cloud),
        "pose_exists": situation.pose_exists,
        **asdict(run),
    }


def _place_object(job: SituationJob, situation: Situation, run: RecordedRun) -> None:
    rng = np.random.default_rng(job.seed)
    started = time.process_time()
    problem, objective = situation_problem(situation, job.cloud, rng)
    settings = PlannerSettings(support=situation.support)
    for placement in run.follow(PlacementPlanner(problem, objective, settings, rng), started):
        path = job.solutions / f"{job.key}-{len(run.solutions)}.npz"
        save_placement(path, placement, situation=json.dumps([job.name, job.seed, job.cloud]))
        if len(run.solutions) == job.enough:
            break


def _why_of(situation: Situation, cloud: Cloud) -> str:
    unseen = situation.unseen if cloud == "camera" else ""
    return "; but ".join(words for words in (situation.why, unseen) if words)


def outcome(entry: Mapping[str, Any]) -> str:
    """One of `OUTCOMES`."""
    right, missed, wrong, failed = OUTCOMES
    if not entry["solutions"] and entry["failure"].startswith("Traceback"):
        return failed
    if bool(entry["solutions"]) == entry["possible"]:
        return right
    return missed if entry["possible"] else wrong


def describe_situation(entry: Mapping[str, Any]) -> str:
    """One line for the terminal."""
    said = "placed" if entry["solutions"] else "exhausted" if entry["exhausted"] else "nothing"
    took = entry["solutions"][0]["time"] if entry["solutions"] else entry["elapsed"]
    words = "" if entry["solutions"] else entry["failure"].strip().splitlines()[-1][:110]
    return (
        f"{entry['name']:<34} {entry['cloud']:<8} {outcome(entry):<24} {said:<9} {took:5.2f} s "
        f"{entry['samples']:7d} samples  {words}"
    )
