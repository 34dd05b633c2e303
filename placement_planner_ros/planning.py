"""From one snapshot of all inputs to a planner ready to run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from placement_planner_ros.core.body import Body
from placement_planner_ros.core.holding import workspace
from placement_planner_ros.core.objective import ObjectiveContext, make_objective
from placement_planner_ros.core.planner import PlacementPlanner, Problem
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.regions import RegionSettings
from placement_planner_ros.core.types import Array, Placement
from placement_planner_ros.parameters import ParameterSet
from placement_planner_ros.self_filter import outside_robot


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """Every input of a run, taken at one moment and never changed.

    Attributes:
        q_start: (nq,) q_0.
        clouds: point sets (n, 3) in the planning frame.
        parameters: of this run.
        frame: the planning frame.
    """

    robot: Robot
    arms: tuple[Arm, ...]
    q_start: Array
    body: Body
    clouds: tuple[Array, ...]
    parameters: ParameterSet
    frame: str


class Counters(Protocol):
    """What a run reports of its planner."""

    @property
    def samples(self) -> int: ...
    @property
    def rejected(self) -> dict[str, int]: ...
    def why_nothing(self) -> str: ...


class Planner(Protocol):
    """What a run needs of a planner; `PlacementPlanner` is one."""

    exhausted: str

    @property
    def statistics(self) -> Counters: ...
    def run(self, should_stop: Callable[[], bool]) -> Iterator[Placement]: ...


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """A planner and what it plans in."""

    planner: Planner
    environment: Environment


Prepare = Callable[[Snapshot], Prepared]


def visible_points(snapshot: Snapshot) -> Array:
    """The clouds as one, (n, 3), without the robot and the held object where that is asked for."""
    parameters = snapshot.parameters
    points = np.vstack(snapshot.clouds)
    if not parameters["self_filter.enabled"]:
        return points
    kept = outside_robot(
        points,
        snapshot.robot,
        snapshot.q_start,
        snapshot.arms,
        snapshot.body,
        parameters["self_filter.padding"],
    )
    return np.asarray(points[kept])


def prepare(snapshot: Snapshot) -> Prepared:
    """Obstacle set, regions, objective and planner.

    Raises:
        PlacementPlannerError: an input is unusable.
    """
    parameters = snapshot.parameters
    volume = parameters.volume
    environment = Environment.from_points(
        visible_points(snapshot),
        volume,
        parameters.grid_settings,
        RegionSettings(),
        workspace(snapshot.robot, snapshot.arms, snapshot.q_start, snapshot.body, volume),
    )
    problem = Problem(
        snapshot.robot, snapshot.arms, snapshot.q_start, snapshot.body, volume, environment
    )
    objective = make_objective(
        parameters["objective"], ObjectiveContext(environment, volume, snapshot.body)
    )
    seed = parameters["seed"]
    rng = np.random.default_rng(None if seed < 0 else seed)
    planner = PlacementPlanner(problem, objective, parameters.planner_settings, rng)
    return Prepared(planner, environment)
