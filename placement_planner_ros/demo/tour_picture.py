"""The tour's picture: where all things stand at last, how each was carried, and a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.transforms import Bbox

from placement_planner_ros.pictures.picture import averaged
from placement_planner_ros.pictures.plots import DPI, new_figure
from placement_planner_ros.pictures.stage_set import COLOURS, StageSet

_PICTURE_SIZE = (1320, 820)
"""Pixels of the picture without its words."""
_HEAD, _ROW, _FOOT = 0.45, 0.27, 0.15
"""Inches: of the title, a row of the table, and what is below that."""


def draw_tour(
    path: Path, stage: StageSet, title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]
) -> None:
    """Write a PNG: all things where they stand at last, their ways, and a table.

    Args:
        columns: heads of the table, the first for the things' names.
        rows: one for each leg.
    """
    width, tall = (side / DPI for side in _PICTURE_SIZE)
    height = _HEAD + tall + _ROW * (len(rows) + 1) + _FOOT
    figure = new_figure(width, height, constrained=False)
    figure.text(0.5, 1.0 - 0.12 / height, title, fontsize=13, ha="center", va="top")
    below = (height - _HEAD - tall) / height
    axes = figure.add_axes((0.0, below, 1.0, tall / height))
    last, stage = len(stage.legs) - 1, stage.sized(_PICTURE_SIZE)
    axes.imshow(
        averaged(stage.draw(last, stage.legs[last].looks[-1], all_ways=True).colours), aspect="auto"
    )
    axes.set_axis_off()
    table = figure.add_axes((0.03, _FOOT / height, 0.94, below - _FOOT / height))
    table.set_axis_off()
    colours = [COLOURS[number % len(COLOURS)] for number in range(len(rows))]
    wide = [2.0, *[1.0] * (len(columns) - 1)]  # the first column holds names
    cells = table.table(
        rows,
        colLabels=columns,
        colWidths=[each / sum(wide) for each in wide],
        cellLoc="center",
        rowLabels=[" "] * len(rows),
        rowColours=colours,
        bbox=Bbox.unit(),
    )
    cells.auto_set_font_size(False)
    cells.set_fontsize(11)
    figure.savefig(path)
