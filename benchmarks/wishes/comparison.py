"""What a search for a weighted objective comes to, and what a dense search finds."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.cases import Case, boxes_ready, build_problem, read_inputs
from benchmarks.record import RecordedRun, failure_of, last_line, warm_process
from benchmarks.text_table import TextTable
from benchmarks.wishes.mixtures import MIXTURES, wishes
from benchmarks.yardstick.dense_search import DenseSearch, sampled_placements
from benchmarks.yardstick.placement_grid import GridPlacements, GridResolution, grid_placements
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import evaluate_batch
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.types import Array

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

    Keys: case; mixture; best (ξ of the dense search, None where nothing was reached), complete
    (whether no better pose of the grid was left untried) and best_free_pose; random (median ξ of
    random feasible placements); runs: for each seed ξ at its end, when that was found, the number
    of placements and of samples; failure.
    """
    entry: dict[str, Any] = {"case": asdict(job.case), "mixture": job.mixture}
    return entry | {"failure": failure_of(_run_all, job, entry)}


def _run_all(job: WishesJob, entry: dict[str, Any]) -> None:
    warm_process()
    inputs = read_inputs(job.case, np.random.default_rng(0))
    began = time.process_time()
    problem, _ = build_problem(inputs, job.case.objective)
    boxes_ready(problem)
    environment = time.process_time() - began
    settings = PlannerSettings(wishes=wishes(job.mixture, job.case.objective, inputs.volume))
    entry["runs"] = []
    for seed in job.seeds:
        run = RecordedRun(seed, job.seconds)
        started = time.process_time() - environment
        for _ in run.follow(_weighted_planner(problem, settings, seed), started):
            pass
        last = run.solutions[-1] if run.solutions else None
        entry["runs"].append(
            {
                "seed": seed,
                "best": last and last.objective,
                "found_after": last and last.time,
                "placements": len(run.solutions),
                "samples": run.samples,
            }
        )
    entry |= _dense_yardstick(problem, settings, job)


def _weighted_planner(problem: Problem, settings: PlannerSettings, seed: int) -> PlacementPlanner:
    """A planner with an objective of its own, as that learns."""
    context = settings.context(problem.environment, problem.volume, problem.body)
    objective = make_objective("weighted", context)
    return PlacementPlanner(problem, objective, settings, np.random.default_rng(seed))


def _dense_yardstick(problem: Problem, settings: PlannerSettings, job: WishesJob) -> dict[str, Any]:
    uniform = _weighted_planner(problem, replace(settings, sampler="uniform"), 0)
    random = sampled_placements(uniform, _RANDOM, job.dense_seconds)
    context = settings.context(problem.environment, problem.volume, problem.body)
    objective = make_objective("weighted", context)
    placements = grid_placements(problem, job.resolution, settings)
    poses = poses_of(problem, placements)
    parts = [
        evaluate_batch(objective, poses[k : k + _AT_ONCE]) for k in range(0, len(poses), _AT_ONCE)
    ]
    values = np.concatenate([np.zeros(0), *parts])
    search = DenseSearch(problem, objective, settings, placements, values)
    return search.best(job.dense_seconds) | {
        "random": float(np.median(random)) if len(random) else None
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
        return f"{entry['key']}: {last_line(entry['failure'])}"
    shown = ["none" if b is None else f"{b:+.3f}" for b in (entry["best"], entry["random"])]
    runs = ", ".join("none" if r["best"] is None else f"{r['best']:+.3f}" for r in entry["runs"])
    cut = "" if entry["complete"] else " (cut off)"
    return f"{entry['key']}: dense {shown[0]}{cut}, random {shown[1]}, runs {runs}"


def relative_objectives(entry: Mapping[str, Any]) -> list[float]:
    """Of each run: 0 is a random placement, 1 the best of the dense search and of the runs; a run
    without a placement counts as 0. Empty where the dense search has nothing to compare with."""
    found = [run["best"] for run in entry["runs"] if run["best"] is not None]
    random = entry["random"]
    if entry["best"] is None or random is None:
        return []
    best = max([entry["best"], *found])
    if best - random < 1e-6:
        return []
    return [
        0.0 if run["best"] is None else max(0.0, (run["best"] - random) / (best - random))
        for run in entry["runs"]
    ]


def wishes_table(entries: Sequence[Mapping[str, Any]]) -> str:
    """A row for each mixture and one of all, as Markdown."""
    rows = []
    made = [entry for entry in entries if not entry["failure"]]
    for name in (*MIXTURES, "all"):
        of = [entry for entry in made if name in (entry["mixture"], "all")]
        values = np.array([value for entry in of for value in relative_objectives(entry)])
        if len(values):
            numbers = len(of), len(values), f"{values.mean():.3f}", f"{values.min():.3f}"
            good, cut_off = int((values >= 0.95).sum()), sum(not e["complete"] for e in of)
            rows.append([name, *map(str, (*numbers, good, cut_off))])
    header = (
        "mixture", "cases", "runs", "mean relative objective", "worst", "runs above 0.95",
        "dense search cut off",
    )  # fmt: skip
    return TextTable(header, rows).markdown()
