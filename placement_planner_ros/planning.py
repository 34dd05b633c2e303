"""From one snapshot of all inputs to a planner ready to run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body import Body
from placement_planner_ros.core.errors import ParameterError
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
        placed: per cloud, whether it is an object placed before, which is never filtered.
    """

    robot: Robot
    arms: tuple[Arm, ...]
    q_start: Array
    body: Body
    clouds: tuple[Array, ...]
    parameters: ParameterSet
    frame: str
    origins: tuple[Array | None, ...] = ()
    placed: tuple[bool, ...] = ()


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
    unusable: tuple[str, ...]

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
        if any(snapshot.placed):
            kept |= np.repeat(snapshot.placed, [len(cloud) for cloud in snapshot.clouds])
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
        grid_bounds(snapshot, points[kept]),
        views=views,
        outside_robot=lambda centers, distance: outside(centers, around + distance),
    )


def _workspace(snapshot: Snapshot) -> tuple[Array, Array]:
    return workspace(
        snapshot.robot,
        snapshot.arms,
        snapshot.q_start,
        snapshot.body,
        snapshot.parameters.volume,
    )


def grid_bounds(snapshot: Snapshot, points: Array) -> tuple[Array, Array]:
    """Box (lower (3,), upper (3,)) that the obstacle set must cover.

    Where arm, hand and object can be; of that, only what points (n, 3) lie in, unless unseen space
    counts too.
    """
    lower, upper = _workspace(snapshot)
    if _is_unknown_occupied(snapshot):
        return lower, upper
    inside = points[((points >= lower) & (points <= upper)).all(axis=1)]
    if len(inside) == 0:
        return snapshot.parameters.volume.lower, snapshot.parameters.volume.upper
    # A rim, for neighbours of measured cells count as known, see `validity.KnownSpace`; by whole
    # cells, so that the cells are the same whatever was seen.
    size = snapshot.parameters["cloud.cell_size"]
    skipped = np.floor((inside.min(axis=0) - lower) / size) - 2.0
    return (
        lower + np.maximum(skipped, 0.0) * size,
        np.minimum(upper, inside.max(axis=0) + 2.0 * size),
    )


def require_grid(snapshot: Snapshot) -> None:
    """Refuse cells so small that the obstacle set would have too many.

    Raises:
        ParameterError: they are.
    """
    settings = snapshot.parameters.grid_settings

    def too_many(lower: Array, upper: Array) -> bool:
        return float(np.prod((upper - lower) / settings.cell_size + 2.0)) > settings.max_cells

    if not too_many(*_workspace(snapshot)):
        return  # Without a look at the points, as start has little time.
    lower, upper = grid_bounds(snapshot, np.vstack(snapshot.clouds))
    if too_many(lower, upper):
        size = " x ".join(f"{side:.3g}" for side in upper - lower)
        raise ParameterError(
            "cloud.cell_size",
            settings.cell_size,
            f"makes more than {settings.max_cells} cells of the {size} m that are of interest; "
            "set it higher, or a target_volume nearer to the robot",
        )


def _is_unknown_occupied(snapshot: Snapshot) -> bool:
    return snapshot.parameters["unknown_space"] == "occupied" and any(
        origin is not None for origin in snapshot.origins
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
