"""One run of one variant on one case, as a JSON line, and its solutions as files to be checked."""

from __future__ import annotations

import functools
import json
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cases import Case, CaseInputs, build_problem, read_inputs
from benchmarks.machine import machine, versions
from benchmarks.variants import VARIANTS
from placement_planner_ros.core.collision.boxes import box_arrays
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.planner import PlacementPlanner
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.types import Placement
from placement_planner_ros.core.warmup import warm_up
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, TIP_FRAMES, load_yumi, yumi_arm

RUNS_FILE = "runs.jsonl"
_START_UP = 2.0
"""Seconds that a trial takes beside its time limit, for the estimate of the time left."""


@dataclass(frozen=True, slots=True)
class Trial:
    """What is to be run.

    Attributes:
        variant: one of `VARIANTS`.
        time_limit: seconds of processor time, the environment's construction included.
        enough: solutions after which the run ends early, if given.
        solutions: folder where each solution is written as an .npz, if given.
    """

    case: Case
    variant: str
    seed: int
    time_limit: float
    enough: int | None = None
    solutions: Path | None = None

    def __post_init__(self) -> None:
        if self.variant not in VARIANTS:
            raise ParameterError("variant", self.variant, f"choose one of {', '.join(VARIANTS)}")
        if not self.time_limit > 0.0:
            raise ParameterError("seconds", self.time_limit, "must be above zero")

    @property
    def work(self) -> float:
        """Seconds at most."""
        return self.time_limit + _START_UP

    @property
    def key(self) -> str:
        """Tells trials apart."""
        early = "" if self.enough is None else f" {self.enough}"
        return f"{self.case} {self.variant} {self.seed} {self.time_limit:g}{early}"


def record_key(record: Mapping[str, Any]) -> str:
    """The key of the trial that a record is of."""
    case, enough = Case(**record["case"]), record.get("enough")
    return Trial(case, record["variant"], record["seed"], record["time_limit"], enough).key


@dataclass(slots=True)
class Solution:
    """What is remembered of one placement.

    Attributes:
        time: seconds of processor time from the start, the environment's construction included.
        objective: ξ.
        samples: goal samples tried so far.
        pose: (3, 4) rows of T_world_object.
        q: the arm's joints at the placement, rad.
    """

    time: float
    objective: float
    arm: str
    grasp: int
    face: int
    samples: int
    pose: list[list[float]] = field(default_factory=list)
    q: list[float] = field(default_factory=list)

    @classmethod
    def of(cls, placement: Placement, seconds: float) -> Solution:
        """A placement found so many seconds after the start."""
        goal = placement.goal
        return cls(
            seconds,
            placement.objective,
            goal.arm,
            goal.grasp,
            goal.face,
            placement.samples,
            goal.T_world_object.homogeneous[:3].tolist(),
            goal.q.tolist(),
        )


@dataclass(slots=True)
class Record:
    """One run, also of one that failed; times are seconds from the start, as its clock tells them.

    Attributes:
        variant: one of `VARIANTS`.
        environment: until the environment was there.
        preparation: until the first sample.
        elapsed: until the end.
        rejected: how many samples each constraint rejected.
        failure: why there is no solution, or the error that ended the run; '' otherwise.
    """

    case: Case
    seed: int
    time_limit: float
    variant: str = next(iter(VARIANTS))
    enough: int | None = None
    environment: float = 0.0
    preparation: float = 0.0
    elapsed: float = 0.0
    solutions: list[Solution] = field(default_factory=list)
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


def run_trial(
    trial: Trial,
    inputs: Callable[[Case, np.random.Generator], CaseInputs] = read_inputs,
) -> dict[str, Any]:
    """The `Record` of a trial as a dictionary of plain values; errors are in it, not raised.

    Args:
        inputs: robot, object, V and cloud of a case, with the generator of the cloud's noise.
    """
    warm_process()
    record = Record(trial.case, trial.seed, trial.time_limit, trial.variant, trial.enough)
    try:
        rng = np.random.default_rng(trial.seed)
        for placement in recorded_run(record, inputs(trial.case, rng), rng):
            if trial.solutions is not None:
                save_last(trial.solutions, record, placement)
            if len(record.solutions) == trial.enough:
                break
    except Exception:
        record.failure = traceback.format_exc()
    return asdict(record)


def boxes_ready(problem: Problem) -> None:
    """The boxes of the environment as the collision checks want them, as the node prepares them."""
    box_arrays(problem.environment.obstacles)


def recorded_run(
    record: Record,
    inputs: CaseInputs,
    rng: np.random.Generator,
    clock: Callable[[], float] = time.process_time,
    make: Callable[..., PlacementPlanner] | None = None,
    ready: Callable[[Problem], object] = boxes_ready,
) -> Iterator[Placement]:
    """Plan for the inputs and yield every placement; the record is true after each and at the end.

    The clock starts when robot, object and cloud are there, as with a node that is told to start;
    building the environment counts. Processor time leaves out what other processes take: a
    planner runs in one thread, so that on a quiet machine it is the time that passes.

    Args:
        record: of a run that has not begun; its variant, time limit and objective are used.
        clock: seconds.
        make: the planner of problem, objective, settings and rng, instead of the variant's.
        ready: what else belongs to the environment's construction.
    """
    variant = VARIANTS[record.variant]
    started = clock()
    problem, objective = build_problem(inputs, record.case.objective)
    ready(problem)
    record.environment = clock() - started
    planner = (make or variant.planner)(problem, objective, variant.settings, rng)
    record.preparation = clock() - started
    for placement in planner.run(lambda: clock() - started > record.time_limit):
        record.solutions.append(Solution.of(placement, clock() - started))
        _count(record, planner, clock() - started)
        yield placement
    _count(record, planner, clock() - started)


def _count(record: Record, planner: PlacementPlanner, elapsed: float) -> None:
    record.elapsed = elapsed
    statistics = planner.statistics
    record.samples = statistics.samples
    record.goals = statistics.goals
    record.motion_iterations = statistics.motion_iterations
    record.uncertified = statistics.unreached
    record.rejected = statistics.rejected
    if not record.solutions:
        record.failure = planner.exhausted or planner.explain().short


def describe(record: Mapping[str, Any]) -> str:
    """One line for the terminal."""
    head = f"{Case(**record['case'])!s:<62} {record['variant']:<13} seed {record['seed']:<2}"
    solutions = record["solutions"]
    if not solutions:
        return f"{head}  FAILED: {record['failure'].strip().splitlines()[-1]}"
    first, last = solutions[0], solutions[-1]
    return (
        f"{head}  first {first['time']:5.2f} s  {len(solutions):2d} solutions  "
        f"objective {first['objective']:+.4f} -> {last['objective']:+.4f}  "
        f"{record['samples'] / (record['elapsed'] - record['preparation']):6.0f} samples/s"
    )


def save_last(folder: Path, record: Record, placement: Placement) -> None:
    """Write the run's last placement under the name that `verify_cases.py` looks for."""
    name = f"{str(record.case).replace('/', '-')}-{record.seed}-{len(record.solutions)}.npz"
    save_solution(folder / name, record.case, record.seed, placement)


def save_solution(path: Path, case: Case, seed: int, placement: Placement) -> None:
    """Write what the node would publish of a placement."""
    save_placement(path, placement, case=np.array(json.dumps(asdict(case))), seed=seed)


def save_placement(path: Path, placement: Placement, **of: Any) -> None:
    """Write what the node would publish of a placement, and what it is one of."""
    path.parent.mkdir(parents=True, exist_ok=True)
    trajectory, retreat = placement.trajectory, placement.retreat
    names = ("times", "positions", "velocities", "accelerations")
    leaving = {f"retreat_{name}": getattr(retreat, name) for name in names if retreat is not None}
    np.savez_compressed(
        path,
        **of,
        arm=np.array(placement.goal.arm),
        grasp=placement.goal.grasp,
        face=placement.goal.face,
        objective=placement.objective,
        T_world_object=placement.T_world_object.homogeneous,
        joints=np.array(trajectory.joints),
        **{name: getattr(trajectory, name) for name in names},
        approach_start=placement.approach_start,
        **leaving,
    )
