"""One run of the planner in one situation, and what it said, as a JSON line."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import machine, versions
from benchmarks.record import Solution, save_placement, warm_process
from benchmarks.situations.catalogue import situation_by_name
from benchmarks.situations.observing import observe
from benchmarks.situations.situation import Cloud, Situation
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import Objective, ObjectiveContext
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem, workspace
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.yumi import load_yumi, start_configuration, yumi_arm

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
        solutions: folder where each placement is written, if given.
    """

    name: str
    cloud: Cloud
    seed: int
    time_limit: float
    enough: int = 1
    solutions: Path | None = None

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


@dataclass(slots=True)
class Answer:
    """What the planner said; seconds are of processor time since it had the cloud.

    Attributes:
        possible: the true answer.
        pose_exists: whether the object could stand there, robot or not.
        exhausted: whether the search ended because there is provably nothing.
        failure: why nothing was found, or the error that ended the run.
    """

    name: str
    group: str
    thing: str
    cloud: str
    seed: int
    time_limit: float
    support: str
    why: str
    possible: bool
    pose_exists: bool
    solutions: list[Solution] = field(default_factory=list)
    exhausted: bool = False
    failure: str = ""
    samples: int = 0
    elapsed: float = 0.0
    machine: dict[str, str | int] = field(default_factory=machine)
    versions: dict[str, str] = field(default_factory=versions)


def situation_problem(
    situation: Situation, cloud: Cloud, rng: np.random.Generator
) -> tuple[Problem, Objective]:
    """The task as a node would have it.

    Args:
        rng: noise of the camera.
    """
    robot, thing = load_yumi(), object_by_name(situation.thing)
    arms = tuple(yumi_arm(robot, name, grasps) for name, grasps in thing.grasps.items())
    q_start = robot.configuration(start_configuration(situation.thing))
    body = Body.from_mesh(thing.vertices, thing.triangles, thing.center_of_mass)
    volume = situation.scene.volume
    seen = observe(situation, cloud, rng)
    environment = Environment.from_points(
        seen.points,
        volume,
        bounds=workspace(robot, arms, q_start, body, volume),
        views=() if situation.unknown == "free" else seen.sights,
        sights=seen.sights if situation.unknown == "free" else (),
        unknown_below=situation.unknown == "occupied_below",
        beyond_volume=False,
    )
    problem = Problem(robot, arms, q_start, body, volume, environment)
    return problem, make_objective(OBJECTIVE, ObjectiveContext(environment, volume, body))


def planner_settings(situation: Situation) -> PlannerSettings:
    """The defaults, with the situation's s(x)."""
    return PlannerSettings(support=situation.support)


def run_situation(job: SituationJob) -> dict[str, Any]:
    """The `Answer` as a dictionary of plain values; errors are in it, not raised."""
    warm_process()
    situation = situation_by_name(job.name, job.seed)
    answer = Answer(
        job.name,
        situation.group,
        situation.thing,
        job.cloud,
        job.seed,
        job.time_limit,
        situation.support,
        _why(situation, job.cloud),
        situation.possible(job.cloud),
        situation.pose_exists,
    )
    try:
        _run(job, situation, answer)
    except Exception:
        answer.failure = traceback.format_exc()
    return asdict(answer)


def _run(job: SituationJob, situation: Situation, answer: Answer) -> None:
    rng = np.random.default_rng(job.seed)
    started = time.process_time()
    problem, objective = situation_problem(situation, job.cloud, rng)
    planner = PlacementPlanner(problem, objective, planner_settings(situation), rng)
    for placement in planner.run(lambda: time.process_time() - started > job.time_limit):
        answer.solutions.append(Solution.of(placement, time.process_time() - started))
        if job.solutions is not None:
            path = job.solutions / f"{job.key}-{len(answer.solutions)}.npz"
            save_placement(path, placement, situation=json.dumps([job.name, job.seed, job.cloud]))
        if len(answer.solutions) == job.enough:
            break
    answer.elapsed = time.process_time() - started
    answer.samples = planner.statistics.samples
    answer.exhausted = bool(planner.exhausted)
    if not answer.solutions:
        answer.failure = planner.exhausted or planner.explain().short


def _why(situation: Situation, cloud: Cloud) -> str:
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


def describe(entry: Mapping[str, Any]) -> str:
    """One line for the terminal."""
    said = "placed" if entry["solutions"] else "exhausted" if entry["exhausted"] else "nothing"
    took = entry["solutions"][0]["time"] if entry["solutions"] else entry["elapsed"]
    words = "" if entry["solutions"] else entry["failure"].strip().splitlines()[-1][:110]
    return (
        f"{entry['name']:<34} {entry['cloud']:<8} {outcome(entry):<24} {said:<9} {took:5.2f} s "
        f"{entry['samples']:7d} samples  {words}"
    )
