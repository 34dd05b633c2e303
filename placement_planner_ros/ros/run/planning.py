"""From one snapshot of all inputs to a planner ready to run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from placement_planner_ros.core.explanation.explanation import Explanation
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.planner import PlacementPlanner
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.search.pruning import Cause
from placement_planner_ros.core.types import Placement
from placement_planner_ros.ros.run.snapshot import Snapshot


class Counters(Protocol):
    """What a run reports of its planner."""

    @property
    def samples(self) -> int: ...
    @property
    def rejected(self) -> dict[str, int]: ...
    @property
    def rejected_by_face(self) -> dict[int, dict[str, int]]: ...
    @property
    def rejected_by_arm(self) -> dict[str, dict[str, int]]: ...


class Planner(Protocol):
    """What a run needs of a planner; `PlacementPlanner` is one."""

    exhausted: str
    cause: Cause | None
    unusable: tuple[str, ...]
    explanation: Explanation

    @property
    def statistics(self) -> Counters: ...
    def explain(self) -> Explanation: ...
    def run(self, should_stop: Callable[[], bool]) -> Iterator[Placement]: ...


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """A planner and what it plans in.

    Attributes:
        flying: how many points of the clouds were left out as flying pixels.
    """

    planner: Planner
    environment: Environment
    flying: int = 0


Prepare = Callable[[Snapshot, Callable[[], bool]], Prepared]
"""Makes the planner of a run; raises `StoppedError` where it was told to stop first."""


def make_planner(snapshot: Snapshot, environment: Environment) -> Prepared:
    """The planner of a run.

    Raises:
        PlacementPlannerError: an input is unusable.
    """
    parameters, volume = snapshot.parameters, snapshot.parameters.volume
    problem = Problem(
        snapshot.robot, snapshot.arms, snapshot.q_start, snapshot.body, volume, environment
    )
    settings = parameters.planner_settings
    objective = make_objective(
        parameters["objective"], settings.context(environment, volume, snapshot.body)
    )
    seed = parameters["seed"]
    rng = np.random.default_rng(None if seed < 0 else seed)
    planner = PlacementPlanner(problem, objective, settings, rng)
    return Prepared(planner, environment)
