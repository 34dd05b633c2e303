"""The placement regions of a cloud: where anything could stand at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.patches import Polygon, Rectangle

from benchmarks.concepts.division import outlines
from benchmarks.drawing.plots import new_figure
from benchmarks.real_clouds.table import TableCloud
from placement_planner_ros.core.scene.environment import Environment

_AROUND = 0.15
"""m beside V that are drawn."""
_HIGHEST = 0.3
"""m up to which colours tell heights."""


def draw_regions(path: Path, cloud: TableCloud, name: str) -> None:
    """Write a PNG: the cloud from above, and the regions found in it.

    Args:
        name: of the cloud, for the title.
    """
    environment = Environment.from_points(cloud.points, cloud.volume)
    low, high = cloud.volume.lower - _AROUND, cloud.volume.upper + _AROUND
    shown = cloud.points[((cloud.points > low) & (cloud.points < high)).all(axis=1)]
    shown = shown[np.argsort(shown[:, 2])]
    figure = new_figure(8.0, 5.0)
    axes = figure.subplots()
    # y to the left: as the robot sees it from behind the origin
    dots = axes.scatter(
        shown[:, 1], shown[:, 0], c=shown[:, 2], s=1.0, vmin=-0.15, vmax=_HIGHEST, cmap="Greys"
    )
    figure.colorbar(dots, label="height over the table in m")
    for number, region in enumerate(environment.regions):
        colour = colormaps["Set2"](number % 8)
        for outline in outlines(region):
            axes.add_patch(Polygon(outline[:, ::-1], fc=colour, ec="none"))
    lower, upper = cloud.volume.lower, cloud.volume.upper
    axes.add_patch(
        Rectangle(
            (lower[1], lower[0]), upper[1] - lower[1], upper[0] - lower[0], fill=False,
            ec="#d02080", lw=1.5, label="target volume",
        )
    )  # fmt: skip
    axes.set_xlim(high[1], low[1])
    axes.set_ylim(low[0], high[0])
    axes.set_aspect("equal")
    axes.set_xlabel("y in m")
    axes.set_ylabel("x in m, away from the robot")
    axes.legend(loc="upper right", fontsize=8)
    axes.set_title(f"{len(environment.regions)} placement regions of {name}, each in a colour")
    figure.savefig(path)
