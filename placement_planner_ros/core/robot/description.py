"""URDF text: read as urdfdom does, checked, and brought to one form.

In that form every movable joint has one coordinate with limits, and every origin its rotation as
roll, pitch and yaw. What a description leaves open is decided once, and said in `warnings`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.errors import RobotError, listed
from placement_planner_ros.core.robot.joint_limits import FIELD, JointLimit
from placement_planner_ros.core.robot.joints import MOVABLE, Joint, read_joint
from placement_planner_ros.core.robot.xml_fields import read_floats, read_origin, read_xml

MAX_PARTS = 1000
"""Links that a robot may have, and collision shapes: pairs of them are looked at."""

_KINEMATIC = ("parent", "child", "origin", "axis", "limit")
"""Parts of a joint that say where it is and how it moves."""


def build_model(root: ET.Element) -> pin.Model:
    """Pinocchio's model of links and movable joints, one coordinate each.

    Args:
        root: as `read_urdf` leaves it.

    Raises:
        RobotError: pinocchio refuses it.
    """
    # Links, and of joints what is kinematics: urdfdom refuses more than what is wrong there.
    bare = ET.Element("robot", name=root.get("name", ""))
    for link in root.findall("link"):
        ET.SubElement(bare, "link", name=link.get("name", ""))
    for joint in root.findall("joint"):
        named = {"name": joint.get("name", ""), "type": joint.get("type", "")}
        copy = ET.SubElement(bare, "joint", named)
        copy.extend(part for part in joint if part.tag in _KINEMATIC)
    try:
        return pin.buildModelFromXML(ET.tostring(bare, encoding="unicode"))
    except (RuntimeError, ValueError) as error:  # as C++ raises at what it is given
        raise RobotError("`urdf`", root.get("name"), f"is refused: {error}") from error


def read_urdf(
    text: str, limits: Mapping[str, JointLimit] | None = None
) -> tuple[ET.Element, dict[str, Joint], list[str]]:
    """Read URDF `text`.

    Args:
        limits: what else is stated of joints. The narrower range and the lower rates count.

    Returns:
        the normalised XML tree; movable joints by name; and sentences on what was decided where
        the URDF was silent.

    Raises:
        RobotError: not XML, too much of it, not a tree of links, a joint of a kind or with a range
            that planning cannot use.
    """
    root, limits = read_xml(text, "`urdf`"), limits or {}
    # The tree, and rotations in the one form that is read below.
    _check_tree(root)
    warnings = [*_unexpanded_xacro(root), *_rotations_as_rpy(root)]
    # Joints one by one, movable ones with their limits.
    elements = {e.get("name", ""): e for e in root.findall("joint")}
    joints = {}
    for name, element in elements.items():
        read_origin(element, f"joint {name}")
        kind = element.get("type", "")
        if kind in MOVABLE:
            joints[name] = read_joint(name, elements, limits.get(name, JointLimit()), warnings)
        elif kind != "fixed":
            words = "only fixed, revolute, continuous and prismatic joints have one coordinate;"
            words += " fix this joint or replace it by a chain of those"
            raise RobotError(f"joint {name}", kind, words)
    # What is said of joints must be said of these.
    if strangers := sorted(set(limits) - set(joints)):
        names = listed(strangers)
        warnings.append(f"{FIELD} has limits of {names}, no movable joints of the URDF")
    warnings += _only_drawn(root)
    return root, joints, warnings


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
    known = root.get("version", "1.0") != "1.0"
    # Each becomes roll, pitch and yaw.
    for origin in turned:
        text, field = origin.attrib.pop("quat_xyzw"), "origin quat_xyzw"
        if not known:
            continue
        xyzw = read_floats(text, 4, field)
        if origin.get("rpy") is not None:
            raise RobotError(field, text, "stands beside rpy; give one of the two")
        if not xyzw.any():
            raise RobotError(field, text, "is no rotation; give x y z w")
        R = pin.Quaternion(xyzw / np.linalg.norm(xyzw)).toRotationMatrix()
        origin.set("rpy", " ".join(map(repr, pin.rpy.matrixToRpy(R).tolist())))
    words = "quat_xyzw is of URDF 1.1 and ignored, as everywhere; write <robot version='1.1'>"
    return [f"{len(turned)} origins: {words}"] if turned and not known else []


def _only_drawn(root: ET.Element) -> list[str]:
    """A sentence on links that are to be seen but nothing to collision checks, if any."""
    drawn = [
        link.get("name", "")
        for link in root.findall("link")
        if link.find("visual") is not None and link.find("collision") is None
    ]
    what = "links with <visual> but no <collision>, which nothing is kept away from"
    names = listed(drawn)
    return [f"{names}: {what}; give them one where they are solid"] if drawn else []


def _check_tree(root: ET.Element) -> None:
    """Refuse what is not one tree of links with names of their own."""
    # Not too many, and names of their own: a second one of a name would stand in for the first.
    links, joints = ([e.get("name", "") for e in root.findall(tag)] for tag in ("link", "joint"))
    shapes = len(root.findall("link/collision"))
    if not links or max(len(links), shapes) > MAX_PARTS:
        words = f"{len(links)} links, {shapes} collision shapes"
        raise RobotError("`urdf`", words, f"a robot has 1 to {MAX_PARTS} links, and as few shapes")
    for name, count in [*Counter(links).items(), *Counter(joints).items()]:
        if count > 1 or not name:
            raise RobotError("`urdf`", name, "occurs twice, or is none; names are unique")
    # Each link below one joint at most, and all of them below the same root.
    parents: dict[str, str] = {}
    for name, joint in zip(joints, root.findall("joint"), strict=True):
        parent, child = (_end_of(joint, end, links) for end in ("parent", "child"))
        if child in parents:
            raise RobotError(f"link {child}", name, "a link is the child of one joint only")
        parents[child] = parent
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
        field = f"joint {joint.get('name')}: {end}"
        raise RobotError(field, link, "name a link of this description")
    return link
