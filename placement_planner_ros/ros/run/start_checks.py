"""Checks at start: every input at one moment, or all that is missing or wrong."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.errors import (
    CloudError,
    GraspError,
    JointStateError,
    ObjectError,
    ParameterError,
    PlacementPlannerError,
    listed,
)
from placement_planner_ros.core.grasp.object_size import size_doubt
from placement_planner_ros.core.grasp.start_state_check import (
    deep_fingers,
    faults_at_start,
    tilts_at_start,
)
from placement_planner_ros.core.problem import workspace
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.keep_out import boxes_of
from placement_planner_ros.core.timing.trajectory_maker import TimingSettings
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.inputs import Inputs
from placement_planner_ros.ros.inputs.robot_input import announced, make_arm, require_assumed
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.run.surroundings import disagreement_notes, require_grid, sight_notes

Made = TypeVar("Made")

BUNDLED = (
    "the bundled YuMi stands in for it, and its joints are not published; publish the robot's URDF "
    "as robot_description, reliable and transient local, or set the parameter robot_description"
)
"""What to do where joints of a robot are missing that nobody asked for."""


SRDF = "give robot_description_semantic"
"""What to do about pairs of links that were left out."""


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
    needed = not len(inputs.known)
    faults += inputs.clouds.faults(mode, max_age, now, needed)
    clouds = None if faults else attempt(lambda: inputs.clouds.snapshot(mode, max_age, now, needed))
    robot_key, changes = inputs.robot.key, inputs.known.changes
    robot = attempt(lambda: inputs.robot.robot)
    standing: _Standing | None = None
    arms: tuple[Arm, ...] = ()
    if robot is not None:
        made = [attempt(partial(make_arm, robot, parameters, name)) for name in parameters["arms"]]
        arms = tuple(arm for arm in made if arm is not None)
        standing = attempt(partial(_standing, inputs, robot, arms, parameters, now))
        if len(arms) == len(made):
            attempt(lambda: require_grasp(arms))
            attempt(lambda: require_limits(arms, parameters.planner_settings.timing))
    attempt(lambda: parameters.planner_settings.tilt)
    attempt(parameters.planner_settings.wishes.require_consistent)
    attempt(lambda: require_terms(parameters))
    object_key = inputs.object.key
    body = attempt(lambda: inputs.object.body(parameters, overridden))
    if faults or standing is None or clouds is None or body is None:
        return faults
    fixed = attempt(partial(inputs.fixed_links, standing.robot, arms, parameters))
    if fixed is None:
        return faults
    surfaces = attempt(partial(inputs.known_surfaces, fixed.robot, parameters))
    if surfaces is None:
        return faults
    around = workspace(fixed.robot, arms, standing.q, body, parameters.volume)
    known = (surface.within(*around) for surface in (*fixed.surfaces, *surfaces))
    clouds += tuple(each for each in known if len(each.points))
    if not clouds:
        return [CloudError("known_objects", "none near the arms", "there is nothing to place on")]
    points = tuple(cloud.points for cloud in clouds)
    origins = tuple(cloud.origin for cloud in clouds)
    placed = tuple(cloud.placed for cloud in clouds)
    snapshot = Snapshot(
        fixed.robot,
        arms,
        standing.q,
        body,
        points,
        parameters,
        standing.robot.root_link,
        origins,
        placed,
        object_key,
        robot_key,
        standing.joints,
        standing.moving,
        standing.notes,
        str(fixed) if fixed.furniture else "",
        changes,
        tuple(f"{topic}: {words}" for topic, words in inputs.turned.items() if words),
        tuple(cloud.topic for cloud in clouds),
        tuple(cloud.time for cloud in clouds),
    )
    attempt(lambda: require_face(body))
    attempt(lambda: require_grid(snapshot))
    return faults or snapshot


class _Standing(NamedTuple):
    """Where the robot stands: the robot, with what that shows of it, and parts of a `Snapshot`."""

    robot: Robot
    q: Array
    joints: tuple[str, ...]
    moving: tuple[str, ...]
    notes: tuple[str, ...]


def _standing(
    inputs: Inputs, robot: Robot, arms: Sequence[Arm], parameters: ParameterSet, now: float
) -> _Standing:
    """Where the robot stands.

    Raises:
        PlacementPlannerError: q_0 is not known, or cannot be.
    """
    require_assumed(robot, parameters)
    timeout, rest_speed = parameters["joint_state_timeout"], parameters["rest_speed"]
    used = {joint for arm in arms for joint in arm.used_joints}
    matter = used.union(*(robot.joints_to(arm.tip_frame) for arm in arms))
    matter |= inputs.joints_to_sensors(robot, parameters)
    try:
        assumed = parameters.assumed_joints
        q = inputs.joints.resting(robot, matter, assumed, now, timeout, rest_speed)
    except JointStateError as error:
        if inputs.robot.is_given:
            raise
        raise JointStateError("robot_description", "none has come", BUNDLED) from error
    robot.require_plausible(q, used)
    within = robot.within_limits(q, parameters["start_limit_tolerance"])
    notes = [
        f"{words}: taken to be at the limit, as it is no further beyond than start_limit_tolerance"
        for words in robot.limit_violations(q)
        if words not in robot.limit_violations(within)
    ]
    moving = inputs.joints.moving(set(robot.needed_joints) - matter, None, rest_speed)
    if moving:
        names = f"{listed(sorted(moving))}: moving"
        notes.append(f"{names}, but of no arm and no sensor; planned with where they are now")
    joints = (*robot.needed_joints, *sorted(matter.difference(robot.needed_joints)))
    standing = inputs.robot.standing_at(robot, within)
    return _Standing(standing, within, joints, tuple(moving), tuple(notes))


def start_notes(snapshot: Snapshot, environment: Environment | None) -> list[str]:
    """What to know of a run that can start.

    Args:
        environment: the run's; None where it is yet to be made, and q_0 looked at again then.

    Raises:
        PlacementPlannerError: it cannot start from q_0.
    """
    settings = snapshot.parameters.planner_settings
    at_start = faults_at_start(
        snapshot.robot,
        snapshot.arms,
        snapshot.q_start,
        snapshot.body,
        settings.collision,
        None if environment is None else environment.obstacles,
        settings.tilt,
        boxes_of(keep_out) if (keep_out := snapshot.parameters["keep_out"]) else None,
    )
    robot, parameters = snapshot.robot, snapshot.parameters
    beyond = robot.limit_violations(snapshot.q_start)
    without = [f"does without {reason}" for reason in at_start]
    assumed = not settings.timing.chosen
    of_arms = [
        note
        for arm in snapshot.arms
        for note in announced(robot, parameters, arm).notes(accelerations=assumed)
    ]
    standing = [each for each in robot.left_out or () if each.reason == "start"]
    left_out = [
        f"not checked against each other: {each}; if they can meet, {SRDF}" for each in standing
    ]
    doubt = size_doubt(snapshot.robot, snapshot.arms, snapshot.q_start, snapshot.body)
    tilts: tuple[str, ...] = ()
    if settings.tilt is not None:
        tilts = tilts_at_start(robot, snapshot.arms, snapshot.q_start, settings.tilt)
    deep = deep_fingers(snapshot.robot, snapshot.arms, snapshot.q_start, snapshot.body)
    of_object = [*snapshot.body.warnings, *([doubt] if doubt else deep)]
    sights = sight_notes(snapshot, environment)
    fixed = [*([snapshot.fixed] if snapshot.fixed else []), *snapshot.of_clouds]
    fixed += disagreement_notes(environment)
    told = [*of_object, *snapshot.notes, *fixed, *beyond, *of_arms, *left_out, *without]
    return [*told, *tilts, *sights]


def require_face(body: Body) -> None:
    """Refuse a body that can stand on nothing.

    Raises:
        ObjectError: it has no placement face.
    """
    if body.faces:
        return
    extents = np.ptp(body.vertices, axis=0).round(4).tolist()
    tries = "try object.center_of_mass, object.flatness, or another mesh"
    why = f"it has no face to rest on; {tries}"
    if body.rolling:
        why = (
            f"it could roll from each of its {body.rolling} rests; set object.allow_rolling, or "
            f"{tries}"
        )
    raise ObjectError("object", f"{len(body.vertices)} vertices, {extents} m large", why)


def require_terms(parameters: ParameterSet) -> None:
    """Refuse a weighted objective without terms.

    Raises:
        ParameterError: it has none.
    """
    if parameters["objective"] == "weighted" and not parameters["objective_terms"]:
        raise ParameterError("objective_terms", [], "name at least one for objective: weighted")


def require_limits(arms: Sequence[Arm], timing: TimingSettings) -> None:
    """Refuse acceleration limits that do not fit every arm.

    Raises:
        ParameterError: there are neither one nor as many as an arm has joints.
    """
    for arm in arms:
        timing.accelerations(arm)


def require_grasp(arms: Sequence[Arm]) -> None:
    """Refuse arms of which none has a grasp.

    Raises:
        GraspError: there is none.
    """
    if not any(arm.grasps for arm in arms):
        names = ", ".join(f"{arm.name}.grasps" for arm in arms)
        raise GraspError(names, [], "give at least one grasp of one of the arms")
