"""Rows measured in searches: sampling, the first placement, and planning to a set of goals."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from benchmarks.baselines.exact_collision import ExactCollision
from benchmarks.baselines.rrt_connect import rrt_connect
from benchmarks.cases import Case, make_problem, read_inputs
from benchmarks.record import RecordedRun, Trial, run_case, save_last, trial_entry
from benchmarks.speed.recorder import GoalSetQuery, Recording
from benchmarks.speed.rows import Entry
from placement_planner_ros.core.plan_motion.transit import MotionPlanner
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.search.sampler import GoalSampler
from placement_planner_ros.core.types import Array, Goal


class TimedSampler:
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


def sampling_rate(planner: PlacementPlanner, seconds: float) -> Entry:
    """Goal samples tried in a run, its choice of where included, and the seconds they took.

    The time is that spent in `sample_goals`: s(x), c_f(x), ξ(x), inverse kinematics and C_free,
    and for the few that pass them release, approach and retreat.

    Args:
        seconds: CPU time of the run.
    """
    timed = planner.sampler = TimedSampler(planner.sampler)
    started = time.process_time()
    for _ in planner.run(lambda: time.process_time() - started > seconds):
        pass
    spent = time.process_time() - started
    return {
        "row": "samples",
        "samples": planner.statistics.samples,
        "seconds": timed.seconds,
        "run_seconds": spent,
        "rejected": planner.statistics.rejected,
        "goals": planner.statistics.goals,
    }


def measure_sampling(case: Case, seed: int, seconds: float) -> Entry:
    """`sampling_rate` of a run of a case."""
    rng = np.random.default_rng(seed)
    problem, objective = make_problem(case, rng)
    planner = PlacementPlanner(problem, objective, PlannerSettings(), rng)
    return sampling_rate(planner, seconds) | {"case": str(case)}


def measure_first(trial: Trial, row: str) -> tuple[Entry, Entry]:
    """Seconds (wall time) from the start call's inputs to the first placement of a trial.

    The clock starts when robot, object and cloud are there. It is read when the environment is
    built, when the planner is made, and at the first placement. A run that has found nothing by its
    limit, or fails, counts as unsolved.

    Args:
        row: name of the entry.

    Returns:
        The entry, and the trial's that `test/by_hand/verify_cases.py` reads.
    """
    rng = np.random.default_rng(trial.seed)
    inputs = read_inputs(trial.case, rng)
    run = RecordedRun(trial.seed, trial.time_limit)
    gc.collect()
    placement = next(run_case(trial, run, inputs, rng, time.perf_counter), None)
    if placement is not None and trial.solutions is not None:
        save_last(trial.solutions, trial, run, placement)
    entry = {
        "row": row,
        "case": str(trial.case),
        "seed": trial.seed,
        "limit": trial.time_limit,
        "solved": placement is not None,
        "environment_seconds": run.environment,
        "planner_seconds": run.preparation - run.environment,
        "search_seconds": run.elapsed - run.preparation,
        "cpu_seconds": run.cpu,
        "samples": run.samples,
        "goals": run.goals,
        "failure": run.failure,
    }
    return entry, trial_entry(trial, run)


def measure_goal_sets(
    recording: Recording, plain: int, limit: float, rng: np.random.Generator
) -> Iterator[Entry]:
    """Wall time until a path to one of the goals is there; unsolved queries take their limit.

    Args:
        plain: how many of the queries, spread over them, stock RRTConnect with coal is given too.
        limit: seconds for a query.
    """
    queries, settings = recording.goal_sets, recording.settings
    obstacles = recording.problem.environment.obstacles
    both = set(np.linspace(0, len(queries) - 1, min(plain, len(queries))).astype(int).tolist())
    for number, query in enumerate(queries):
        entry: Entry = {"row": "goal_sets", "case": str(recording.case)}
        entry |= {"goals": len(query.goals), "limit": limit}
        cpu = time.process_time()
        entry |= _timed_plan("", partial(_goal_set_planner, recording, query, rng), limit)
        entry["cpu_seconds"] = time.process_time() - cpu
        if number in both:
            exact = ExactCollision(
                query.holding.moving, query.holding.held, obstacles, settings.collision
            )
            edge_free = partial(exact.edge_free, reserve=settings.collision.planning_reserve)
            goals = [goal.q_raised for goal in query.goals]
            stock = partial(rrt_connect, query.holding, goals, edge_free)
            entry |= _timed_plan("plain_", stock, limit)
        yield entry


def _goal_set_planner(
    recording: Recording,
    query: GoalSetQuery,
    rng: np.random.Generator,
    should_stop: Callable[[], bool],
) -> Array | None:
    """As `PlacementPlanner` plans, from an empty forward tree."""
    planner = MotionPlanner([query.holding], recording.settings.transit, rng)
    for goal in query.goals:
        planner.add(goal)
    while not should_stop():
        found = planner.plan(recording.settings.motion_iterations, should_stop)
        if found is not None:
            return found[1]
    return None


def _timed_plan(
    prefix: str, plan: Callable[[Callable[[], bool]], Array | None], limit: float
) -> dict[str, Any]:
    started = time.perf_counter()
    solved = plan(lambda: time.perf_counter() - started > limit) is not None
    seconds = time.perf_counter() - started
    return {
        f"{prefix}solved": solved,
        f"{prefix}seconds": seconds if solved else max(limit, seconds),
    }
