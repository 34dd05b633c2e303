"""Pictures of many panels, each a view of a scene with its target volume."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.pictures.picture import (
    OVERSAMPLING,
    averaged,
    draw_volume,
)
from placement_planner_ros.pictures.plots import new_figure
from placement_planner_ros.pictures.rendering import Image, Viewpoint

_TITLE, _LEGEND, _GAP = 0.34, 0.40, 0.06
"""Inches: of a panel's title, of the legend, and between panels."""


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
