"""One run of a planner as plain values for a JSON line, and its placements as files."""

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
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.planner import PlacementPlanner
from placement_planner_ros.core.types import Placement
from placement_planner_ros.core.warmup.warm_up import warm_up
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


@dataclass(slots=True)
class RecordedSolution:
    """What is remembered of one placement.

    Attributes:
        time: seconds from the start, the environment's construction included.
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
    pose: list[list[float]]
    q: list[float]

    @classmethod
    def of(cls, placement: Placement, seconds: float) -> RecordedSolution:
        """A placement found so many seconds after the start."""
        goal, pose = placement.goal, placement.goal.T_world_object.homogeneous[:3].tolist()
        found = seconds, placement.objective, goal.arm, goal.grasp, goal.face, placement.samples
        return cls(*found, pose, goal.q.tolist())


@dataclass(slots=True)
class RecordedRun:
    """One run, also one that failed; times are seconds from the start, as its clock tells them.

    The clock starts when robot, object and cloud are there, as with a node that is told to start;
    building the environment counts. Processor time leaves out what other processes take: a planner
    runs in one thread, so that on a quiet machine it is the time that passes.

    Attributes:
        environment: until the environment was there.
        preparation: until the first sample.
        elapsed: until the end.
        cpu: of processor time from the environment on, whatever the clock tells.
        rejected: how many samples each constraint rejected.
        exhausted: whether the search ended because there is provably nothing.
        failure: why there is no solution, or the error that ended the run; '' otherwise.
    """

    seed: int
    time_limit: float
    environment: float = 0.0
    preparation: float = 0.0
    elapsed: float = 0.0
    cpu: float = 0.0
    solutions: list[RecordedSolution] = field(default_factory=list)
    samples: int = 0
    goals: int = 0
    motion_iterations: int = 0
    uncertified: int = 0
    rejected: dict[str, int] = field(default_factory=dict)
    exhausted: bool = False
    failure: str = ""
    machine: dict[str, str | int] = field(default_factory=machine)
    versions: dict[str, str] = field(default_factory=versions)

    def follow(
        self,
        planner: PlacementPlanner,
        started: float,
        clock: Callable[[], float] = time.process_time,
    ) -> Iterator[Placement]:
        """Run the planner and yield every placement; all is true after each and at the end.

        Args:
            started: what the clock showed then.
            clock: seconds.
        """
        self.preparation = clock() - started
        began = time.process_time() - self.cpu
        for placement in planner.run(lambda: clock() - started > self.time_limit):
            self.solutions.append(RecordedSolution.of(placement, clock() - started))
            self._count(planner, clock() - started, time.process_time() - began)
            yield placement
        self._count(planner, clock() - started, time.process_time() - began)

    def _count(self, planner: PlacementPlanner, elapsed: float, cpu: float) -> None:
        self.elapsed, self.cpu = elapsed, cpu
        statistics = planner.statistics
        self.samples = statistics.samples
        self.goals = statistics.goals
        self.motion_iterations = statistics.motion_iterations
        self.uncertified = statistics.unreached
        self.rejected = statistics.rejected
        self.exhausted = bool(planner.exhausted)
        if not self.solutions:
            self.failure = planner.exhausted or planner.explain().short


def failure_of(action: Callable[..., object], *arguments: object) -> str:
    """The traceback of what goes wrong, which does not end other runs; '' where nothing does."""
    try:
        action(*arguments)
    except Exception:
        return traceback.format_exc()
    return ""


@functools.cache
def warm_process() -> None:
    """Compile or load every kernel, once in each process."""
    robot = load_yumi()
    arms = [yumi_arm(robot, name) for name in TIP_FRAMES]
    warm_up(robot, arms, robot.configuration(START_CONFIGURATION))


def run_case(
    trial: Trial,
    run: RecordedRun,
    inputs: CaseInputs,
    rng: np.random.Generator,
    clock: Callable[[], float] = time.process_time,
) -> Iterator[Placement]:
    """Plan for the inputs as the trial's variant does, and yield every placement.

    Args:
        run: has not begun.
        clock: seconds.
    """
    variant = VARIANTS[trial.variant]
    started = clock()
    problem, objective = build_problem(inputs, trial.case.objective)
    variant.ready(problem)
    run.environment = clock() - started
    began = time.process_time()
    planner = variant.planner(problem, objective, variant.settings, rng)
    run.cpu = time.process_time() - began
    yield from run.follow(planner, started, clock)


def run_trial(
    trial: Trial, inputs: Callable[[Case, np.random.Generator], CaseInputs] = read_inputs
) -> dict[str, Any]:
    """The trial and its `RecordedRun` as plain values; errors are in it, not raised.

    Args:
        inputs: robot, object, V and cloud of a case, with the generator of the cloud's noise.
    """
    warm_process()
    run = RecordedRun(trial.seed, trial.time_limit)

    def play() -> None:
        rng = np.random.default_rng(trial.seed)
        for placement in run_case(trial, run, inputs(trial.case, rng), rng):
            if trial.solutions is not None:
                save_last(trial.solutions, trial, run, placement)
            if len(run.solutions) == trial.enough:
                break

    run.failure = failure_of(play) or run.failure
    return trial_entry(trial, run)


def trial_entry(trial: Trial, run: RecordedRun) -> dict[str, Any]:
    """Both as plain values."""
    of = {"case": asdict(trial.case), "variant": trial.variant, "enough": trial.enough}
    return of | asdict(run)


def describe_run(entry: Mapping[str, Any]) -> str:
    """A trial's entry in a line for the terminal."""
    head = f"{Case(**entry['case'])!s:<62} {entry['variant']:<13} seed {entry['seed']:<2}"
    solutions = entry["solutions"]
    if not solutions:
        return f"{head}  FAILED: {last_line(entry['failure'])}"
    first, last = solutions[0], solutions[-1]
    return (
        f"{head}  first {first['time']:5.2f} s  {len(solutions):2d} solutions  "
        f"objective {first['objective']:+.4f} -> {last['objective']:+.4f}  "
        f"{entry['samples'] / (entry['elapsed'] - entry['preparation']):6.0f} samples/s"
    )


def last_line(text: str) -> str:
    """Of a traceback, what went wrong; '' of nothing."""
    return next(reversed(text.strip().splitlines()), "")


def save_last(folder: Path, trial: Trial, run: RecordedRun, placement: Placement) -> None:
    """Write the run's last placement as `test/by_hand/verify_cases.py` looks for it."""
    name = f"{str(trial.case).replace('/', '-')}-{run.seed}-{len(run.solutions)}.npz"
    save_solution(folder / name, trial.case, run.seed, placement)


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
