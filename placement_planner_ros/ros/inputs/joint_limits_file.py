"""MoveIt's joint_limits.yaml as text."""

from __future__ import annotations

import math
from collections.abc import Callable

import yaml

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.robot.joint_limits import FIELD, JointLimit, read_joint_limits


class _Angles(yaml.SafeLoader):
    """Reads the tags for angles that MoveIt's configurations use."""


def _angle(unit: float) -> Callable[[_Angles, yaml.ScalarNode], float]:
    return lambda loader, node: float(loader.construct_scalar(node)) * unit


_Angles.add_constructor("!radians", _angle(1.0))
_Angles.add_constructor("!degrees", _angle(math.pi / 180.0))


def parse_joint_limits(text: str) -> dict[str, JointLimit]:
    """Limits by joint, from the text of MoveIt's joint_limits.yaml, `!degrees` included.

    Raises:
        RobotError: not YAML, or as `read_joint_limits`.
    """
    try:
        return read_joint_limits(yaml.load(text, _Angles))
    except (yaml.YAMLError, ValueError) as error:  # ValueError: an angle that is no number
        raise RobotError(FIELD, text[:60], f"is not YAML of MoveIt's form: {error}") from error
