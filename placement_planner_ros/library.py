"""`plan`: Algorithm 1 from plain values, for those who use the planner without ROS."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.carry.settings import CarrySettings as CarrySettings
from placement_planner_ros.core.did_you_mean import did_you_mean
from placement_planner_ros.core.errors import JointStateError, ParameterError, VolumeError, listed
from placement_planner_ros.core.errors import PlacementPlannerError as PlacementPlannerError
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import Objective
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem, workspace
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import Array, Placement, TargetVolume
from placement_planner_ros.core.warmup.warm_up import warm_up
from placement_planner_ros.core.wishes.settings import TurnSettings as TurnSettings
from placement_planner_ros.core.wishes.settings import WishSettings as WishSettings

_log = logging.getLogger(__name__)
_warm: deque[Robot] = deque(maxlen=4)
"""Robots that the kernels have been loaded for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanOptions:
    """How `plan` searches.

    Attributes:
        objective: a name that `make_objective` knows, or any callable of a pose, to be maximised.
        time_limit: seconds from when the first placement is asked for, those included that pass
            between placements; infinite: until closed.
        seed: of every random choice; None: from the machine's entropy.
        settings: all else.
    """

    objective: str | Objective = "maximize_clearance"
    time_limit: float = 30.0
    seed: int | None = None
    settings: PlannerSettings = field(default_factory=PlannerSettings)

    def __post_init__(self) -> None:
        _require(PlannerSettings, "settings", self.settings, "PlannerSettings")
        if not (isinstance(self.time_limit, Real) and self.time_limit > 0.0):
            raise ParameterError("time_limit", self.time_limit, "give seconds above 0, or math.inf")


def plan(
    robot: Robot,
    arms: Arm | Sequence[Arm],
    q_start: Mapping[str, float] | npt.ArrayLike,
    body: Body,
    volume: TargetVolume,
    environment: Environment | npt.ArrayLike,
    **options: Any,
) -> Iterator[Placement]:
    """Search for placements, each better than the one before, with the motion that leads there.

    Input is checked and the search prepared at once; the search itself runs while a placement is
    asked for, and ends for good when the iterator is closed or dropped. In a fresh installation the
    first call compiles the kernels, which takes a minute or more. Where nothing was found, and
    where arms or grasps had to be left out, a warning of the logger `placement_planner_ros.library`
    says why. `PlacementPlanner` gives the same search with its statistics.

    Args:
        robot: `Robot.from_urdf`.
        arms: `Robot.arm`, one for each hand that could be holding the object, with its grasps.
        q_start: joint values by name, or (nq,) in the order of `robot.joint_names`; rad or m.
        body: the held object, `Body.from_mesh`.
        volume: V, where it shall go, in the frame of the robot's root link, like all that follows.
        environment: (n, 3) points of the surroundings, metres, those on the robot and on the held
            object left out; or `Environment.from_points`, which can be used again.
        options: `PlanOptions`: objective, time_limit, seed and settings.

    Raises:
        PlacementPlannerError: an input is unusable; the message says which, its value and what to
            do about it.
    """
    arms = _arms(robot, arms)
    _require(Body, "body", body, "Body.from_mesh")
    _require(TargetVolume, "volume", volume, "TargetVolume")
    how = _options(options)
    q = _configuration(robot, q_start, [joint for arm in arms for joint in arm.joints])
    robot.require_plausible(q, [joint for arm in arms for joint in arm.used_joints])
    try:
        rng = np.random.default_rng(how.seed)
    except (TypeError, ValueError) as error:
        raise ParameterError("seed", how.seed, "give an integer of at least 0, or None") from error
    if not isinstance(environment, Environment):
        bounds = workspace(robot, arms, q, body, volume)
        environment = Environment.from_points(environment, volume, bounds=bounds)
    elif not volume.same(environment.volume):
        raise VolumeError(
            "volume", _corners(volume), f"the environment is of {_corners(environment.volume)}"
        )
    problem, objective = Problem(robot, arms, q, body, volume, environment), how.objective
    if isinstance(objective, str):
        objective = make_objective(objective, how.settings.context(environment, volume, body))
    planner = PlacementPlanner(problem, objective, how.settings, rng)
    if planner.unusable:
        _log.warning("left out: %s", listed(planner.unusable, "; "))
    if robot not in _warm:
        warm_up(robot, arms, q)
        _warm.append(robot)
    return _search(planner, how.time_limit)


def _search(planner: PlacementPlanner, time_limit: float) -> Iterator[Placement]:
    end = time.monotonic() + time_limit
    yield from planner.run(lambda: time.monotonic() >= end)
    if planner.statistics.solutions == 0:
        _log.warning("no placement: %s", planner.explain())


def _require(kind: type | tuple[type, ...], field: str, value: object, maker: str) -> None:
    if not isinstance(value, kind):
        raise ParameterError(field, value, f"give what {maker}(...) makes")


def _options(given: Mapping[str, Any]) -> PlanOptions:
    known = [each.name for each in fields(PlanOptions)]
    for name in given:
        if name not in known:
            meant = did_you_mean(name, known)
            did = f"; did you mean {meant}?" if meant else ""
            raise ParameterError(name, given[name], f"is none of {listed(known)}{did}")
    return PlanOptions(**given)


def _arms(robot: Robot, arms: Arm | Sequence[Arm]) -> tuple[Arm, ...]:
    _require(Robot, "robot", robot, "Robot.from_urdf")
    if isinstance(arms, str) or not isinstance(arms, Iterable | Arm):
        raise ParameterError("arms", arms, "give a list of what robot.arm(...) makes")
    arms = (arms,) if isinstance(arms, Arm) else tuple(arms)
    for arm in arms:
        _require(Arm, "arms", arm, "robot.arm")
        known = set(arm.joints) <= set(robot.joint_names)
        if not (known and [robot.index(joint) for joint in arm.joints] == arm.q_index.tolist()):
            raise ParameterError("arms", arm.name, f"is no arm of the robot {robot.name!r}")
    return arms


def _configuration(
    robot: Robot, q_start: Mapping[str, float] | npt.ArrayLike, moving: Sequence[str]
) -> Array:
    if isinstance(q_start, Mapping):
        return robot.configuration(q_start, moving)
    try:
        q = np.array(q_start, dtype=np.float64)
    except (TypeError, ValueError):
        q = np.empty(0)
    if q.shape != (len(robot.joint_names),):
        remedy = f"give one number for each of {list(robot.joint_names)}"
        raise JointStateError("q_start", q_start, remedy)
    return robot.configuration(dict(zip(robot.joint_names, q.tolist(), strict=True)))


def _corners(volume: TargetVolume) -> list[float]:
    return volume.boxes.ravel().tolist()
