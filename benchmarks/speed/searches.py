"""Rows measured in searches: sampling, and the first placement."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable

import numpy as np

from benchmarks.cases import Case, make_problem, read_inputs
from benchmarks.record import RecordedRun, Trial, run_case, save_last, trial_entry
from benchmarks.speed.rows import Entry
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.search.sampler import GoalSampler
from placement_planner_ros.core.types import Goal


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


def measure_first(trial: Trial) -> tuple[Entry, Entry]:
    """Seconds (wall time) from the start call's inputs to the first placement of a trial.

    The clock starts when robot, object and cloud are there. It is read when the environment is
    built, when the planner is made, and at the first placement. A run that has found nothing by its
    limit, or fails, counts as unsolved.

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
        "row": "first",
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
