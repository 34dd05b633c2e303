"""Rows measured in whole runs of the planner: sampling, and the first placement."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from placement_planner_ros.core.collision.boxes import box_arrays
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.search.sampler import GoalSampler
from placement_planner_ros.core.types import Goal, Placement
from placement_planner_ros.experiments.cases import Case, build_problem, make_problem, read_inputs
from placement_planner_ros.experiments.record import Record, Solution, save_solution
from placement_planner_ros.experiments.speed.queries import Entry

MakePlanner = Callable[..., PlacementPlanner]


class _TimedSampler:
    """A sampler, and the seconds of processor time spent in it."""

    def __init__(self, sampler: GoalSampler) -> None:
        self.count = sampler.count
        self.seconds = 0.0
        self._sampler = sampler

    def sample_goals(self, best: float, should_stop: Callable[[], bool]) -> list[Goal]:
        began = time.process_time()
        goals = self._sampler.sample_goals(best, should_stop)
        self.seconds += time.process_time() - began
        return goals


def measure_sampling(case: Case, seed: int, seconds: float) -> Entry:
    """Goal samples tried per second of SampleGoals in a run, its choice of where included.

    The time is that spent in `sample_goals`: s(x), c_f(x), ξ(x), inverse kinematics and C_free,
    and for the few that pass them release, approach and retreat.

    Args:
        seconds: CPU time of the run.
    """
    rng = np.random.default_rng(seed)
    problem, objective = make_problem(case, rng)
    planner = PlacementPlanner(problem, objective, PlannerSettings(), rng)
    timed = planner.sampler = _TimedSampler(planner.sampler)
    started = time.process_time()
    placements = 0
    for _ in planner.run(lambda: time.process_time() - started > seconds):
        placements += 1
    statistics = planner.statistics
    return {
        "row": "samples",
        "case": str(case),
        "samples": statistics.samples,
        "seconds": timed.seconds,
        "run_seconds": time.process_time() - started,
        "rejected": statistics.rejected,
        "goals": statistics.goals,
        "placements": placements,
    }


def measure_first(
    case: Case,
    seed: int,
    limit: float,
    folder: Path,
    make: MakePlanner = PlacementPlanner,
    row: str = "first",
    register: Callable[[Problem], object] = lambda problem: None,
) -> tuple[Entry, Record]:
    """Seconds (wall time) from the start call's inputs to the first placement.

    The clock starts when robot, object and cloud are there. It is read when the environment is
    built, when the planner is made, and at the first placement.

    Args:
        limit: seconds after the environment is there; a run that has found nothing by then, or
            fails, counts as unsolved.
        folder: where the placement is written, for the checker.
        make: of problem, objective, settings and rng.
        row: name of the entry.
        register: what else belongs to the environment's construction.

    Returns:
        The entry, and the run as `test/verify_cases.py` reads it.
    """
    rng = np.random.default_rng(seed)
    inputs = read_inputs(case, rng)
    gc.collect()
    placement: Placement | None = None
    record = Record(case, seed, limit)
    started, cpu = time.perf_counter(), time.process_time()
    problem, objective = build_problem(inputs, case.objective)
    box_arrays(problem.environment.obstacles)  # as the node does, ahead of the start call
    register(problem)
    built, built_cpu = time.perf_counter(), time.process_time()
    planner = make(problem, objective, PlannerSettings(), rng)
    made = time.perf_counter()
    placement = next(planner.run(lambda: time.perf_counter() - built > limit), None)
    ended, ended_cpu = time.perf_counter(), time.process_time()
    statistics = planner.statistics
    record.preparation, record.samples = made - started, statistics.samples
    record.goals, record.rejected = statistics.goals, statistics.rejected
    if placement is None:
        record.failure = planner.exhausted or statistics.why_nothing()
    else:
        record.solutions.append(Solution.of(placement, ended - started))
        name = f"{str(case).replace('/', '-')}-{seed}-1.npz"
        save_solution(folder / "solutions" / name, case, seed, placement)
    entry = {
        "row": row,
        "case": str(case),
        "seed": seed,
        "limit": limit,
        "solved": placement is not None,
        "environment_seconds": built - started,
        "planner_seconds": made - built,
        "search_seconds": ended - made,
        "environment_cpu_seconds": built_cpu - cpu,
        "cpu_seconds": ended_cpu - built_cpu,
        "samples": statistics.samples,
        "goals": statistics.goals,
        "failure": record.failure,
    }
    return entry, record
