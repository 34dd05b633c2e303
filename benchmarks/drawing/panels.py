"""Pictures of many panels, each a view of a scene with its target volume."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.pictures.picture import (
    OVERSAMPLING,
    PLACED,
    VOLUME,
    averaged,
    box_corners,
    draw_volume,
    moved,
    see_through,
)
from placement_planner_ros.pictures.plots import new_figure
from placement_planner_ros.pictures.rendering import Image, Mesh, Viewpoint, render
from placement_planner_ros.scenes.grasped_object import GraspedObject
from placement_planner_ros.scenes.scenes import Scene

_TITLE, _LEGEND, _GAP = 0.34, 0.40, 0.06
"""Inches: of a panel's title, of the legend, and between panels."""
_SOLUTION_SIZE = (10.0, 7.5)
"""Inches of the picture of a solution."""
_OVER_RIGHT_SHOULDER = (-2.3, 0.62)
"""Azimuth and elevation of the eye, rad."""


def panel_figure(
    number: int, in_a_row: int, size: tuple[float, float], head: float = 0.0
) -> tuple[Figure, list[Axes]]:
    """A figure with panels of that size (inches), row by row, and their axes.

    Args:
        head: inches above all for a title.
    """
    rows = -(-number // in_a_row)
    width, height = in_a_row * size[0], rows * (size[1] + _TITLE) + _LEGEND + head
    figure = new_figure(width, height, constrained=False)
    found = []
    for place in range(number):
        row, column = divmod(place, in_a_row)
        left, bottom = column * size[0] + _GAP / 2, height - head - (row + 1) * (size[1] + _TITLE)
        inches = left / width, bottom / height, (size[0] - _GAP) / width, size[1] / height
        found.append(figure.add_axes(inches))
        found[-1].set_axis_off()
    return figure, found


def panel_view(axes: Axes, shown: Array, towards_eye: tuple[float, float]) -> Viewpoint:
    """A view of points (n, 3) that fills a panel."""
    width, height = (int(side) * OVERSAMPLING for side in axes.bbox.size)
    return Viewpoint.around(shown, *towards_eye, width, height)


def show_image(axes: Axes, view: Viewpoint, image: Image, volume: TargetVolume) -> None:
    """What was rendered, with the edges of V."""
    extent = (0, view.width, view.height, 0)
    colours = averaged(image.colours)
    axes.imshow(colours, extent=extent, interpolation="nearest", aspect="auto")
    draw_volume(axes, view, image, volume)
    axes.set_xlim(0, view.width)
    axes.set_ylim(view.height, 0)


def show_legend(figure: Figure, entries: Sequence[Artist]) -> None:
    """One row below all panels."""
    figure.legend(handles=entries, loc="lower center", ncols=len(entries), fontsize=8,
                  frameon=False)  # fmt: skip


def draw_solution(
    path: Path,
    scene: Scene,
    thing: GraspedObject,
    T_world_thing: pin.SE3,
    robot: Sequence[Mesh],
) -> None:
    """Write a PNG: scene, V, and the robot that has just put the thing down; see-through what
    hides it."""
    figure, (axes,) = panel_figure(1, 1, _SOLUTION_SIZE)
    placed = moved(thing.vertices, T_world_thing)
    held = np.vstack([placed, scene.volume.lower, scene.volume.upper])
    corners = box_corners(held.min(axis=0), held.max(axis=0))
    view = panel_view(axes, corners, _OVER_RIGHT_SHOULDER)
    solids = [Mesh(part.vertices, part.triangles, part.colour) for part in scene.parts]
    meshes = see_through(view, placed, [*solids, *robot])
    image = render(view, [*meshes, Mesh(placed, thing.triangles, PLACED)])
    show_image(axes, view, image, scene.volume)
    entries = [
        Patch(color=PLACED, label="placed object"),
        Patch(color=VOLUME, label="target volume"),
    ]
    show_legend(figure, entries)
    figure.savefig(path)
