"""One run of one case, as a JSON line, and its solutions as files a checker can read."""

from __future__ import annotations

import json
import time
import traceback
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.types import Placement
from placement_planner_ros.experiments.cases import Case, make_problem


@dataclass(slots=True)
class Solution:
    """What is remembered of one placement.

    Attributes:
        time: seconds from the start of the run, the environment's construction included.
        objective: ξ.
    """

    time: float
    objective: float
    arm: str
    grasp: int
    face: int
    samples: int


@dataclass(slots=True)
class Record:
    """One run: also where it failed.

    Attributes:
        preparation: seconds until the first sample, robot and cloud included.
        rejected: how many samples each constraint rejected.
        failure: why there is no solution, or the error that ended the run; '' otherwise.
    """

    case: Case
    seed: int
    time_limit: float
    preparation: float = 0.0
    solutions: list[Solution] = field(default_factory=list)
    samples: int = 0
    goals: int = 0
    motion_iterations: int = 0
    uncertified: int = 0
    rejected: dict[str, int] = field(default_factory=dict)
    failure: str = ""

    def to_json(self) -> str:
        """One line."""
        return json.dumps(asdict(self))


def run_case(
    case: Case,
    seed: int,
    time_limit: float,
    settings: PlannerSettings,
    solutions_folder: Path | None = None,
    enough: int | None = None,
) -> Record:
    """Run one case for `time_limit` seconds, loading the robot and making the cloud included.

    Args:
        solutions_folder: where each solution is written as an .npz, if given.
        enough: solutions after which the run ends early, if given.
    """
    record = Record(case, seed, time_limit)
    rng = np.random.default_rng(seed)
    started = time.monotonic()
    try:
        problem, objective = make_problem(case, rng)
        planner = PlacementPlanner(problem, objective, settings, rng)
        record.preparation = time.monotonic() - started
        for placement in planner.run(lambda: time.monotonic() - started > time_limit):
            goal = placement.goal
            record.solutions.append(
                Solution(
                    time.monotonic() - started,
                    placement.objective,
                    goal.arm,
                    goal.grasp,
                    goal.face,
                    placement.samples,
                )
            )
            if solutions_folder is not None:
                name = f"{str(case).replace('/', '-')}-{seed}-{len(record.solutions)}.npz"
                save_solution(solutions_folder / name, case, seed, placement)
            if len(record.solutions) == enough:
                break
    except Exception:
        record.failure = traceback.format_exc()
        return record
    statistics = planner.statistics
    record.samples = statistics.samples
    record.goals = statistics.goals
    record.motion_iterations = statistics.motion_iterations
    record.uncertified = statistics.unreached
    record.rejected = statistics.rejected
    if not record.solutions:
        record.failure = planner.exhausted or statistics.why_nothing()
    return record


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
