"""Collision meshes and primitives of a robot's URDF, link by link: what the planner checks."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.meshes.read import UNREADABLE, read_mesh
from placement_planner_ros.core.robot.xml_fields import read_floats, read_origin
from placement_planner_ros.core.types import Array, Index

FindFile = Callable[[str], Path]
"""The file that a mesh's URI names. Raises an OSError where there is none."""
Surface = tuple[Array, Index]
"""Vertices (n, 3), metres, and triangles (t, 3)."""


def link_shapes(urdf: ET.Element, find: FindFile) -> tuple[dict[str, Surface], list[str]]:
    """Of each link with collision elements that can be drawn its surface, by its name and in its
    frame, and in words what cannot."""
    shapes: dict[str, Surface] = {}
    lacking = []
    for link in urdf.findall("link"):
        name, elements = link.get("name", ""), link.findall("collision")
        if not elements:
            continue
        try:
            shapes[name] = _joined_shapes(elements, f"link {name}", find)
        except (RobotError, *UNREADABLE) as error:
            lacking.append(f"link {name}: {error}")
    return shapes, lacking


def _joined_shapes(elements: list[ET.Element], field: str, find: FindFile) -> Surface:
    """All shapes of a link as one mesh in the link's frame."""
    vertices, triangles, count = [], [], 0
    for element in elements:
        # each element has an origin of its own in the link
        corners, faces = _shape_mesh(element, field, find)
        T_link_shape = read_origin(element, field)
        vertices.append(corners @ T_link_shape.rotation.T + T_link_shape.translation)
        triangles.append(faces + count)
        count += len(corners)
    return np.vstack(vertices), np.vstack(triangles)


def _shape_mesh(element: ET.Element, field: str, find: FindFile) -> Surface:
    """One shape in its own frame."""
    # the first child is the shape
    geometry = element.find("geometry")
    shape = geometry[0] if geometry is not None and len(geometry) else ET.Element("")
    if shape.tag == "mesh":
        vertices, triangles = read_mesh(find(shape.get("filename", "")))
        return vertices * read_floats(shape.get("scale", "1 1 1"), 3, field), triangles
    if shape.tag not in _PRIMITIVES:
        raise RobotError(field, shape.tag, "is no shape of a URDF")
    make, count = _PRIMITIVES[shape.tag]
    sizes = " ".join(shape.get(name, "") for name in ("size", "radius", "length"))
    made = make(read_floats(sizes, count, field).tolist())
    return np.asarray(made.vertices, np.float64), np.asarray(made.faces, np.int64)


_PRIMITIVES: dict[str, tuple[Callable[[list[float]], trimesh.Trimesh], int]] = {
    "box": (trimesh.creation.box, 3),
    "sphere": (lambda s: trimesh.creation.icosphere(subdivisions=2, radius=s[0]), 1),
    "cylinder": (lambda s: trimesh.creation.cylinder(s[0], s[1], sections=24), 2),
    "capsule": (lambda s: trimesh.creation.capsule(s[1], s[0], count=[12, 12]), 2),
}
"""URDF shape -> what draws it, and how many sizes it has: size, or radius and length."""
