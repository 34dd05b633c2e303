"""Fewer triangles for a robot, as a browser without a graphics card has to draw each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh

from placement_planner_ros.view.robot_shapes import LinkShape

MOST_OF_ROBOT = 25_000
"""Triangles of all links together."""
_KEPT_TRIANGLES = 500
"""Of a link that stays as it is."""
_SIDES_M = np.geomspace(0.002, 0.05, 13)
"""Sides of the cubes whose vertices become one, tried from the finest on."""


def coarse_enough(shapes: Sequence[LinkShape], most: int = MOST_OF_ROBOT) -> list[LinkShape]:
    """The shapes, made as coarse as leaves at most so many triangles, all to the same degree."""
    found = list(shapes)
    for side in _SIDES_M:
        if sum(len(shape.triangles) for shape in found) <= most:
            break
        found = [_coarser_shape(shape, side) for shape in shapes]
    return found


def _coarser_shape(shape: LinkShape, side: float) -> LinkShape:
    """A surface whose vertices in one cube of that side, metres, become one of them."""
    if len(shape.triangles) <= _KEPT_TRIANGLES:
        return shape
    mesh = trimesh.Trimesh(shape.vertices / side, shape.triangles, process=False)
    mesh.merge_vertices(digits_vertex=0)
    mesh.update_faces(mesh.nondegenerate_faces() & mesh.unique_faces())
    return replace(shape, vertices=side * mesh.vertices, triangles=np.asarray(mesh.faces))
