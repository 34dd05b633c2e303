"""What a search for a weighted objective comes to, and what a dense search finds."""

from __future__ import annotations

import time
import traceback
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.cases import Case, build_problem, read_inputs
from benchmarks.record import boxes_ready, warm_process
from benchmarks.wishes.mixtures import wishes
from benchmarks.yardstick.dense_search import DenseSearch, sampled_placements
from benchmarks.yardstick.placement_grid import GridPlacements, GridResolution, grid_placements
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import evaluate_batch
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.types import Array

_IK_SEEDS = 32
_RANDOM = 50
"""Feasible placements drawn for the median."""
_AT_ONCE = 4096


@dataclass(frozen=True, slots=True)
class WishesJob:
    """A case with a mixture.

    Attributes:
        seeds: of the runs.
        seconds: of processor time of a run, the environment's construction included.
        dense_seconds: of processor time for reaching the best poses of the grid.
    """

    case: Case
    mixture: str
    seeds: tuple[int, ...]
    seconds: float
    dense_seconds: float
    resolution: GridResolution = field(default_factory=GridResolution)

    @property
    def work(self) -> float:
        """Seconds at most, about."""
        return self.seconds * len(self.seeds) + 2.0 * self.dense_seconds

    @property
    def key(self) -> str:
        """Tells jobs apart."""
        return f"{self.case} {self.mixture}"


def run_wishes(job: WishesJob) -> dict[str, Any]:
    """Runs and yardstick as a dictionary of plain values; errors are in it, not raised.

    Keys: key; case; mixture; best (ξ of the dense search, None where nothing was reached), complete
    (whether no better pose of the grid was left untried) and best_free_pose; random (median ξ of
    random feasible placements); runs: for each seed ξ at its end, when that was found, the number
    of placements and of samples; failure.
    """
    entry: dict[str, Any] = {
        "key": job.key,
        "case": asdict(job.case),
        "mixture": job.mixture,
        "failure": "",
    }
    try:
        _run(job, entry)
    except Exception:
        entry["failure"] = traceback.format_exc()
    return entry


def _run(job: WishesJob, entry: dict[str, Any]) -> None:
    warm_process()
    inputs = read_inputs(job.case, np.random.default_rng(0))
    began = time.process_time()
    problem, _ = build_problem(inputs, job.case.objective)
    boxes_ready(problem)
    environment = time.process_time() - began
    settings = PlannerSettings(wishes=wishes(job.mixture, job.case.objective, inputs.volume))
    entry["runs"] = [_search(problem, settings, seed, job, environment) for seed in job.seeds]
    entry |= _yardstick(problem, settings, job)


def _search(
    problem: Problem, settings: PlannerSettings, seed: int, job: WishesJob, environment: float
) -> dict[str, Any]:
    began = time.process_time() - environment
    planner = _planner(problem, settings, seed)
    best, found_after, number = None, None, 0
    for placement in planner.run(lambda: time.process_time() - began > job.seconds):
        best, found_after = placement.objective, time.process_time() - began
        number += 1
    return {
        "seed": seed,
        "best": best,
        "found_after": found_after,
        "placements": number,
        "samples": planner.statistics.samples,
    }


def _planner(problem: Problem, settings: PlannerSettings, seed: int) -> PlacementPlanner:
    """A planner with an objective of its own, as that learns."""
    context = settings.context(problem.environment, problem.volume, problem.body)
    objective = make_objective("weighted", context)
    return PlacementPlanner(problem, objective, settings, np.random.default_rng(seed))


def _yardstick(problem: Problem, settings: PlannerSettings, job: WishesJob) -> dict[str, Any]:
    uniform = _planner(problem, replace(settings, sampler="uniform"), 0)
    random = sampled_placements(uniform, _RANDOM, job.dense_seconds)
    context = settings.context(problem.environment, problem.volume, problem.body)
    objective = make_objective("weighted", context)
    placements = grid_placements(problem, job.resolution, settings)
    poses = poses_of(problem, placements)
    parts = [
        evaluate_batch(objective, poses[k : k + _AT_ONCE]) for k in range(0, len(poses), _AT_ONCE)
    ]
    values = np.concatenate([np.zeros(0), *parts])
    rng = np.random.default_rng(0)
    search = DenseSearch(problem, objective, settings, rng, placements, values, _IK_SEEDS)
    best, complete = search.best(job.dense_seconds)
    return {
        "best": None if best is None else best.objective,
        "complete": complete,
        "best_free_pose": float(values.max()) if len(values) else None,
        "random": float(np.median(random)) if len(random) else None,
        "free_poses": len(values),
    }


def poses_of(problem: Problem, placements: GridPlacements) -> Array:
    """(m, 4, 4) T(R_z(θ), contact) · fT_o of the placements of a grid."""
    faces = problem.body.faces
    T_face_object = np.array([face.T_face_object.homogeneous for face in faces])
    turned = np.tile(np.eye(4), (len(placements.face), 1, 1))
    turned[:, 0, 0] = turned[:, 1, 1] = np.cos(placements.angle)
    turned[:, 1, 0] = np.sin(placements.angle)
    turned[:, 0, 1] = -turned[:, 1, 0]
    turned[:, :3, 3] = placements.contact
    return np.asarray(turned @ T_face_object[placements.face])


def describe_wishes(entry: Mapping[str, Any]) -> str:
    """A job in a line."""
    if entry["failure"]:
        return f"{entry['key']}: {entry['failure'].splitlines()[-1]}"
    shown = ["none" if b is None else f"{b:+.3f}" for b in (entry["best"], entry["random"])]
    runs = ", ".join("none" if r["best"] is None else f"{r['best']:+.3f}" for r in entry["runs"])
    cut = "" if entry["complete"] else " (cut off)"
    return f"{entry['key']}: dense {shown[0]}{cut}, random {shown[1]}, runs {runs}"
