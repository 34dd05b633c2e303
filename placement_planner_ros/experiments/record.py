"""One run of one case, as a JSON line, and its solutions as files a checker can read."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from placement_planner_ros.core.planner import PlacementPlanner
from placement_planner_ros.core.types import Placement
from placement_planner_ros.experiments.cases import (
    Case,
    CaseInputs,
    build_problem,
    read_inputs,
)
from placement_planner_ros.experiments.machine import machine, versions
from placement_planner_ros.experiments.variants import VARIANTS


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
    """One run: also where it failed.

    Attributes:
        variant: one of `VARIANTS`.
        preparation: seconds of processor time from the start to the first sample.
        elapsed: seconds of processor time from the start to the end.
        rejected: how many samples each constraint rejected.
        failure: why there is no solution, or the error that ended the run; '' otherwise.
    """

    case: Case
    seed: int
    time_limit: float
    variant: str = next(iter(VARIANTS))
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

    def to_json(self) -> str:
        """One line."""
        return json.dumps(asdict(self))


def run_case(
    case: Case,
    variant: str,
    seed: int,
    time_limit: float,
    solutions_folder: Path | None = None,
    enough: int | None = None,
) -> Record:
    """Run one case; errors are recorded, not raised.

    The clock starts when robot, object and cloud are there, as with a node that is told to start;
    building the environment counts. Times are processor time. Warm the process up first.

    Args:
        variant: one of `VARIANTS`.
        time_limit: seconds of processor time.
        solutions_folder: where each solution is written as an .npz, if given.
        enough: solutions after which the run ends early, if given.
    """
    record = Record(case, seed, time_limit, variant)
    try:
        rng = np.random.default_rng(seed)
        inputs = read_inputs(case, rng)
        for placement in recorded_run(record, inputs, rng):
            if solutions_folder is not None:
                name = f"{str(case).replace('/', '-')}-{seed}-{len(record.solutions)}.npz"
                save_solution(solutions_folder / name, case, seed, placement)
            if len(record.solutions) == enough:
                break
    except Exception:
        record.failure = traceback.format_exc()
    return record


def recorded_run(
    record: Record,
    inputs: CaseInputs,
    rng: np.random.Generator,
) -> Iterator[Placement]:
    """Plan for the inputs and yield every placement; the record is true after each and at the end.

    Time is processor time, which leaves out what other processes take. A planner runs
    in one thread, so that on a quiet machine it is the time that passes.

    Args:
        record: of a run that has not begun; its variant, time limit and objective are used.
    """
    variant = VARIANTS[record.variant]
    started = time.process_time()
    problem, objective = build_problem(inputs, record.case.objective)
    planner = variant.planner(problem, objective, variant.settings, rng)
    record.preparation = time.process_time() - started
    for placement in planner.run(lambda: time.process_time() - started > record.time_limit):
        record.solutions.append(Solution.of(placement, time.process_time() - started))
        _count(record, planner, time.process_time() - started)
        yield placement
    _count(record, planner, time.process_time() - started)


def _count(record: Record, planner: PlacementPlanner, elapsed: float) -> None:
    record.elapsed = elapsed
    statistics = planner.statistics
    record.samples = statistics.samples
    record.goals = statistics.goals
    record.motion_iterations = statistics.motion_iterations
    record.uncertified = statistics.unreached
    record.rejected = statistics.rejected
    if not record.solutions:
        record.failure = planner.exhausted or statistics.why_nothing()


def save_solution(path: Path, case: Case, seed: int, placement: Placement) -> None:
    """Write what the node would publish of a placement."""
    path.parent.mkdir(parents=True, exist_ok=True)
    trajectory, retreat = placement.trajectory, placement.retreat
    names = ("times", "positions", "velocities", "accelerations")
    leaving = {f"retreat_{name}": getattr(retreat, name) for name in names if retreat is not None}
    np.savez_compressed(
        path,
        case=np.array(json.dumps(asdict(case))),
        seed=seed,
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
