"""Descriptions as `ros2 param load` can read them."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.robot.description import read_xml


def one_line(text: str) -> str:
    """The same XML on one line, without comments; what is no XML stays as it is.

    `ros2 param load` takes each value for YAML, in which a colon before a space, and a hash after
    one, end a text.
    """
    if not text.lstrip().startswith("<"):
        return text
    try:
        root = read_xml(text, "description")
    except RobotError:
        return text  # who reads it tells what is wrong
    for element in root.iter():
        element.text = (element.text or "").strip()
        element.tail = ""
    line = " ".join(ET.tostring(root, encoding="unicode").split())
    return line.replace(": ", ":&#32;").replace(" #", "&#32;#")
