"""One timed run of one variant on one case, as a record to be written as a JSON line."""

from __future__ import annotations

import functools
import time
import traceback
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.types import Placement
from placement_planner_ros.core.warmup import warm_up
from placement_planner_ros.experiments.cases import Case, build_problem, read_inputs
from placement_planner_ros.experiments.machine import machine, versions
from placement_planner_ros.experiments.variants import VARIANTS
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, TIP_FRAMES, load_yumi, yumi_arm


@dataclass(frozen=True, slots=True)
class Trial:
    """What is to be run.

    Attributes:
        variant: one of `VARIANTS`.
        time_limit: seconds, the environment's construction included.
    """

    case: Case
    variant: str
    seed: int
    time_limit: float

    def __post_init__(self) -> None:
        if self.variant not in VARIANTS:
            raise ParameterError("variant", self.variant, f"choose one of {', '.join(VARIANTS)}")
        if not self.time_limit > 0.0:
            raise ParameterError("seconds", self.time_limit, "must be above zero")

    @property
    def key(self) -> str:
        """Tells trials apart."""
        return f"{self.case} {self.variant} {self.seed} {self.time_limit:g}"


@dataclass(slots=True)
class TrialRecord:
    """What came of a trial, also of one that failed.

    Attributes:
        preparation: seconds from the start to the first sample.
        elapsed: seconds from the start to the end.
        solutions: per placement: time (seconds from the start), objective (ξ), arm, grasp, face,
            samples, pose ((3, 4) rows of T_world_object), q (the arm's joints).
        rejected: how many samples each constraint rejected.
        failure: why there is no solution, or the error that ended the run; '' otherwise.
    """

    case: Case
    variant: str
    seed: int
    time_limit: float
    preparation: float = 0.0
    elapsed: float = 0.0
    solutions: list[dict[str, Any]] = field(default_factory=list)
    samples: int = 0
    goals: int = 0
    motion_iterations: int = 0
    uncertified: int = 0
    rejected: dict[str, int] = field(default_factory=dict)
    failure: str = ""
    machine: dict[str, str | int] = field(default_factory=machine)
    versions: dict[str, str] = field(default_factory=versions)


@functools.cache
def warm_process() -> None:
    """Compile or load every kernel, once in each process."""
    robot = load_yumi()
    arms = [yumi_arm(robot, name) for name in TIP_FRAMES]
    warm_up(robot, arms, robot.configuration(START_CONFIGURATION))


def run_trial(trial: Trial) -> dict[str, Any]:
    """Run it; the clock starts when robot, object and cloud are there, as with the node's start.

    Returns:
        A `TrialRecord` as a dictionary of plain values.
    """
    warm_process()
    record = TrialRecord(trial.case, trial.variant, trial.seed, trial.time_limit)
    try:
        _run(trial, record)
    except Exception:
        record.failure = traceback.format_exc()
    return asdict(record)


def _run(trial: Trial, record: TrialRecord) -> None:
    rng = np.random.default_rng(trial.seed)
    inputs = read_inputs(trial.case, rng)
    variant = VARIANTS[trial.variant]
    started = time.monotonic()
    problem, objective = build_problem(inputs, trial.case.objective)
    planner = variant.planner(problem, objective, variant.settings, rng)
    record.preparation = time.monotonic() - started
    for placement in planner.run(lambda: time.monotonic() - started > trial.time_limit):
        record.solutions.append(solution_record(placement, time.monotonic() - started))
    record.elapsed = time.monotonic() - started
    statistics = planner.statistics
    record.samples = statistics.samples
    record.goals = statistics.goals
    record.motion_iterations = statistics.motion_iterations
    record.uncertified = statistics.unreached
    record.rejected = statistics.rejected
    if not record.solutions:
        record.failure = planner.exhausted or statistics.why_nothing()


def solution_record(placement: Placement, seconds: float) -> dict[str, Any]:
    """A placement as in `TrialRecord.solutions`."""
    goal = placement.goal
    return {
        "time": seconds,
        "objective": goal.objective,
        "arm": goal.arm,
        "grasp": goal.grasp,
        "face": goal.face,
        "samples": placement.samples,
        "pose": goal.T_world_object.homogeneous[:3].tolist(),
        "q": goal.q.tolist(),
    }
