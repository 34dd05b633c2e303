"""The movable joints of a URDF, each with one coordinate: range, rates, and what it follows.

What a description leaves open or states badly is decided here, once: a continuous joint gets a
range that no plan comes to the end of, a useless velocity limit a cautious default.
"""

from __future__ import annotations

import math
import sys
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.robot.joint_limits import (
    ANGULAR_ACCELERATION,
    ANGULAR_VELOCITY,
    FIELD,
    MAX_VELOCITY,
    SLIDING_LEVER_M,
    JointLimit,
)
from placement_planner_ros.core.robot.xml_fields import read_floats, read_number

CONTINUOUS_RANGE = 2.25 * math.pi
"""rad to either side of zero, for joints without an end stop: a plan begins within half a turn of
zero (`Robot.unwound`) and ends within half a turn of there, and has room beyond for an approach."""

MOVABLE = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, slots=True)
class Mimic:
    """value = multiplier · master + offset; the master is itself no mimic."""

    master: str
    multiplier: float
    offset: float


@dataclass(frozen=True, slots=True)
class Joint:
    """A movable joint.

    Attributes:
        limit: all of them finite.
        mimic: what it follows.
        continuous: whether it turns without end stops.
        prismatic: whether it slides.
        assumed: which of its rates nobody states, "velocity" or "acceleration".
    """

    limit: JointLimit
    mimic: Mimic | None
    continuous: bool
    prismatic: bool
    assumed: tuple[str, ...]


def read_joint(
    name: str, elements: Mapping[str, ET.Element], stated: JointLimit, warnings: list[str]
) -> Joint:
    """A movable joint, its element brought to the one form that pinocchio is given.

    Args:
        elements: all joints of the URDF by name.
        stated: what else is stated of it; the narrower range and the lower rates count.
        warnings: gets a sentence on each thing that was decided.

    Raises:
        RobotError: planning cannot use it.
    """
    element = elements[name]
    field, kind = f"joint {name}", element.get("type")
    axis, limit = element.find("axis"), element.find("limit")
    if axis is not None and not read_floats(axis.get("xyz", ""), 3, f"{field}: axis").any():
        raise RobotError(f"{field}: axis", axis.get("xyz"), "must not be zero")
    if limit is None and kind != "continuous":
        raise RobotError(field, kind, "give it a <limit> with lower and upper")
    lower, upper, endless = _read_range(element, field, stated, warnings)
    # The lowest of the rates that are stated; where none is usable, an assumed one.
    lever = SLIDING_LEVER_M if kind == "prismatic" else 1.0
    names = "velocity", "acceleration", "deceleration"
    speed, *rates = (read_number(limit, name, math.inf, field) for name in names)
    usable = {
        "velocity": _lowest_rate([speed, stated.velocity], MAX_VELOCITY),
        "acceleration": _lowest_rate([*rates, stated.acceleration], sys.float_info.max),
    }
    velocity = usable["velocity"] or lever * ANGULAR_VELOCITY
    acceleration = usable["acceleration"] or lever * ANGULAR_ACCELERATION
    # The one form that pinocchio is given.
    element.set("type", "prismatic" if kind == "prismatic" else "revolute")
    if limit is None:
        limit = ET.SubElement(element, "limit")
    numbers = {"lower": lower, "upper": upper, "velocity": velocity, "effort": 0.0}
    limit.attrib = {end: repr(number) for end, number in numbers.items()}
    return Joint(
        JointLimit(lower, upper, velocity, acceleration),
        _read_mimic(name, elements, warnings),
        endless,
        kind == "prismatic",
        tuple(what for what, rate in usable.items() if rate is None),
    )


def _read_range(
    element: ET.Element, field: str, stated: JointLimit, warnings: list[str]
) -> tuple[float, float, bool]:
    """A joint's lower and upper limit, rad or m, and whether it turns without end stops.

    The narrowest counts of the URDF's range, of what else is stated, and of the soft limits that
    MoveIt keeps to.
    """
    kind, limit = element.get("type"), element.find("limit")
    # The range of the URDF.
    lower, upper = (read_number(limit, end, 0.0, field) for end in ("lower", "upper"))
    if math.isnan(lower) or math.isnan(upper) or lower > upper:
        raise RobotError(field, (lower, upper), "give lower <= upper")
    if kind == "continuous" or (kind == "revolute" and math.isinf(upper - lower)):
        lower, upper = -CONTINUOUS_RANGE, CONTINUOUS_RANGE
    # The narrower of it and what else is stated, then the soft limits.
    around = (lower, upper)
    lower, upper = max(lower, stated.lower), min(upper, stated.upper)
    if lower > upper:
        remedy = f"leaves nothing of the URDF's range with {FIELD}; make them fit each other"
        raise RobotError(field, (lower, upper), remedy)
    if kind != "continuous" and lower < upper:
        lower, upper = _within_soft_limits(element, field, lower, upper, warnings)
    if math.isinf(upper - lower):
        raise RobotError(field, (lower, upper), "give a prismatic joint finite limits in metres")
    if lower == upper:
        warnings.append(f"{field} has the empty range [{lower:g}, {upper:g}]: it cannot move")
    return lower, upper, (lower, upper) == around == (-CONTINUOUS_RANGE, CONTINUOUS_RANGE)


def _within_soft_limits(
    element: ET.Element, field: str, lower: float, upper: float, warnings: list[str]
) -> tuple[float, float]:
    """The range with the soft limits of the joint's safety controller, as MoveIt takes them.

    What is no number, as a variable that nobody replaced, and what leaves no range, is told and
    ignored. One that is not stated is 0, as for urdfdom.
    """
    # The soft limits as they are written.
    names = ("soft_lower_limit", "soft_upper_limit")
    safety = element.find("safety_controller")
    texts = [None if safety is None else safety.get(name) for name in names]
    if texts == [None, None]:
        return lower, upper
    try:
        soft = [float(text or 0.0) for text in texts]
    except ValueError:
        soft = [math.nan, math.nan]
    # They count where they leave a range.
    inside = max(lower, soft[0]), min(upper, soft[1])
    if inside[0] < inside[1] and all(map(math.isfinite, soft)):
        return inside
    said = f"{field}: the soft limits [{texts[0] or 0}, {texts[1] or 0}] of its safety_controller"
    warnings.append(f"{said} leave nothing of [{lower:g}, {upper:g}], and are ignored")
    return lower, upper


def _lowest_rate(rates: Sequence[float], most: float) -> float | None:
    """The lowest of those above 0 that are no greater than `most`; None where there is none."""
    return min((rate for rate in rates if 0.0 < rate <= most), default=None)


def _read_mimic(name: str, elements: Mapping[str, ET.Element], warnings: list[str]) -> Mimic | None:
    """The mimic of a joint, followed to a joint that mimics none; None where it names no joint."""
    # From joint to joint, factors and offsets added up.
    multiplier, offset, current = 1.0, 0.0, name
    seen = [name]
    while (mimic := elements[current].find("mimic")) is not None:
        # What one joint does of another, and that one of a third.
        field = f"joint {current}: mimic"
        offset += multiplier * read_number(mimic, "offset", 0.0, field)
        multiplier *= read_number(mimic, "multiplier", 1.0, field)
        current = mimic.get("joint", "")
        if current not in elements or elements[current].get("type") not in MOVABLE:
            words = f"{current!r} is no movable joint of this description"
            warnings.append(f"{field}: {words}, so joint {name} is one by itself")
            return None
        if current in seen:
            raise RobotError(field, current, "joints mimic each other in a circle")
        if not math.isfinite(multiplier) or not math.isfinite(offset):
            raise RobotError(field, (multiplier, offset), "give finite multiplier and offset")
        seen.append(current)
    return None if current == name else Mimic(current, multiplier, offset)
