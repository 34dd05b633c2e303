"""What start looks at: every input at one moment, or all that is missing or wrong."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TypeVar

import numpy as np

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.errors import (
    GraspError,
    ObjectError,
    ParameterError,
    PlacementPlannerError,
)
from placement_planner_ros.core.grasp.at_start import faults_at_start
from placement_planner_ros.core.robot.model import Arm
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.inputs import Inputs
from placement_planner_ros.ros.inputs.robot_input import make_arm
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.run.surroundings import require_grid, sight_notes

Made = TypeVar("Made")


def take_snapshot(
    inputs: Inputs, parameters: ParameterSet, overridden: Iterable[str] = ()
) -> Snapshot | list[PlacementPlannerError]:
    """All inputs at this moment, or everything that is missing or wrong.

    Args:
        overridden: parameters that hold for this run only.
    """
    now = time.monotonic()
    faults: list[PlacementPlannerError] = []
    inputs.retry_clouds(parameters)

    def attempt(make: Callable[[], Made]) -> Made | None:
        try:
            return make()
        except PlacementPlannerError as error:
            faults.append(error)
            return None

    mode, max_age = parameters["cloud.mode"], parameters["cloud.max_age"]
    faults += inputs.clouds.faults(mode, max_age, now)
    clouds = None if faults else attempt(lambda: inputs.clouds.snapshot(mode, max_age, now))
    robot = attempt(lambda: inputs.robot.robot)
    q_start: Array | None = None
    arms: tuple[Arm, ...] = ()
    if robot is not None:
        timeout, tolerance = parameters["joint_state_timeout"], parameters["start_tolerance"]
        q_start = q = attempt(lambda: inputs.joints.resting(robot, now, timeout, tolerance))
        if q is not None:
            attempt(lambda: robot.require_plausible(q))
        made = [attempt(partial(make_arm, robot, parameters, name)) for name in parameters["arms"]]
        arms = tuple(arm for arm in made if arm is not None)
        if len(arms) == len(made):
            attempt(lambda: require_grasp(arms))
            attempt(lambda: require_limits(arms, parameters["acceleration_limits"]))
    object_key = inputs.object.key
    body = attempt(lambda: inputs.object.body(parameters, overridden))
    if faults or robot is None or clouds is None or q_start is None or body is None:
        return faults
    points = tuple(cloud.points for cloud in clouds)
    origins = tuple(cloud.origin for cloud in clouds)
    placed = tuple(cloud.placed for cloud in clouds)
    snapshot = Snapshot(
        robot, arms, q_start, body, points, parameters, robot.root_link, origins, placed, object_key
    )
    attempt(lambda: require_face(body))
    attempt(lambda: require_grid(snapshot))
    return faults or snapshot


def start_notes(snapshot: Snapshot, environment: Environment | None) -> list[str]:
    """What to know of a run that can start.

    Args:
        environment: the run's; None where it is yet to be made, and q_0 looked at again then.

    Raises:
        PlacementPlannerError: it cannot start from q_0.
    """
    at_start = faults_at_start(
        snapshot.robot,
        snapshot.arms,
        snapshot.q_start,
        snapshot.body,
        snapshot.parameters.planner_settings.collision,
        None if environment is None else environment.obstacles,
    )
    beyond = snapshot.robot.limit_violations(snapshot.q_start)
    without = [f"does without {reason}" for reason in at_start]
    return [*snapshot.body.warnings, *beyond, *without, *sight_notes(snapshot)]


def require_face(body: Body) -> None:
    """Refuse a body that can stand on nothing.

    Raises:
        ObjectError: it has no placement face.
    """
    if not body.faces:
        extents = np.ptp(body.vertices, axis=0).round(4).tolist()
        raise ObjectError(
            "object",
            f"{len(body.vertices)} vertices, {extents} m large",
            "it has no face to stand on; check object.center_of_mass and the mesh",
        )


def require_limits(arms: Sequence[Arm], limits: Sequence[float]) -> None:
    """Refuse acceleration limits that do not fit every arm.

    Raises:
        ParameterError: there are neither one nor as many as an arm has joints.
    """
    for arm in arms:
        if len(limits) not in (1, len(arm.joints)):
            raise ParameterError(
                "acceleration_limits",
                list(limits),
                f"give one value, or {len(arm.joints)} for arm {arm.name}",
            )


def require_grasp(arms: Sequence[Arm]) -> None:
    """Refuse arms of which none has a grasp.

    Raises:
        GraspError: there is none.
    """
    if not any(arm.grasps for arm in arms):
        names = ", ".join(f"{arm.name}.grasps" for arm in arms)
        raise GraspError(names, [], "give at least one grasp of one of the arms")
