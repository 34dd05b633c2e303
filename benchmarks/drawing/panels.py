"""Pictures of many panels, each a view of a scene with its target volume."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.drawing.plots import new_figure
from placement_planner_ros.core.types import Array
from placement_planner_ros.pictures.rendering import Image, Viewpoint

OVERSAMPLING = 2
"""Rendered pixels for each that is shown, along a side."""
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
    return Viewpoint.around(shown, towards_eye, np.array(axes.bbox.size) // 1 * OVERSAMPLING)


def show_image(axes: Axes, image: Image) -> None:
    """What was rendered, pixels averaged, which smooths edges."""
    n = OVERSAMPLING
    parts = [image.colours[row::n, column::n] for row in range(n) for column in range(n)]
    axes.imshow(np.mean(parts, axis=0), interpolation="nearest", aspect="auto")


def show_legend(figure: Figure, entries: Sequence[Artist]) -> None:
    """One row below all panels."""
    figure.legend(handles=entries, loc="lower center", ncols=len(entries), fontsize=8,
                  frameon=False)  # fmt: skip
