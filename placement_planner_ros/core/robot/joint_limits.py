"""Joint limits beyond the URDF's: MoveIt's joint_limits.yaml, and what is assumed without."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from placement_planner_ros.core.errors import RobotError

FIELD = "`joint_limits`"
"""Under which MoveIt's limits are given."""

MAX_VELOCITY = 100.0
"""rad/s or m/s: a greater limit states none."""

ANGULAR_VELOCITY = 1.0
"""rad/s, for a joint that turns and has no usable velocity limit."""

ANGULAR_ACCELERATION = 5.0
"""rad/s², for a joint that turns and whose limit nobody states."""

SLIDING_LEVER_M = 0.1
"""m: a joint that slides is assumed to be as fast as one that turns is at this radius, since lifts
and rails carry what hangs on them."""


@dataclass(frozen=True, slots=True)
class JointLimit:
    """What is stated of one joint, rad or m and seconds; infinite where nothing is."""

    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    acceleration: float = math.inf


def read_joint_limits(given: object) -> dict[str, JointLimit]:
    """Limits by joint, from what MoveIt's joint_limits.yaml holds, with or without the levels
    `robot_description_planning` and `joint_limits` around it.

    A limit counts unless its `has_…_limits` is false. Of a greatest acceleration and a greatest
    deceleration the smaller counts. Jerk is passed over, as by MoveIt's own time parametrisation.

    Raises:
        RobotError: not of that form, or a limit is no number, or not above zero.
    """
    # Below the levels that MoveIt has around.
    for level in ("robot_description_planning", "joint_limits"):
        if isinstance(given, Mapping) and level in given:
            given = given[level]
    given = {} if given is None else given
    remedy = "give what MoveIt's joint_limits.yaml holds: joint_limits, and below it joint by joint"
    if not isinstance(given, Mapping):
        raise RobotError(FIELD, str(given)[:60], remedy)
    limits = {}
    for joint, values in given.items():
        if not isinstance(values, Mapping):
            raise RobotError(f"{FIELD}: {joint}", str(values)[:60], remedy)
        limits[str(joint)] = _read_limits(str(joint), values)
    return limits


def _read_limits(joint: str, values: Mapping[object, object]) -> JointLimit:
    def number(end: str, kind: str) -> float:
        # Nothing where the limit is not stated, or switched off.
        name = f"{end}_{kind}"
        value, field = values.get(name), f"{FIELD}: {joint}.{name}"
        if value is None or values.get(f"has_{kind}_limits") is False:
            return -math.inf if end == "min" else math.inf
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise RobotError(field, value, "give a number")
        value = abs(value) if kind == "deceleration" else value  # MoveIt's is negative
        if not math.isfinite(value) or (kind != "position" and value <= 0.0):
            raise RobotError(field, value, "give a finite number, above zero unless a position")
        return float(value)

    return JointLimit(
        number("min", "position"),
        number("max", "position"),
        number("max", "velocity"),
        min(number("max", "acceleration"), number("max", "deceleration")),
    )
