"""Checks at start: every input at one moment, or all that is missing or wrong."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TypeVar

import numpy as np

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.contacts.several import need_a_face
from placement_planner_ros.core.errors import (
    CloudError,
    GraspError,
    JointStateError,
    ObjectError,
    ParameterError,
    PlacementPlannerError,
    listed,
)
from placement_planner_ros.core.grasp.start_state_check import StartRules, faults_at_start
from placement_planner_ros.core.problem import workspace
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.keep_out import boxes_of
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.inputs import Inputs
from placement_planner_ros.ros.inputs.robot_input import LISTED, announced, make_arm, require_known
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.run.surroundings import environment_notes, require_grid, settings_for

Made = TypeVar("Made")

BUNDLED = (
    "the bundled YuMi stands in for it, and its joints are not published; publish the robot's URDF "
    "as robot_description, reliable and transient local, or set the parameter robot_description"
)
"""What to do where joints of a robot are missing that nobody asked for."""


def take_snapshot(
    inputs: Inputs, parameters: ParameterSet, overridden: Iterable[str] = ()
) -> Snapshot | list[PlacementPlannerError]:
    """All inputs at this moment, or everything that is missing or wrong.

    Args:
        overridden: parameters that hold for this run only.
    """
    now = time.monotonic()
    faults: list[PlacementPlannerError] = []

    # faults are gathered, so that all of them are told at once
    def attempt(make: Callable[[], Made]) -> Made | None:
        try:
            return make()
        except PlacementPlannerError as error:
            faults.append(error)
            return None

    # clouds first: those that waited for their frame may be placed by now
    inputs.retry_clouds(parameters)
    # known objects can stand in for clouds
    needed = not len(inputs.known)
    mode, max_age = parameters["cloud.mode"], parameters["cloud.max_age"]
    faults += inputs.clouds.faults(mode, max_age, now, needed)
    parts = inputs.clouds.parts(mode)
    # keys before what they stand for, so that what changes meanwhile is told as a change
    robot_key, changes = inputs.robot.key, inputs.known.changes
    robot = attempt(lambda: inputs.robot.robot)
    standing: _Standing | None = None
    arms: tuple[Arm, ...] = ()
    if robot is not None:
        # every arm by itself, so that each fault is named
        made = [attempt(partial(make_arm, robot, parameters, name)) for name in parameters["arms"]]
        arms = tuple(arm for arm in made if arm is not None)
        attempt(partial(require_known, robot, parameters, LISTED))
        standing = attempt(partial(_standing, inputs, robot, arms, parameters, now))
        if len(arms) == len(made):
            attempt(partial(require_arms, arms, parameters))
    attempt(partial(_require_consistent, parameters))
    object_key = inputs.object.key
    body = attempt(lambda: inputs.object.body(parameters, overridden))
    # what follows needs robot, q_0 and object, all in order
    if faults or robot is None or standing is None or body is None:
        return faults
    q, joints, moving, notes = standing
    # what no joint moves is furniture, and leaves the robot
    fixed = attempt(partial(inputs.fixed_links, robot, arms, parameters))
    surfaces = attempt(partial(inputs.known_surfaces, robot, parameters))
    if fixed is None or surfaces is None:
        return faults
    # of what is known only that counts which the arms can get to
    around = workspace(fixed.robot, arms, q, body, parameters.volume)
    known = [surface.within(*around) for surface in (*fixed.surfaces, *surfaces)]
    parts += tuple(each for each in known if len(each.points))
    if not parts:
        return [CloudError("known_objects", "none near the arms", "there is nothing to place on")]
    told = [str(fixed)] if fixed.furniture else []
    told += [f"{topic}: {words}" for topic, words in inputs.turned.items() if words]
    snapshot = Snapshot(
        fixed.robot,
        arms,
        q,
        body,
        parts,
        parameters,
        robot.root_link,
        object_key,
        robot_key,
        joints,
        moving,
        (*notes, *told),
        changes,
    )
    # what only the whole shows: faces for the contacts, cells for the volume
    attempt(lambda: require_face(body, parameters.planner_settings.contacts))
    attempt(lambda: require_grid(snapshot))
    return faults or snapshot


_Standing = tuple[Array, tuple[str, ...], tuple[str, ...], tuple[str, ...]]
"""Where the robot stands: `q_start`, `joints`, `moving` and `notes` of a `Snapshot`."""


def _standing(
    inputs: Inputs, robot: Robot, arms: Sequence[Arm], parameters: ParameterSet, now: float
) -> _Standing:
    """Where the robot stands.

    Raises:
        PlacementPlannerError: q_0 is not known, or cannot be.
    """
    # joints that matter: those of the arms, those that carry them, and those on the way to sensors
    used = {joint for arm in arms for joint in arm.used_joints}
    matter = used.union(*(robot.joints_to(arm.tip_frame) for arm in arms))
    matter |= inputs.joints_to_sensors(robot, parameters)
    try:
        timeout, rest_speed = parameters["joint_state_timeout"], parameters["rest_speed"]
        assumed = parameters.assumed_joints
        q = inputs.joints.resting(robot, matter, assumed, now, timeout, rest_speed)
    except JointStateError as error:
        # of a stand-in the missing robot is the cause, not the missing joints
        if inputs.robot.is_given:
            raise
        raise JointStateError("robot_description", "none has come", BUNDLED) from error
    # numbers that no joint of an arm can have, as in other units
    robot.require_plausible(q, used)
    # what is barely beyond a limit is planned from the limit, and told
    within = robot.within_limits(q, parameters["start_limit_tolerance"])
    notes = [
        f"{words}: taken to be at the limit, as it is no further beyond than start_limit_tolerance"
        for words in robot.limit_violations(q)
        if words not in robot.limit_violations(within)
    ]
    # the others may move; what they carry is an obstacle where it is now
    moving = inputs.joints.moving(set(robot.needed_joints) - matter, parameters["rest_speed"])
    if moving:
        names = f"{listed(sorted(moving))}: moving"
        notes.append(f"{names}, but of no arm and no sensor; planned with where they are now")
    joints = (*robot.needed_joints, *sorted(matter.difference(robot.needed_joints)))
    return within, joints, tuple(moving), tuple(notes)


def start_notes(snapshot: Snapshot, environment: Environment | None) -> list[str]:
    """What to know of a run that can start.

    Args:
        environment: the run's; None where it is yet to be made, and q_0 looked at again then.

    Raises:
        PlacementPlannerError: it cannot start from q_0.
    """
    robot, arms, q, body = snapshot.robot, snapshot.arms, snapshot.q_start, snapshot.body
    parameters, error = snapshot.parameters, 0.0 if environment is None else environment.error
    settings = settings_for(parameters, error)
    keep_out = parameters["keep_out"]
    rules = StartRules(
        settings.collision, environment, settings.tilt, boxes_of(keep_out) if keep_out else None
    )
    # limits, self-collision, the clouds and the tilt, of each arm and grasp
    at_start = faults_at_start(robot, arms, q, body, rules)
    of_arms = [note for arm in arms for note in announced(robot, parameters, arm)]
    return [
        *body.warnings,
        *snapshot.notes,
        *robot.limit_violations(q),
        *of_arms,
        *(f"does without {reason}" for reason in at_start),
        *environment_notes(snapshot, environment),
    ]


def require_face(body: Body, contacts: Sequence[str]) -> None:
    """Refuse a body that can stand on nothing, unless other contact classes are looked for.

    Raises:
        ObjectError: it has no placement face.
    """
    if body.faces or not need_a_face(contacts):
        return
    extents = np.ptp(body.vertices, axis=0).round(4).tolist()
    why = "it has no face to rest on; "
    if body.rolling:
        why = f"it could roll from each of its {body.rolling} rests; set object.allow_rolling, or "
    why += "add lean to contacts, or try object.center_of_mass, object.flatness, or another mesh"
    raise ObjectError("object", f"{len(body.vertices)} vertices, {extents} m large", why)


def require_arms(arms: Sequence[Arm], parameters: ParameterSet) -> None:
    """Refuse arms of which none has a grasp, and acceleration limits that do not fit every arm.

    Raises:
        GraspError: there is no grasp.
        ParameterError: there are neither one limit nor as many as an arm has joints.
    """
    if not any(arm.grasps for arm in arms):
        names = ", ".join(f"{arm.name}.grasps" for arm in arms)
        raise GraspError(names, [], "give at least one grasp of one of the arms")
    for arm in arms:
        parameters.planner_settings.timing.accelerations(arm)


def _require_consistent(parameters: ParameterSet) -> None:
    """Refuse values that do not fit together.

    Raises:
        ParameterError: there are some.
    """
    settings = parameters.planner_settings
    # it is made of several values, and refuses those that do not fit together
    _ = settings.tilt
    settings.wishes.require_consistent()
    if parameters["objective"] == "weighted" and not parameters["objective_terms"]:
        raise ParameterError("objective_terms", [], "name at least one for objective: weighted")
