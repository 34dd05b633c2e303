"""URDF text: read as urdfdom does, checked, and brought to one form.

In that form every movable joint has one coordinate with limits, and every origin its rotation as
roll, pitch and yaw. What a description leaves open or states badly is decided here, once, and said
in `warnings`: a continuous joint gets a range that no plan comes to the end of, a useless
velocity limit a cautious default.
"""

from __future__ import annotations

import math
import sys
import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from xml.parsers import expat

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.errors import RobotError, listed
from placement_planner_ros.core.robot.joint_limits import FIELD, Assumed, JointLimit, assumed_rate
from placement_planner_ros.core.types import Array

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
        velocity, acceleration: their limits, rad/s and rad/s², or m/s and m/s².
        mimic: what it follows.
        continuous: whether it turns without end stops.
        prismatic: whether it slides.
        assumed: those of the limits that nobody states.
    """

    name: str
    lower: float
    upper: float
    velocity: float
    acceleration: float
    mimic: Mimic | None
    continuous: bool
    prismatic: bool
    assumed: tuple[Assumed, ...]


@dataclass(frozen=True, slots=True)
class Description:
    """A URDF that is known to be sound.

    Attributes:
        root: the normalised XML tree.
        joints: movable joints by name.
        warnings: sentences on what was decided where the URDF was silent.
    """

    root: ET.Element
    joints: dict[str, Joint]
    warnings: tuple[str, ...]

    def build_model(self) -> pin.Model:
        """Pinocchio's model of links and movable joints, one coordinate each.

        Raises:
            RobotError: pinocchio refuses it.
        """
        # Links, and of joints what is kinematics.
        bare = ET.Element("robot", name=self.root.get("name", ""))
        for link in self.root.findall("link"):
            ET.SubElement(bare, "link", name=_name_of(link))
        for joint in self.root.findall("joint"):
            # what urdfdom would refuse a joint for that has been read here is left out
            copy = ET.SubElement(bare, "joint", name=_name_of(joint), type=joint.get("type", ""))
            for part in joint:
                if part.tag in _KINEMATIC:
                    known = {a: v for a, v in part.attrib.items() if a in _KINEMATIC[part.tag]}
                    ET.SubElement(copy, part.tag, known)
        try:
            return pin.buildModelFromXML(ET.tostring(bare, encoding="unicode"))
        except (RuntimeError, ValueError) as error:  # as C++ raises at what it is given
            raise RobotError("`urdf`", self.root.get("name"), f"is refused: {error}") from error


_KINEMATIC = {
    "parent": ("link",),
    "child": ("link",),
    "origin": ("xyz", "rpy"),
    "axis": ("xyz",),
    "limit": ("lower", "upper", "velocity", "effort"),
}
"""Parts of a joint that say where it is and how it moves, and their attributes."""


def read_xml(text: str, field: str) -> ET.Element:
    """The root of URDF or SRDF text, names as they are written: a prefix need not be bound.

    Raises:
        RobotError: not XML, or longer than `MAX_TEXT`.
    """
    if not isinstance(text, str):
        raise RobotError(field, text, "give the text of the file, not its path")
    if len(text) > MAX_TEXT:
        raise RobotError(
            field, f"{len(text)} characters", f"is longer than {MAX_TEXT}; simplify it"
        )
    # Without namespaces, which need not be bound.
    builder, parser = ET.TreeBuilder(), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    try:
        parser.Parse(text, True)
        return builder.close()
    except expat.ExpatError as error:
        lines = text.splitlines()
        if not text.strip():
            raise RobotError(field, text, "is empty; give the text of the file") from error
        # what ends within an element was cut, or has lost an end tag
        cut = error.lineno >= len(lines) and "<" in text
        line = lines[min(error.lineno, len(lines)) - 1].strip()
        remedy = (
            f"ends before it is complete ({error}); give the whole text of the file"
            if cut
            else f"is not XML ({error}); give the text of the file"
        )
        raise RobotError(f"{field}, line {error.lineno}", line[:60], remedy) from error
    except ValueError as error:  # characters that no XML has
        remedy = f"is not XML ({error}); give the text of the file"
        raise RobotError(field, text[:60], remedy) from error


def read_urdf(text: str, limits: Mapping[str, JointLimit] | None = None) -> Description:
    """Read URDF `text`.

    Args:
        limits: what else is stated of joints. The narrower range and the lower rates count.

    Raises:
        RobotError: not XML, too much of it, not a tree of links, a joint of a kind or with a range
            that planning cannot use.
    """
    root, limits = read_xml(text, "`urdf`"), limits or {}
    # The right kind of file.
    if root.tag != "robot":
        raise RobotError("`urdf`", f"<{root.tag}>", "give a URDF: its root element is <robot>")
    # The tree, and rotations in the one form that is read below.
    _check_tree(root)
    warnings = [*_unexpanded_xacro(root), *_rotations_as_rpy(root)]
    # Joints one by one, movable ones with their limits.
    elements = {_name_of(e): e for e in root.findall("joint")}
    joints = {}
    for name, element in elements.items():
        read_origin(element, f"joint {name}")
        kind = element.get("type", "")
        if kind in MOVABLE:
            stated = limits.get(name, JointLimit())
            joints[name] = _read_joint(name, element, elements, stated, warnings)
        elif kind != "fixed":
            raise RobotError(
                f"joint {name}",
                kind,
                "only fixed, revolute, continuous and prismatic joints have one coordinate;"
                " fix this joint or replace it by a chain of those",
            )
    # What is said of joints must be said of these.
    if strangers := sorted(set(limits) - set(joints)):
        names = listed(strangers)
        warnings.append(f"{FIELD} has limits of {names}, no movable joints of the URDF")
    warnings += _only_drawn(root)
    return Description(root, joints, tuple(warnings))


def _unexpanded_xacro(root: ET.Element) -> list[str]:
    """A sentence on xacro that nobody has expanded, if any: like urdfdom, nobody here reads it."""
    found = sorted({each.tag for each in root.iter() if each.tag.startswith("xacro:")})
    names = listed([f"<{tag}>" for tag in found])
    return [f"{names}: ignored; expand the file by xacro where it matters"] if found else []


def _rotations_as_rpy(root: ET.Element) -> list[str]:
    """Write the quaternions of URDF 1.1 as the angles that every reader knows.

    Returns:
        a sentence on those of URDF 1.0, which has none: urdfdom does not read them either.

    Raises:
        RobotError: an origin has both, or four numbers that are no quaternion.
    """
    turned = [origin for origin in root.iter("origin") if origin.get("quat_xyzw") is not None]
    if turned and root.get("version", "1.0") == "1.0":
        words = "quat_xyzw is of URDF 1.1 and ignored, as everywhere; write <robot version='1.1'>"
        return [f"{len(turned)} origins: {words}"]
    # Each becomes roll, pitch and yaw.
    for origin in turned:
        text = origin.attrib.pop("quat_xyzw")
        xyzw = read_floats(text, 4, "origin quat_xyzw")
        if origin.get("rpy") is not None:
            raise RobotError("origin quat_xyzw", text, "stands beside rpy; give one of the two")
        if not xyzw.any():
            raise RobotError("origin quat_xyzw", text, "is no rotation; give x y z w")
        R = pin.Quaternion(xyzw / np.linalg.norm(xyzw)).toRotationMatrix()
        origin.set("rpy", " ".join(map(repr, pin.rpy.matrixToRpy(R).tolist())))
    return []


def _only_drawn(root: ET.Element) -> list[str]:
    """A sentence on links that are to be seen but nothing to collision checks, if any."""
    drawn = [
        _name_of(link)
        for link in root.findall("link")
        if link.find("visual") is not None and link.find("collision") is None
    ]
    what = "links with <visual> but no <collision>, which nothing is kept away from"
    names = listed(drawn)
    return [f"{names}: {what}; give them one where they are solid"] if drawn else []


def read_floats(text: str, count: int, field: str) -> Array:
    """`count` finite numbers separated by spaces.

    Raises:
        RobotError: anything else.
    """
    try:
        # So many finite numbers.
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
    # Nothing said is no offset.
    origin = element.find("origin")
    if origin is None:
        return pin.SE3.Identity()
    xyz = read_floats(origin.get("xyz", "0 0 0"), 3, f"{field}: origin xyz")
    rpy = read_floats(origin.get("rpy", "0 0 0"), 3, f"{field}: origin rpy")
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def _name_of(element: ET.Element) -> str:
    name = element.get("name")
    if not name:
        raise RobotError("`urdf`", f"<{element.tag}>", "give the element a name")
    return name


def _check_tree(root: ET.Element) -> None:
    # Names that are there once.
    links, joints = ([_name_of(e) for e in root.findall(tag)] for tag in ("link", "joint"))
    if not 0 < len(links) <= MAX_LINKS:
        words = f"{len(links)} links"
        raise RobotError("`urdf`", words, f"a robot has 1 to {MAX_LINKS}")
    # A second one of a name would stand in for the first.
    twice = [name for names in (links, joints) for name in set(names) if names.count(name) > 1]
    if twice:
        raise RobotError("`urdf`", min(twice), "occurs twice; names are unique")
    # Each link below one joint at most, and all of them below the same root.
    parents: dict[str, str] = {}
    for name, joint in zip(joints, root.findall("joint"), strict=True):
        parent, child = (_end_of(joint, end, links) for end in ("parent", "child"))
        if child in parents:
            raise RobotError(f"link {child}", name, "a link is the child of one joint only")
        parents[child] = parent
    # One link that nothing carries.
    roots = [link for link in links if link not in parents]
    if len(roots) > 1:
        raise RobotError(
            "`urdf`", roots, "are the roots of several trees; add a fixed joint between"
        )
    # What no way from the root leads to hangs on itself.
    reached: set[str] = set(roots)
    while more := {link for link in parents if parents[link] in reached} - reached:
        reached |= more
    if looped := [link for link in links if link not in reached]:
        raise RobotError(f"link {looped[0]}", parents[looped[0]], "the joints above it form a loop")


def _end_of(joint: ET.Element, end: str, links: list[str]) -> str:
    element = joint.find(end)
    link = None if element is None else element.get("link")
    if link not in links:
        raise RobotError(f"joint {_name_of(joint)}: {end}", link, "name a link of this description")
    return link


def _number_in(element: ET.Element | None, attribute: str, default: float, field: str) -> float:
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
    field, kind = f"joint {name}", element.get("type")
    # Axis and limits.
    axis, limit = element.find("axis"), element.find("limit")
    if axis is not None and not read_floats(axis.get("xyz", ""), 3, f"{field}: axis").any():
        raise RobotError(f"{field}: axis", axis.get("xyz"), "must not be zero")
    if limit is None and kind != "continuous":
        raise RobotError(field, kind, "give it a <limit> with lower and upper")
    lower, upper, endless = _read_range(element, field, stated, warnings)
    prismatic, assumed = kind == "prismatic", []
    # Rates, assumed where nobody states them.
    velocity = _lowest_rate(limit, ("velocity",), stated.velocity, MAX_VELOCITY, field)
    if velocity is None:
        assumed.append(rate := assumed_rate(name, "velocity", prismatic=prismatic))
        words = f"planned with {rate.value:g} {rate.unit}"
        warnings.append(f"{field} has no usable velocity limit: {words}")
        velocity = rate.value
    both = ("acceleration", "deceleration")
    acceleration = _lowest_rate(limit, both, stated.acceleration, sys.float_info.max, field)
    if acceleration is None:
        assumed.append(rate := assumed_rate(name, "acceleration", prismatic=prismatic))
        acceleration = rate.value

    # The one form that pinocchio is given.
    element.set("type", "prismatic" if prismatic else "revolute")
    if limit is None:
        limit = ET.SubElement(element, "limit")
    limit.attrib = {
        "lower": repr(lower),
        "upper": repr(upper),
        "velocity": repr(velocity),
        "effort": "0",
    }
    return Joint(
        name,
        lower,
        upper,
        velocity,
        acceleration,
        _read_mimic(name, elements, warnings),
        endless,
        prismatic,
        tuple(assumed),
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
    lower, upper = (_number_in(limit, end, 0.0, field) for end in ("lower", "upper"))
    if math.isnan(lower) or math.isnan(upper) or lower > upper:
        raise RobotError(field, (lower, upper), "give lower <= upper")
    if kind == "continuous" or (kind == "revolute" and math.isinf(upper - lower)):
        lower, upper = -CONTINUOUS_RANGE, CONTINUOUS_RANGE
    # The narrower of it and what else is stated, then the soft limits.
    around = (lower, upper)
    lower = lower if stated.lower is None else max(lower, stated.lower)
    upper = upper if stated.upper is None else min(upper, stated.upper)
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
    said = f"{field}: the soft limits [{texts[0] or 0}, {texts[1] or 0}] of its safety_controller"
    try:
        soft = [float(text or 0.0) for text in texts]
    except ValueError:
        warnings.append(f"{said} are no numbers, and ignored")
        return lower, upper
    # They count where they leave a range.
    inside = max(lower, soft[0]), min(upper, soft[1])
    if not (inside[0] < inside[1] and all(map(math.isfinite, soft))):
        warnings.append(f"{said} leave nothing of [{lower:g}, {upper:g}], and are ignored")
        return lower, upper
    return inside


def _lowest_rate(
    limit: ET.Element | None,
    attributes: Collection[str],
    stated: float | None,
    most: float,
    field: str,
) -> float | None:
    """The lowest of the rates in a <limit> and the one stated elsewhere, up to `most`; or None."""
    rates = [_number_in(limit, attribute, math.nan, field) for attribute in attributes]
    rates += [math.nan if stated is None else stated]
    return min((rate for rate in rates if 0.0 < rate <= most), default=None)


def _read_mimic(name: str, elements: dict[str, ET.Element], warnings: list[str]) -> Mimic | None:
    """The mimic of a joint, followed to a joint that mimics none; None where it names no joint."""
    # From joint to joint, factors and offsets added up.
    multiplier, offset, current = 1.0, 0.0, name
    seen = [name]
    while (mimic := elements[current].find("mimic")) is not None:
        # What one joint does of another, and that one of a third.
        field = f"joint {current}: mimic"
        offset += multiplier * _number_in(mimic, "offset", 0.0, field)
        multiplier *= _number_in(mimic, "multiplier", 1.0, field)
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
