"""One small picture of each situation, in one figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from benchmarks.situations.situation import Situation
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.pictures.picture import (
    OVERSAMPLING,
    PLACED,
    SEE_THROUGH,
    VOLUME,
    averaged,
    box_corners,
    draw_volume,
    hiding,
    moved,
)
from placement_planner_ros.pictures.plots import new_figure
from placement_planner_ros.pictures.rendering import Mesh, Viewpoint, render
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.primitives import Colour

_IMPOSSIBLE: Colour = (0.85, 0.15, 0.12)
_OUT_OF_REACH: Colour = (0.95, 0.60, 0.10)
_IN_A_ROW = 8
_SIDE, _HEAD, _FOOT = 1.75, 0.34, 0.40
"""Inches: of a panel, of its title, and of the legend."""
_TOWARDS_EYE = (-2.5, 0.55)
_AROUND, _ABOVE, _UNDER = 0.035, 0.05, 0.05
"""m around V that a panel holds, from its floor to above the object, and that it shows below."""


def draw_situations(path: Path, situations: Sequence[Situation]) -> None:
    """Write a PNG: each scene with V, and the object where it can be placed or over V."""
    rows = -(-len(situations) // _IN_A_ROW)
    width, height = _IN_A_ROW * _SIDE, rows * (_SIDE + _HEAD) + _FOOT
    figure = new_figure(width, height, constrained=False)
    for number, situation in enumerate(situations):
        row, column = divmod(number, _IN_A_ROW)
        left, bottom = column * _SIDE, height - (row + 1) * (_SIDE + _HEAD)
        area = (left + 0.03) / width, bottom / height, (_SIDE - 0.06) / width, _SIDE / height
        axes = figure.add_axes(area)
        axes.set_axis_off()
        name = situation.name.removesuffix("_polygon").replace("_", " ")
        axes.set_title(name + (" *" if situation.support == "polygon" else ""), fontsize=7.5, pad=3)
        _draw(axes, situation)
    _legend(figure)
    figure.savefig(path)


def _draw(axes: Axes, situation: Situation) -> None:
    thing = object_by_name(situation.thing)
    colour, pose = _colour(situation), situation.witness
    if pose is None:
        pose = pin.SE3(np.eye(3), _over(situation, thing.vertices))
    vertices = moved(thing.vertices, pose)
    scene, volume = situation.scene, situation.scene.volume
    held = np.vstack([vertices, *(box_corners(low, high) for low, high in volume.joined)])
    low, high = held.min(axis=0) - _AROUND, held.max(axis=0) + _AROUND
    corners = box_corners(low, high)
    width, height = (int(side) * OVERSAMPLING for side in axes.bbox.size)
    view = Viewpoint.around(corners, *_TOWARDS_EYE, width, height)
    solids = [Mesh(part.vertices, part.triangles, part.colour) for part in scene.parts]
    see_through = hiding(view, vertices, solids)
    meshes = [
        replace(mesh, alpha=SEE_THROUGH) if hides else mesh
        for mesh, hides in zip(solids, see_through, strict=True)
    ]
    meshes.append(Mesh(vertices, thing.triangles, colour))
    image = render(view, meshes)
    axes.imshow(
        averaged(image.colours),
        extent=(0, width, height, 0),
        interpolation="nearest",
        aspect="auto",
    )
    draw_volume(axes, view, image, volume)
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)


def _over(situation: Situation, vertices: np.ndarray) -> np.ndarray:
    """(3,) of an object that hovers over V and what stands there."""
    volume: TargetVolume = situation.scene.volume
    middle = 0.5 * (volume.lower + volume.upper)
    top = max(part.vertices[:, 2].max() for part in situation.scene.parts)
    return np.array([*middle[:2], top + _ABOVE - vertices[:, 2].min()])


def _colour(situation: Situation) -> Colour:
    if not situation.pose_exists:
        return _IMPOSSIBLE
    return PLACED if situation.robot_can else _OUT_OF_REACH


def _legend(figure: Figure) -> None:
    entries = [
        Patch(color=PLACED, label="possible, here"),
        Patch(color=_OUT_OF_REACH, label="it could stand here, but the robot cannot bring it"),
        Patch(color=_IMPOSSIBLE, label="impossible: it hovers over the place"),
        Patch(color=VOLUME, label="target volume"),
        Patch(color="white", label="* s(x) by polygon, else by vertices"),
    ]
    figure.legend(handles=entries, loc="lower center", ncols=len(entries), fontsize=8,
                  frameon=False)  # fmt: skip
