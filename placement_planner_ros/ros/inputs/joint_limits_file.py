"""MoveIt's joint limits: joint_limits.yaml, or each by itself."""

from __future__ import annotations

import math
from typing import Any

import yaml

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.robot.joint_limits import FIELD, JointLimit, read_joint_limits
from placement_planner_ros.ros.inputs.resources import Files
from placement_planner_ros.ros.parameters.values import ParameterSet


class _Angles(yaml.SafeLoader):
    """Reads the tags for angles that MoveIt's configurations use."""


_Angles.add_constructor("!radians", lambda loader, node: float(loader.construct_scalar(node)))
_Angles.add_constructor(
    "!degrees", lambda loader, node: math.radians(float(loader.construct_scalar(node)))
)


def parse_joint_limits(text: str) -> dict[str, JointLimit]:
    """Limits by joint, from the text of MoveIt's joint_limits.yaml, `!degrees` included.

    Raises:
        RobotError: not YAML, or as `read_joint_limits`.
    """
    try:
        return read_joint_limits(yaml.load(text, _Angles))
    except (yaml.YAMLError, ValueError) as error:  # ValueError: an angle that is no number
        raise RobotError(FIELD, text[:60], f"is not YAML of MoveIt's form: {error}") from error


def given_joint_limits(parameters: ParameterSet, files: Files) -> dict[str, JointLimit]:
    """What MoveIt's parameters say of joints: a file, or else each limit by itself.

    Raises:
        RobotError: they are not of MoveIt's form.
    """
    given = parameters["robot_description_planning"]
    if given:
        try:
            text = files.find(given, trusted=True).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            words = f"give MoveIt's joint_limits.yaml, a path or a URI: {error}"
            raise RobotError(FIELD, given[:60], words) from error
        return parse_joint_limits(text)
    # joints' names may have dots, so the last one parts joint and limit
    limits: dict[str, dict[str, Any]] = {}
    for name, value in parameters.joint_limits.items():
        joint, _, what = name.rpartition(".")
        limits.setdefault(joint, {})[what] = value
    return read_joint_limits(limits)
