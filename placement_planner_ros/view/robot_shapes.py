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
    shape = geometry[0] if geometry is not None and len(geometry) else None
    tag = "" if shape is None else shape.tag
    if shape is not None and tag == "mesh":
        vertices, triangles = read_mesh(find(shape.get("filename", "")))
        return vertices * read_floats(shape.get("scale", "1 1 1"), 3, field), triangles

    def size(name: str, count: int = 1) -> list[float]:
        assert shape is not None
        return read_floats(shape.get(name, ""), count, f"{field}: {name}").tolist()

    if tag == "box":
        made = trimesh.creation.box(size("size", 3))
    elif tag == "sphere":
        made = trimesh.creation.icosphere(subdivisions=2, radius=size("radius")[0])
    elif tag == "cylinder":
        made = trimesh.creation.cylinder(size("radius")[0], size("length")[0], sections=24)
    elif tag == "capsule":
        made = trimesh.creation.capsule(size("length")[0], size("radius")[0], count=[12, 12])
    else:
        raise RobotError(field, tag, "is no shape of a URDF")
    return np.asarray(made.vertices, np.float64), np.asarray(made.faces, np.int64)
