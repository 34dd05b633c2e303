"""The subject of a check: robot, start, arms and object, as far as they could be made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.did_you_mean import did_you_mean
from placement_planner_ros.core.errors import ParameterError, listed
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.furniture import WORLD_LINKS, fixed_links, require_links
from placement_planner_ros.ros.inputs.object_input import ObjectInput
from placement_planner_ros.ros.inputs.resources import Files
from placement_planner_ros.ros.inputs.robot_input import (
    RobotInput,
    UnplacedError,
    make_arm,
    require_assumed,
)
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.ros.run.start_checks import require_arms, require_face
from placement_planner_ros.ros.tools.robot_check.findings import Findings
from placement_planner_ros.ros.tools.robot_check.given import Given, read_yaml


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """What is checked.

    Attributes:
        parameters: all of them.
        robot: standing at q.
        q: (nq,) the start.
        assumed: whether nobody gave it.
        arms: that could be made.
        body: the object; None where there is none.
        fixed: which links are furniture and which the robot's foot, in words.
    """

    parameters: ParameterSet
    robot: Robot
    q: Array
    assumed: bool
    arms: tuple[Arm, ...]
    body: Body | None
    fixed: str = ""


def read_subject(
    given: Given, joints: Path | None, findings: Findings, start: Mapping[str, Any] | None = None
) -> Subject | None:
    """Robot, start, arms and object; None without a robot. Says what is wrong with each.

    Args:
        joints: a file with the start.
        start: some joint values where there is no such file; None for zero.
    """
    parameters = given.parameters
    files = Files.below(parameters["package_paths"], parameters["file_roots"])
    body = findings.attempt(lambda: _body(parameters, files))
    robot = findings.attempt(lambda: _robot(parameters, files, findings))
    if robot is None:
        return None
    q = _start(robot, joints, start, parameters, findings)
    standing = findings.attempt(lambda: robot.standing_at(q)) or robot
    arms: tuple[Arm, ...] = ()
    if "arms" in given.names or not parameters["robot_description"]:
        arms = _arms(standing, parameters, findings)
    else:
        words = (
            "arms: none is named; set arms and, of each, tip_frame and grasps; tip_frame such as "
        )
        findings.wrong(words + _proposed(robot))
    used = [joint for arm in arms for joint in arm.used_joints] or robot.joint_names
    findings.attempt(lambda: robot.require_plausible(q, used))
    findings.attempt(lambda: require_links(standing, parameters))
    ends = [arm.tip_frame for arm in arms]
    ends += [frame for frame in parameters["sensor_frames"] if standing.has_link(frame)]
    fixed = fixed_links(standing, ends, parameters[WORLD_LINKS])
    words = str(fixed) if fixed.furniture or fixed.foot else ""
    assumed = joints is None and start is None
    return Subject(parameters, fixed.robot, q, assumed, arms, body, words)


def _robot(parameters: ParameterSet, files: Files, findings: Findings) -> Robot:
    made = RobotInput(parameters, lambda *_: None, files)
    made.wait()
    try:
        return made.robot
    except UnplacedError:
        frame = parameters["planning_frame"]
        findings.say(
            f"planning_frame {frame} is no link of the robot, so tf2 must know it when the node "
            "runs; checked here in the robot's root frame"
        )
        values = {name: parameters[name] for name in parameters.specs} | {"planning_frame": ""}
        return _robot(ParameterSet(parameters.specs, values), files, findings)


def _body(parameters: ParameterSet, files: Files) -> Body:
    made = ObjectInput(parameters, files)
    made.wait()
    body = made.body(parameters)
    require_face(body)
    return body


def _start(
    robot: Robot,
    joints: Path | None,
    start: Mapping[str, Any] | None,
    parameters: ParameterSet,
    findings: Findings,
) -> Array:
    """q (nq,): as a file has it; what it leaves out as `assumed_joints` has it, or else at zero or
    at the limit next to it."""
    zero = np.clip(np.zeros(len(robot.joint_names)), robot.lower, robot.upper)
    free = [name for name in robot.joint_names if name not in robot.mimics]
    findings.attempt(lambda: require_assumed(robot, parameters))
    assumed = parameters.assumed_joints
    at = dict(zip(robot.joint_names, zero.tolist(), strict=True)) | assumed
    where = "start" if joints is None else str(joints)
    tree = start if joints is None else findings.attempt(lambda: read_yaml(joints))
    told = None if tree is None else findings.attempt(lambda: positions_of(tree, where))
    positions = {name: value for name, value in (told or {}).items() if name in free}
    for name in set(told or {}).difference(robot.joint_names):
        meant = did_you_mean(name, free)
        if meant is not None and meant not in positions:
            findings.wrong(f"{where}: {name} is no joint of the robot; the nearest is {meant}")
    missing = [name for name in robot.needed_joints if name not in {*positions, *assumed}]
    if joints is not None and told is not None and missing:
        words = "these joints are missing, which joint_states must have, or assumed_joints"
        findings.wrong(f"{where}: {words}: {', '.join(missing)}")
    q = robot.configuration({name: positions.get(name, at[name]) for name in free})
    for words in robot.limit_violations(q) if positions else ():
        findings.say(f"{where}: {words}")
    return robot.within_limits(q, parameters["start_limit_tolerance"]) if positions else q


def positions_of(tree: Any, where: str) -> dict[str, float]:
    """Joint values by name, from a mapping or a joint state as `ros2 topic echo` writes it.

    Raises:
        ParameterError: it is neither.
    """
    if isinstance(tree, Mapping) and {"name", "position"} <= set(tree):
        tree = dict(zip(tree["name"], tree["position"], strict=False))
    if not isinstance(tree, Mapping) or not tree:
        words = "give `joint: value` lines, or a joint state's name and position"
        raise ParameterError(where, tree, words)
    for name, value in tree.items():
        if type(value) not in (int, float) or not isfinite(value):
            raise ParameterError(f"{where}: {name}", value, "give a finite number, rad or m")
    return {str(name): float(value) for name, value in tree.items()}


def _arms(robot: Robot, parameters: ParameterSet, findings: Findings) -> tuple[Arm, ...]:
    made: list[Arm] = []
    for name in parameters["arms"]:
        unknown = _unknown(robot, parameters, name)
        for fault in unknown:
            findings.wrong(fault)
        arm = None if unknown else findings.attempt(partial(make_arm, robot, parameters, name))
        made += [] if arm is None else [arm]
    if len(made) == len(parameters["arms"]):
        findings.attempt(partial(require_arms, made, parameters))
    return tuple(made)


def _unknown(robot: Robot, parameters: ParameterSet, arm: str) -> list[ParameterError]:
    """Names of links and joints that the robot does not have, with the nearest that it has."""
    links = [frame.name for frame in robot.model.frames if robot.has_link(frame.name)]
    joints = list(robot.joint_names)
    faults = []
    known = {"tip_frame": links, "touch_links": links, "joints": joints, "gripper_joints": joints}
    for part, names in known.items():
        value = parameters[f"{arm}.{part}"]
        for name in [value] if isinstance(value, str) else value:
            if name not in names:
                meant = did_you_mean(name, names) or _proposed(robot)
                words = f"the robot has none of that name; the nearest is {meant}"
                faults.append(ParameterError(f"{arm}.{part}", name, words))
    return faults


def _proposed(robot: Robot) -> str:
    """Links at the ends of the robot's longest chains, in words; hands instead of their fingers."""
    chains: dict[tuple[str, ...], str] = {}
    for frame in robot.model.frames:
        if robot.has_link(frame.name):
            chains.setdefault(robot.joints_to(frame.name), frame.name)
    before = [joints[:-1] for joints in chains]
    ends = [joints for joints in chains if joints not in before]
    fingers = {joints[:-1] for joints in ends if sum(e[:-1] == joints[:-1] for e in ends) > 1}
    tips = {joints[:-1] if joints[:-1] in fingers else joints: None for joints in ends}
    longest = sorted((tip for tip in tips if tip in chains), key=len, reverse=True)
    return listed([f"{chains[tip]} ({len(tip)} joints)" for tip in longest])
