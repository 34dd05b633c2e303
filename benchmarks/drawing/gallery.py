"""One small picture of each situation, in one figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from benchmarks.drawing.panels import panel_figure, panel_view, show_image, show_legend
from benchmarks.household import object_by_name
from benchmarks.situations.situation import Situation
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.pictures.rendering import Mesh, render
from placement_planner_ros.pictures.shapes import (
    PLACED,
    VOLUME,
    box_corners,
    moved,
    see_through,
    volume_edges,
)
from placement_planner_ros.scenes.primitives import Colour

_IMPOSSIBLE: Colour = (0.85, 0.15, 0.12)
_OUT_OF_REACH: Colour = (0.95, 0.60, 0.10)
_IN_A_ROW = 8
_SIZE = 1.75, 1.75
"""Inches of a panel."""
_TOWARDS_EYE = (-2.5, 0.55)
_AROUND, _ABOVE = 0.035, 0.05
"""m around V that a panel shows, and of an object that hovers above what stands there."""


def draw_situations(path: Path, situations: Sequence[Situation]) -> None:
    """Write a PNG: each scene with V, and the object where it can be placed or over V."""
    figure, panels = panel_figure(len(situations), _IN_A_ROW, _SIZE)
    for axes, situation in zip(panels, situations, strict=True):
        name = situation.name.removesuffix("_polygon").replace("_", " ")
        axes.set_title(name + (" *" if situation.support == "polygon" else ""), fontsize=7.5, pad=3)
        _draw_panel(axes, situation)
    show_legend(
        figure,
        [
            Patch(color=PLACED, label="possible, here"),
            Patch(color=_OUT_OF_REACH, label="it could stand here, but the robot cannot bring it"),
            Patch(color=_IMPOSSIBLE, label="impossible: it hovers over the place"),
            Patch(color=VOLUME, label="target volume"),
            Patch(color="white", label="* s(x) by polygon, else by vertices"),
        ],
    )
    figure.savefig(path)


def _draw_panel(axes: Axes, situation: Situation) -> None:
    thing = object_by_name(situation.thing)
    colour, pose = _colour_of(situation), situation.witness
    if pose is None:
        pose = pin.SE3(np.eye(3), _hovering_over(situation, thing.vertices))
    vertices = moved(thing.vertices, pose)
    scene, volume = situation.scene, situation.scene.volume
    held = np.vstack([vertices, *(box_corners(low, high) for low, high in volume.joined)])
    shown = box_corners(held.min(axis=0) - _AROUND, held.max(axis=0) + _AROUND)
    view = panel_view(axes, shown, _TOWARDS_EYE)
    solids = [Mesh(part.vertices, part.triangles, part.colour) for part in scene.parts]
    meshes = [*see_through(view, vertices, solids), *volume_edges(volume)]
    show_image(axes, render(view, [*meshes, Mesh(vertices, thing.triangles, colour)]))


def _hovering_over(situation: Situation, vertices: np.ndarray) -> np.ndarray:
    """(3,) of an object that hovers over V and what stands there."""
    volume: TargetVolume = situation.scene.volume
    middle = 0.5 * (volume.lower + volume.upper)
    top = max(part.vertices[:, 2].max() for part in situation.scene.parts)
    return np.array([*middle[:2], top + _ABOVE - vertices[:, 2].min()])


def _colour_of(situation: Situation) -> Colour:
    if not situation.pose_exists:
        return _IMPOSSIBLE
    return PLACED if situation.robot_can else _OUT_OF_REACH
