"""Text of URDF and SRDF: the tree, and the numbers in it, refused with the place where they are."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from xml.parsers import expat

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.types import Array


def read_xml(text: str, field: str) -> ET.Element:
    """The root of URDF or SRDF text, names as they are written: a prefix need not be bound.

    Raises:
        RobotError: not XML, or its root is not <robot>.
    """
    if "<" not in str(text):
        raise RobotError(field, text, "give the text of the file, which is XML")
    # Without namespaces, which need not be bound.
    builder, parser = ET.TreeBuilder(), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    try:
        parser.Parse(text, True)
        root = builder.close()
    except (expat.ExpatError, ValueError) as error:  # ValueError: characters that no XML has
        number = getattr(error, "lineno", 1)
        line = "".join(text.splitlines()[number - 1 : number]).strip()[:60]
        remedy = f"is not XML ({error}); give the whole text of the file"
        raise RobotError(f"{field}, line {number}", line, remedy) from error
    if root.tag != "robot":
        raise RobotError(field, f"<{root.tag}>", "give a file whose root element is <robot>")
    return root


def read_number(element: ET.Element | None, attribute: str, default: float, field: str) -> float:
    """A number, which need not be finite; the default where the element or attribute is missing.

    Raises:
        RobotError: anything else.
    """
    text = None if element is None else element.get(attribute)
    try:
        return default if text is None else float(text)
    except ValueError as error:
        raise RobotError(f"{field}: {attribute}", text, "give a number") from error


def read_floats(text: str, count: int, field: str) -> Array:
    """`count` finite numbers separated by spaces.

    Raises:
        RobotError: anything else.
    """
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.empty(0)
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
    given = {} if origin is None else origin.attrib
    xyz, rpy = (
        read_floats(given.get(name, "0 0 0"), 3, f"{field}: origin {name}")
        for name in ("xyz", "rpy")
    )
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
