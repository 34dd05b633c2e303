"""Measured points with what was placed among them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.patches import Patch

from benchmarks.drawing.panels import panel_figure, panel_view, show_image, show_legend
from benchmarks.household import object_by_name
from benchmarks.real_clouds.runs import RealRun
from benchmarks.real_clouds.table import TableCloud
from placement_planner_ros.core.types import Array
from placement_planner_ros.pictures.rendering import Image, Mesh, Viewpoint, render
from placement_planner_ros.pictures.shapes import PLACED, VOLUME, box_corners, moved, volume_edges

_IN_A_ROW = 5
_SIZE, _HEAD = (2.8, 2.3), 0.3
"""Inches of a panel, and of the title."""
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
    low, high = cloud.volume.lower - _AROUND, cloud.volume.upper + _AROUND
    high[2] += _HIGHEST
    shown = cloud.points[((cloud.points > low) & (cloud.points < high)).all(axis=1)]
    figure, panels = panel_figure(len(runs), _IN_A_ROW, _SIZE, _HEAD)
    for axes, run in zip(panels, runs, strict=True):
        told = f"after {run.seconds:.1f} s" if run.pose is not None else "not placed"
        axes.set_title(f"{run.thing.replace('_', ' ')}, {told}", fontsize=9, pad=4)
        _draw_panel(axes, cloud, shown, run)
    figure.suptitle(title, fontsize=11)
    show_legend(
        figure,
        [
            Patch(color=PLACED, label="placed object"),
            Patch(color=VOLUME, label="target volume"),
            Patch(color=colormaps["viridis"](0.5), label="measured points, coloured by height"),
        ],
    )
    figure.savefig(path)


def _draw_panel(axes: Axes, cloud: TableCloud, points: Array, run: RealRun) -> None:
    low, high = cloud.volume.lower, cloud.volume.upper
    corners = box_corners(low, np.array([*high[:2], high[2] + _OBJECTS]))
    view = panel_view(axes, corners, _TOWARDS_EYE)
    meshes = volume_edges(cloud.volume)
    if run.pose is not None:
        thing = object_by_name(run.thing)
        meshes.append(Mesh(moved(thing.vertices, run.pose), thing.triangles, PLACED))
    image = render(view, meshes)
    _add_points(image, view, points)
    show_image(axes, image)


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
