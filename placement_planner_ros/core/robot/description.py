"""URDF text: read, checked, and brought to one coordinate per movable joint.

What a description leaves open or states badly is decided here, once, and said in `warnings`:
a continuous joint gets a range that no plan comes to the end of, a missing or useless velocity
limit a cautious default.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.robot.joint_limits import (
    ANGULAR_ACCELERATION,
    FIELD,
    LINEAR_ACCELERATION,
    Assumed,
    JointLimit,
)
from placement_planner_ros.core.types import Array

DEFAULT_ANGULAR_VELOCITY = 1.0
"""rad/s, for a revolute joint whose URDF states no usable velocity limit."""

DEFAULT_LINEAR_VELOCITY = 0.1
"""m/s, the same for a prismatic joint."""

MAX_VELOCITY = 100.0
"""Velocity limits above this (rad/s or m/s) are read as "not stated"."""

CONTINUOUS_RANGE = 2.25 * math.pi
"""rad to either side of zero, for joints without an end stop: a plan begins within half a turn of
zero (`Robot.unwound`) and ends within half a turn of there, and has room beyond for an approach."""

MOVABLE = ("revolute", "continuous", "prismatic")

MAX_TEXT = 5_000_000
"""Characters that a description may have."""

MAX_LINKS = 500
"""Links that a robot may have."""

MAX_JOINTS = 300
"""Movable joints that a robot may have: what its kinematics need grows with their cube."""

MAX_ATTRIBUTES = 100
"""Attributes that one element may have: what reads URDF compares each with all others."""

_NAMED = 5
"""Joints that are named at most."""

MAX_DEPTH = 50
"""Elements that may lie within each other: what reads URDF calls itself for each."""


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
        name: of the joint.
        lower, upper: its range, rad or m.
        velocity: its limit, rad/s or m/s.
        mimic: what it follows.
        continuous: whether it turns without end stops.
        prismatic: whether it slides.
        acceleration: its limit, rad/s² or m/s²; None where nobody states one.
        assumed: the limits that nobody states, and what they are taken to be.
    """

    name: str
    lower: float
    upper: float
    velocity: float
    mimic: Mimic | None
    continuous: bool = False
    prismatic: bool = False
    acceleration: float | None = None
    assumed: tuple[Assumed, ...] = ()


@dataclass(frozen=True, slots=True)
class Description:
    """A URDF that is known to be sound.

    Attributes:
        root: the normalised XML tree; every movable joint is revolute or prismatic with limits.
        joints: movable joints by name.
        warnings: sentences on what was decided where the URDF was silent.
    """

    root: ET.Element
    joints: dict[str, Joint]
    warnings: tuple[str, ...]

    @property
    def text(self) -> str:
        """The normalised URDF."""
        return ET.tostring(self.root, encoding="unicode")


class _Bounded(ET.TreeBuilder):
    """Builds a tree that is neither deep nor has elements with very many attributes."""

    def __init__(self, field: str) -> None:
        super().__init__()
        self._field = field
        self._depth = 0

    def start(self, tag: str, attrs: dict[str, str], /) -> ET.Element:
        """An element begins."""
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise RobotError(
                self._field, f"<{tag}>", f"lies within more than {MAX_DEPTH} other elements"
            )
        if len(attrs) > MAX_ATTRIBUTES:
            raise RobotError(
                self._field,
                f"<{tag}> with {len(attrs)} attributes",
                f"an element may have {MAX_ATTRIBUTES}",
            )
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ET.Element:
        """An element ends."""
        self._depth -= 1
        return super().end(tag)


def read_xml(text: str, field: str) -> ET.Element:
    """The root of URDF or SRDF text.

    Raises:
        RobotError: not XML, or beyond `MAX_TEXT`, `MAX_DEPTH` or `MAX_ATTRIBUTES`.
    """
    if not isinstance(text, str):
        raise RobotError(field, text, "give the text of the file, not its path")
    if len(text) > MAX_TEXT:
        raise RobotError(
            field, f"{len(text)} characters", f"is longer than {MAX_TEXT}; simplify it"
        )
    try:
        return ET.fromstring(text, ET.XMLParser(target=_Bounded(field)))
    except (ET.ParseError, ValueError) as error:  # ValueError: characters that no XML has
        remedy = f"is not XML ({error}); give the text of the file"
        raise RobotError(field, text[:60], remedy) from error


def read_urdf(text: str, limits: Mapping[str, JointLimit] | None = None) -> Description:
    """Read URDF `text`.

    Args:
        limits: what else is stated of joints. The narrower range and the lower velocity count.

    Raises:
        RobotError: not XML, too much of it, not a tree of links, a joint of a kind or with a range
            that planning cannot use.
    """
    root = read_xml(text, "robot_description")
    if root.tag != "robot":
        raise RobotError(
            "robot_description", f"<{root.tag}>", "give a URDF: its root element is <robot>"
        )
    _check_tree(root)
    warnings: list[str] = []
    elements = {_name(e): e for e in root.findall("joint")}
    joints = {}
    for name, element in elements.items():
        read_origin(element, f"joint {name}")
        kind = element.get("type", "")
        if kind in MOVABLE:
            limit = (limits or {}).get(name, JointLimit())
            joints[name] = _read_joint(name, element, elements, limit, warnings)
        elif kind != "fixed":
            raise RobotError(
                f"joint {name}",
                kind,
                "only fixed, revolute, continuous and prismatic joints have one coordinate;"
                " fix this joint or replace it by a chain of those",
            )
    strangers = sorted(set(limits or {}) - set(joints))
    if strangers:
        warnings.append(
            f"{FIELD} has limits of {', '.join(strangers[:_NAMED])}"
            f"{' and others' if len(strangers) > _NAMED else ''}, no movable joints of the URDF"
        )
    if len(joints) > MAX_JOINTS:
        raise RobotError(
            "robot_description",
            f"{len(joints)} movable joints",
            f"is more than a robot may have, {MAX_JOINTS}; fix those that planning can do without",
        )
    warnings += _only_drawn(root)
    return Description(root, joints, tuple(warnings))


def _only_drawn(root: ET.Element) -> list[str]:
    """A sentence on links that are to be seen but nothing to collision checks, if any."""
    drawn = [
        _name(link)
        for link in root.findall("link")
        if link.find("visual") is not None and link.find("collision") is None
    ]
    if not drawn:
        return []
    names = ", ".join(drawn[:_NAMED]) + (
        f" and {len(drawn) - _NAMED} more" if drawn[_NAMED:] else ""
    )
    what = "links with <visual> but no <collision>, which nothing is kept away from"
    return [f"{names}: {what}; give them one where they are solid"]


def read_floats(text: str, count: int, field: str) -> Array:
    """`count` finite numbers separated by spaces.

    Raises:
        RobotError: anything else.
    """
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError as error:
        raise RobotError(field, text, f"give {count} numbers") from error
    if values.shape != (count,) or not np.isfinite(values).all():
        raise RobotError(field, text, f"give {count} finite numbers")
    return values


def read_origin(element: ET.Element, field: str) -> pin.SE3:
    """The <origin> of a joint or collision element, identity where there is none.

    Raises:
        RobotError: not three finite numbers each for xyz and rpy.
    """
    origin = element.find("origin")
    if origin is None:
        return pin.SE3.Identity()
    xyz = read_floats(origin.get("xyz", "0 0 0"), 3, f"{field}: origin xyz")
    rpy = read_floats(origin.get("rpy", "0 0 0"), 3, f"{field}: origin rpy")
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def _name(element: ET.Element) -> str:
    name = element.get("name")
    if not name:
        raise RobotError("robot_description", f"<{element.tag}>", "give the element a name")
    return name


def _check_tree(root: ET.Element) -> None:
    links = [_name(e) for e in root.findall("link")]
    if not links:
        raise RobotError("robot_description", root.get("name"), "has no links")
    if len(links) > MAX_LINKS:
        raise RobotError(
            "robot_description",
            f"{len(links)} links",
            f"a robot may have {MAX_LINKS}",
        )
    parents: dict[str, str] = {}
    for names in (links, [_name(e) for e in root.findall("joint")]):
        for name in names:
            if names.count(name) > 1:
                raise RobotError("robot_description", name, "occurs twice; names are unique")
    for joint in root.findall("joint"):
        ends = {}
        for end in ("parent", "child"):
            element = joint.find(end)
            link = element.get("link") if element is not None else None
            if link not in links:
                raise RobotError(
                    f"joint {_name(joint)}: {end}", link, "name a link of this description"
                )
            ends[end] = str(link)
        if ends["child"] in parents:
            raise RobotError(
                f"link {ends['child']}", _name(joint), "a link is the child of one joint only"
            )
        parents[ends["child"]] = ends["parent"]
    roots = [link for link in links if link not in parents]
    if not roots:
        raise RobotError(
            f"link {links[0]}", parents[links[0]], "the joints above it form a loop, as all do"
        )
    if len(roots) > 1:
        raise RobotError(
            "robot_description", roots, "are the roots of several trees; add a fixed joint between"
        )
    for link in links:
        above = link
        for _ in links:
            above = parents.get(above, roots[0])
        if above != roots[0]:
            raise RobotError(f"link {link}", above, "the joints above it form a loop")


def _number(element: ET.Element | None, attribute: str, default: float, field: str) -> float:
    text = element.get(attribute) if element is not None else None
    if text is None:
        return default
    try:
        return float(text)
    except ValueError as error:
        raise RobotError(f"{field}: {attribute}", text, "give a number") from error


def _read_joint(
    name: str,
    element: ET.Element,
    elements: dict[str, ET.Element],
    stated: JointLimit,
    warnings: list[str],
) -> Joint:
    field = f"joint {name}"
    kind = element.get("type")
    axis = element.find("axis")
    if axis is not None and not read_floats(axis.get("xyz", ""), 3, f"{field}: axis").any():
        raise RobotError(f"{field}: axis", axis.get("xyz"), "must not be zero")
    limit = element.find("limit")
    if limit is None and kind != "continuous":
        raise RobotError(field, kind, "give it a <limit> with lower and upper")
    lower = _number(limit, "lower", 0.0, field)
    upper = _number(limit, "upper", 0.0, field)
    velocity = _number(limit, "velocity", math.nan, field)
    if math.isnan(lower) or math.isnan(upper) or lower > upper:
        raise RobotError(field, (lower, upper), "give lower <= upper")
    endless = kind == "continuous" or (kind == "revolute" and math.isinf(upper - lower))
    if endless:
        lower, upper = -CONTINUOUS_RANGE, CONTINUOUS_RANGE
    lower = lower if stated.lower is None else max(lower, stated.lower)
    upper = upper if stated.upper is None else min(upper, stated.upper)
    if lower > upper:
        remedy = f"leaves nothing of the URDF's range with {FIELD}; make them fit each other"
        raise RobotError(field, (lower, upper), remedy)
    if math.isinf(upper - lower):
        raise RobotError(field, (lower, upper), "give a prismatic joint finite limits in metres")
    if endless and (lower, upper) != (-CONTINUOUS_RANGE, CONTINUOUS_RANGE):
        endless = False
    if lower == upper:
        warnings.append(f"{field} has the empty range [{lower:g}, {upper:g}]: it cannot move")
    angular, assumed = kind != "prismatic", []
    if stated.velocity is not None:
        velocity = min(velocity, stated.velocity) if velocity > 0.0 else stated.velocity
    if not 0.0 < velocity <= MAX_VELOCITY:
        default = DEFAULT_ANGULAR_VELOCITY if angular else DEFAULT_LINEAR_VELOCITY
        unit = "rad/s" if angular else "m/s"
        warnings.append(f"{field} has no usable velocity limit: planned with {default:g} {unit}")
        velocity = default
        assumed.append(Assumed(name, "velocity", velocity, unit))
    if stated.acceleration is None:
        default = ANGULAR_ACCELERATION if angular else LINEAR_ACCELERATION
        unit = "rad/s^2" if angular else "m/s^2"
        assumed.append(Assumed(name, "acceleration", default, unit))

    element.set("type", "prismatic" if kind == "prismatic" else "revolute")
    if limit is None:
        limit = ET.SubElement(element, "limit")
    limit.attrib.update(lower=repr(lower), upper=repr(upper), velocity=repr(velocity))
    limit.attrib.setdefault("effort", "0")
    mimic = _read_mimic(name, elements)
    return Joint(
        name,
        lower,
        upper,
        velocity,
        mimic,
        endless,
        not angular,
        stated.acceleration,
        tuple(assumed),
    )


def _read_mimic(name: str, elements: dict[str, ET.Element]) -> Mimic | None:
    """The mimic of a joint, followed to a joint that mimics none."""
    multiplier, offset, current = 1.0, 0.0, name
    seen = [name]
    while (mimic := elements[current].find("mimic")) is not None:
        field = f"joint {current}: mimic"
        offset += multiplier * _number(mimic, "offset", 0.0, field)
        multiplier *= _number(mimic, "multiplier", 1.0, field)
        current = mimic.get("joint", "")
        if current not in elements or elements[current].get("type") not in MOVABLE:
            raise RobotError(field, current, "name a movable joint of this description")
        if current in seen:
            raise RobotError(field, current, "joints mimic each other in a circle")
        if not math.isfinite(multiplier) or not math.isfinite(offset):
            raise RobotError(field, (multiplier, offset), "give finite multiplier and offset")
        seen.append(current)
    return None if current == name else Mimic(current, multiplier, offset)
