"""Joint limits beyond the URDF's: MoveIt's joint_limits.yaml, and what is assumed without."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from placement_planner_ros.core.errors import RobotError

FIELD = "`joint_limits`"
"""Under which MoveIt's limits are given."""

DEFAULT_ANGULAR_VELOCITY = 1.0
"""rad/s, for a joint that turns and has no usable velocity limit."""

DEFAULT_LINEAR_VELOCITY = 0.1
"""m/s, the same for one that slides."""

ANGULAR_ACCELERATION = 5.0
"""rad/s², for a joint that turns and whose limit nobody states."""

LINEAR_ACCELERATION = 0.5
"""m/s², the same for one that slides: lifts and rails carry what hangs on them."""

_NUMBERS = (
    "min_position",
    "max_position",
    "max_velocity",
    "max_acceleration",
    "max_deceleration",
)
_KINDS = ("position", "velocity", "acceleration", "deceleration")


@dataclass(frozen=True, slots=True)
class JointLimit:
    """What is stated of one joint besides its URDF, rad or m and seconds; None where nothing is."""

    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None
    acceleration: float | None = None


@dataclass(frozen=True, slots=True)
class Assumed:
    """A limit that nobody states.

    Attributes:
        joint: whose.
        what: which.
        value: what is planned with instead.
        unit: of the value.
    """

    joint: str
    what: Literal["velocity", "acceleration"]
    value: float
    unit: str

    def __str__(self) -> str:
        return f"{self.what} {self.value:g} {self.unit} of {self.joint}"


def assumed_rate(
    joint: str, what: Literal["velocity", "acceleration"], *, prismatic: bool
) -> Assumed:
    """The limit that a joint is taken to have where nobody states one."""
    if what == "velocity":
        value = DEFAULT_LINEAR_VELOCITY if prismatic else DEFAULT_ANGULAR_VELOCITY
        return Assumed(joint, what, value, "m/s" if prismatic else "rad/s")
    value = LINEAR_ACCELERATION if prismatic else ANGULAR_ACCELERATION
    return Assumed(joint, what, value, "m/s^2" if prismatic else "rad/s^2")


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
        # default_velocity_scaling_factor and the like stand beside joint_limits
        if isinstance(values, (bool, int, float)):
            continue
        if not isinstance(values, Mapping):
            raise RobotError(f"{FIELD}: {joint}", str(values)[:60], remedy)
        limits[str(joint)] = _read_limits(str(joint), values)
    return limits


def _read_limits(joint: str, values: Mapping[object, object]) -> JointLimit:
    # Numbers of limits that are not switched off.
    off = {kind for kind in _KINDS if values.get(f"has_{kind}_limits") is False}
    numbers: dict[str, float | None] = {}
    for name in _NUMBERS:
        # A number, or nothing.
        value = values.get(name)
        kind = name.partition("_")[2]
        if value is None or kind in off:
            numbers[name] = None
            continue
        field = f"{FIELD}: {joint}.{name}"
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise RobotError(field, value, "give a number")
        if kind == "deceleration":
            value = abs(value)  # MoveIt's is negative
        if not math.isfinite(value) or (kind != "position" and value <= 0.0):
            raise RobotError(field, value, "give a finite number, above zero unless a position")
        numbers[name] = float(value)
    lower, upper, velocity, up, down = (numbers[name] for name in _NUMBERS)
    # The smaller of both accelerations.
    rates = [rate for rate in (up, down) if rate is not None]
    return JointLimit(lower, upper, velocity, min(rates, default=None))
