"""One timed run of one variant on one case, as a job that other processes can be given."""

from __future__ import annotations

import functools
from dataclasses import asdict, dataclass
from typing import Any

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.warmup import warm_up
from placement_planner_ros.experiments.cases import Case
from placement_planner_ros.experiments.record import run_case
from placement_planner_ros.experiments.variants import VARIANTS
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, TIP_FRAMES, load_yumi, yumi_arm


@dataclass(frozen=True, slots=True)
class Trial:
    """What is to be run.

    Attributes:
        variant: one of `VARIANTS`.
        time_limit: seconds of processor time, the environment's construction included.
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


@functools.cache
def warm_process() -> None:
    """Compile or load every kernel, once in each process."""
    robot = load_yumi()
    arms = [yumi_arm(robot, name) for name in TIP_FRAMES]
    warm_up(robot, arms, robot.configuration(START_CONFIGURATION))


def run_trial(trial: Trial) -> dict[str, Any]:
    """The `Record` of a trial, also of one that failed, as a dictionary of plain values."""
    warm_process()
    return asdict(run_case(trial.case, trial.variant, trial.seed, trial.time_limit))
