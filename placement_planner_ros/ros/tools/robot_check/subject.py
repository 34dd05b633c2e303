"""What is checked: robot, start, arms and object, as far as they could be made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.did_you_mean import did_you_mean
from placement_planner_ros.core.errors import ParameterError, PlacementPlannerError
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
from placement_planner_ros.ros.run.start_checks import require_face, require_grasp, require_limits
from placement_planner_ros.ros.tools.robot_check.findings import Findings
from placement_planner_ros.ros.tools.robot_check.given import Given, read_yaml

_FINGER_JOINTS = 3
"""Joints, one after the other, that a finger has at most."""
MOST_CHAINS = 8
"""Chains that are proposed as arms."""


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """What is checked.

    Attributes:
        given: the parameters.
        robot: standing at q.
        q: (nq,) the start.
        assumed: whether nobody gave it.
        arms: that could be made.
        body: the object; None where there is none.
        fixed: which links are furniture and which the robot's foot, in words.
    """

    given: Given
    robot: Robot
    q: Array
    assumed: bool
    arms: tuple[Arm, ...]
    body: Body | None
    fixed: str = ""

    @property
    def parameters(self) -> ParameterSet:
        return self.given.parameters


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
    body = _body(parameters, files, findings)
    robot = _robot(parameters, files, findings)
    if robot is None:
        return None
    q = _start(robot, joints, start, parameters, findings)
    standing = findings.attempt(lambda: robot.standing_at(q)) or robot
    if "arms" in given.names or not parameters["robot_description"]:
        arms = _arms(standing, parameters, findings)
    else:
        arms = ()
        words = (
            "arms: none is named; set arms and, of each, tip_frame and grasps; tip_frame such as "
        )
        findings.wrong(words + _proposed(robot))
    used = [joint for arm in arms for joint in arm.used_joints] or robot.joint_names
    findings.attempt(lambda: robot.require_plausible(q, used))
    findings.attempt(lambda: require_links(standing, parameters))
    ends = [arm.tip_frame for arm in arms]
    ends += [f for f in parameters["sensor_frames"] if standing.model.existFrame(f)]
    fixed = fixed_links(standing, ends, parameters[WORLD_LINKS])
    words = str(fixed) if fixed.furniture or fixed.foot else ""
    return Subject(given, fixed.robot, q, joints is None and start is None, arms, body, words)


def _robot(parameters: ParameterSet, files: Files, findings: Findings) -> Robot | None:
    made = findings.attempt(lambda: RobotInput(parameters, lambda *_: None, files))
    if made is None:
        return None
    made.wait()
    try:
        return made.robot
    except UnplacedError:
        findings.say(
            f"planning_frame {parameters['planning_frame']} is no link of the robot, so tf2 must "
            "know it when the node runs; checked here in the robot's root frame"
        )
        rooted = ParameterSet(
            parameters.specs,
            {name: parameters[name] for name in parameters.specs} | {"planning_frame": ""},
        )
        return _robot(rooted, files, findings)
    except PlacementPlannerError as error:
        findings.wrong(error)
        return None


def _body(parameters: ParameterSet, files: Files, findings: Findings) -> Body | None:
    made = ObjectInput(parameters, files)
    made.wait()

    def read() -> Body:
        body = made.body(parameters)
        require_face(body)
        return body

    return findings.attempt(read)


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
    if joints is None and start is None:
        return robot.configuration({name: at[name] for name in free})
    where = "start" if joints is None else str(joints)
    tree = start if joints is None else findings.attempt(lambda: read_yaml(joints))
    read = findings.attempt(lambda: positions_of(tree, where)) if tree is not None else None
    positions = dict(read or {})
    for name in [name for name in positions if name not in robot.joint_names]:
        meant = did_you_mean(name, free)
        if meant is not None and meant not in positions:
            findings.wrong(f"{where}: {name} is no joint of the robot; the nearest is {meant}")
        del positions[name]
    missing = [name for name in robot.needed_joints if name not in {*positions, *assumed}]
    if joints is not None and read is not None and missing:
        findings.wrong(f"{where}: these joints are missing, which joint_states must have, or "
                       f"assumed_joints: {', '.join(missing)}")  # fmt: skip
    q = robot.configuration({name: positions.get(name, at[name]) for name in free})
    for words in robot.limit_violations(q):
        findings.say(f"{where}: {words}")
    return robot.within_limits(q, parameters["start_limit_tolerance"])


def positions_of(tree: Any, where: str) -> dict[str, float]:
    """Joint values by name, from a mapping or a joint state as `ros2 topic echo` writes it.

    Raises:
        ParameterError: it is neither.
    """
    if isinstance(tree, Mapping) and "name" in tree and "position" in tree:
        names, values = tree["name"], tree["position"]
        if isinstance(names, list) and isinstance(values, list) and len(names) == len(values):
            tree = dict(zip(names, values, strict=True))
    if not isinstance(tree, Mapping) or not tree:
        raise ParameterError(
            where, tree, "give `joint: value` lines, or a joint state's name and position"
        )
    for name, value in tree.items():
        if not isinstance(value, Real) or isinstance(value, bool) or not np.isfinite(float(value)):
            raise ParameterError(f"{where}: {name}", value, "give a finite number, rad or m")
    return {str(name): float(value) for name, value in tree.items()}


def _arms(robot: Robot, parameters: ParameterSet, findings: Findings) -> tuple[Arm, ...]:
    made: list[Arm] = []
    for name in parameters["arms"]:
        if not parameters[f"{name}.tip_frame"]:
            words = f"{name}.tip_frame is empty: name the link that grasps refer to, such as "
            findings.wrong(words + _proposed(robot))
            continue
        unknown = list(_unknown(robot, parameters, name))
        for fault in unknown:
            findings.wrong(fault)
        arm = None if unknown else findings.attempt(lambda: make_arm(robot, parameters, name))  # noqa: B023
        if arm is not None:
            made.append(arm)
    if len(made) == len(parameters["arms"]):
        findings.attempt(lambda: require_grasp(made))
        findings.attempt(lambda: require_limits(made, parameters.planner_settings.timing))
    return tuple(made)


def _unknown(robot: Robot, parameters: ParameterSet, arm: str) -> list[str]:
    """Names of links and joints that the robot does not have, with the nearest that it has."""
    links = [frame.name for frame in robot.model.frames if _is_link(robot, frame.name)]
    faults = []
    for part, known, kind in (
        ("tip_frame", links, "link"),
        ("touch_links", links, "link"),
        ("joints", list(robot.joint_names), "movable joint"),
        ("gripper_joints", list(robot.joint_names), "movable joint"),
    ):
        value = parameters[f"{arm}.{part}"]
        for name in [value] if isinstance(value, str) else value:
            if name not in known:
                meant = did_you_mean(name, known)
                words = f"the nearest is {meant}" if meant else f"it has {', '.join(known[:40])}"
                faults.append(f"{arm}.{part} = {name!r} is no {kind} of {robot.name!r}; {words}")
    return faults


def _is_link(robot: Robot, name: str) -> bool:
    return bool(robot.model.existFrame(name, pin.FrameType.BODY))


def _proposed(robot: Robot) -> str:
    """Links at the ends of the robot's longest chains, in words; hands instead of their fingers."""
    chains: dict[tuple[str, ...], str] = {}
    for frame in robot.model.frames:
        if _is_link(robot, frame.name):
            chains.setdefault(robot.joints_to(frame.name), frame.name)
    longest = sorted(chains, key=lambda joints: -len(joints))
    ends = [
        chains[joints]
        for joints in longest
        if not any(other[: len(joints)] == joints and other != joints for other in longest)
    ]
    hands = list(dict.fromkeys(_hand_of(robot, link) for link in ends))
    return ", ".join(
        f"{link} ({len(robot.joints_to(link))} joints)" for link in hands[:MOST_CHAINS]
    )


def _hand_of(robot: Robot, link: str) -> str:
    """The link from which fingers part, where this is one of them; else the link itself."""
    model = robot.model
    joint = model.frames[robot.frame_id(link)].parentJoint
    for _ in range(_FINGER_JOINTS):
        parent = model.parents[joint]
        if parent == 0:
            break
        beside = [j for j in range(1, model.njoints) if model.parents[j] == parent]
        if len(beside) > 1 and all(_depth(model, j) <= _FINGER_JOINTS for j in beside):
            frame = model.frames[model.getFrameId(model.names[joint], pin.FrameType.JOINT)]
            return str(model.frames[frame.parentFrame].name)
        joint = parent
    return link


def _depth(model: pin.Model, joint: int) -> int:
    """Joints of the longest chain that begins with this one."""
    after = [j for j in range(joint + 1, model.njoints) if model.parents[j] == joint]
    return 1 + max((_depth(model, j) for j in after), default=0)
