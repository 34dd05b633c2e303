"""From one snapshot of all inputs to a planner ready to run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body import Body
from placement_planner_ros.core.holding import workspace
from placement_planner_ros.core.objective import ObjectiveContext, make_objective
from placement_planner_ros.core.planner import PlacementPlanner, Problem
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.regions import RegionSettings
from placement_planner_ros.core.scene.visibility import View
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
        origins: per cloud, (3,) where its sensor was, None where that is not known.
    """

    robot: Robot
    arms: tuple[Arm, ...]
    q_start: Array
    body: Body
    clouds: tuple[Array, ...]
    parameters: ParameterSet
    frame: str
    origins: tuple[Array | None, ...] = ()


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


def make_environment(snapshot: Snapshot) -> Environment:
    """The environment from the clouds, without the robot and the held object.

    Raises:
        PlacementPlannerError: the clouds are unusable.
    """
    parameters, volume = snapshot.parameters, snapshot.parameters.volume
    robot, arms, q_start, body = snapshot.robot, snapshot.arms, snapshot.q_start, snapshot.body
    padding = parameters["self_filter.padding"]

    def outside(points: Array, distance: float) -> npt.NDArray[np.bool_]:
        return outside_robot(points, robot, q_start, arms, body, distance)

    points = np.vstack(snapshot.clouds)
    kept = np.ones(len(points), np.bool_)
    if parameters["self_filter.enabled"]:
        kept = outside(points, padding)
    views = []
    if parameters["unknown_space"] == "occupied":
        ends = np.cumsum([len(cloud) for cloud in snapshot.clouds])[:-1]
        for cloud, hides, origin in zip(
            snapshot.clouds, np.split(kept, ends), snapshot.origins, strict=True
        ):
            if origin is not None:
                views.append(View(cloud, origin, hides))
    around = max(padding, parameters["collision_margin"])
    return Environment.from_points(
        points[kept],
        volume,
        parameters.grid_settings,
        RegionSettings(),
        workspace(robot, arms, q_start, body, volume),
        views=views,
        outside_robot=lambda centers, distance: outside(centers, around + distance),
    )


def sight_notes(snapshot: Snapshot) -> list[str]:
    """What to tell of `unknown_space` where it cannot be told what was seen."""
    if snapshot.parameters["unknown_space"] == "free" or any(
        origin is not None for origin in snapshot.origins
    ):
        return []
    return [
        "unknown_space: occupied has no effect, for every cloud is in the planning frame and "
        "nobody knows where it was seen from; publish clouds in their sensor's frame"
    ]


def prepare(snapshot: Snapshot) -> Prepared:
    """Obstacle set, regions, objective and planner.

    Raises:
        PlacementPlannerError: an input is unusable.
    """
    parameters = snapshot.parameters
    volume = parameters.volume
    environment = make_environment(snapshot)
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
