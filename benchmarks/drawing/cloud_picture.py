"""Measured points with what was placed among them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.patches import Patch

from benchmarks.real_clouds.runs import RealRun
from benchmarks.real_clouds.table import TableCloud
from placement_planner_ros.core.types import Array
from placement_planner_ros.pictures.picture import (
    OVERSAMPLING,
    PLACED,
    VOLUME,
    averaged,
    box_corners,
    draw_volume,
    moved,
)
from placement_planner_ros.pictures.plots import new_figure
from placement_planner_ros.pictures.rendering import Image, Mesh, Viewpoint, render
from placement_planner_ros.scenes.objects import object_by_name

_IN_A_ROW = 5
_WIDTH, _HEIGHT, _HEAD, _FOOT = 2.8, 2.3, 0.3, 0.35
"""Inches: of a panel, of its title, and of the legend."""
_TOWARDS_EYE = (-2.6, 0.75)
_AROUND = 0.12
_HIGHEST = 0.30
"""m above the table up to which colours tell heights."""
_OBJECTS = 0.1
"""m above V that a panel holds."""
_DOT = 2
"""Pixels that a point is wide, before averaging."""


def draw_real_cloud(path: Path, cloud: TableCloud, runs: Sequence[RealRun], title: str) -> None:
    """Write a PNG: the cloud once for each object, where that was placed."""
    rows = -(-len(runs) // _IN_A_ROW)
    width, height = _IN_A_ROW * _WIDTH, rows * (_HEIGHT + _HEAD) + _FOOT + _HEAD
    figure = new_figure(width, height, constrained=False)
    low, high = cloud.volume.lower - _AROUND, cloud.volume.upper + _AROUND
    high[2] += _HIGHEST
    shown = cloud.points[((cloud.points > low) & (cloud.points < high)).all(axis=1)]
    for number, run in enumerate(runs):
        row, column = divmod(number, _IN_A_ROW)
        bottom = height - _HEAD - (row + 1) * (_HEIGHT + _HEAD)
        axes = figure.add_axes(
            ((column + 0.01) * _WIDTH / width, bottom / height, 0.98 * _WIDTH / width,
             _HEIGHT / height)
        )  # fmt: skip
        axes.set_axis_off()
        told = f"after {run.seconds:.1f} s" if run.pose is not None else "not placed"
        axes.set_title(f"{run.thing.replace('_', ' ')}, {told}", fontsize=9, pad=4)
        _draw(axes, cloud, shown, run)
    entries = [
        Patch(color=PLACED, label="placed object"),
        Patch(color=VOLUME, label="target volume"),
        Patch(color=colormaps["viridis"](0.5), label="measured points, coloured by height"),
    ]
    figure.suptitle(title, fontsize=11)
    figure.legend(handles=entries, loc="lower center", ncols=3, fontsize=9, frameon=False)
    figure.savefig(path)


def _draw(axes: Axes, cloud: TableCloud, points: Array, run: RealRun) -> None:
    width, height = (int(side) * OVERSAMPLING for side in axes.bbox.size)
    low, high = cloud.volume.lower, cloud.volume.upper
    corners = box_corners(low, np.array([*high[:2], high[2] + _OBJECTS]))
    view = Viewpoint.around(corners, *_TOWARDS_EYE, width, height)
    meshes = []
    if run.pose is not None:
        thing = object_by_name(run.thing)
        meshes.append(Mesh(moved(thing.vertices, run.pose), thing.triangles, PLACED))
    image = render(view, meshes)
    _add_points(image, view, points)
    colours = averaged(image.colours)
    axes.imshow(colours, extent=(0, width, height, 0), interpolation="nearest", aspect="auto")
    draw_volume(axes, view, image, cloud.volume)
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)


def _add_points(image: Image, view: Viewpoint, points: Array) -> None:
    """Points (n, 3) as squares where nothing nearer was drawn, the nearest last."""
    colours = colormaps["viridis"](Normalize(-0.02, _HIGHEST)(points[:, 2]))[:, :3]
    seen = view.project(points)
    order = np.argsort(-seen[:, 2])
    pixel, depth = np.floor(seen[order, :2]).astype(int), seen[order, 2]
    for du in range(_DOT):
        for dv in range(_DOT):
            u, v = pixel[:, 0] + du, pixel[:, 1] + dv
            inside = (u >= 0) & (u < view.width) & (v >= 0) & (v < view.height)
            rows = np.flatnonzero(inside)
            rows = rows[depth[rows] < image.depth[v[rows], u[rows]]]
            image.colours[v[rows], u[rows]] = colours[order[rows]]
            image.depth[v[rows], u[rows]] = depth[rows]
