"""Charts: the objective over time, what each constraint rejects, the legend."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
import viser
from viser import uplot

from placement_planner_ros.core.types import Array
from placement_planner_ros.view.colours import (
    EARLIER,
    HELD,
    OBSTACLES,
    PLACED,
    REGION,
    STANDING,
    START,
    VOLUME,
    css_colour,
)
from placement_planner_ros.view.words import CONSTRAINTS

_BOX = "padding:2px 14px;font-size:12px;color:#222"


class ObjectiveCurve:
    """ξ of the best placement over time as steps, and ξ of the placement that is shown."""

    def __init__(self, gui: viser.GuiApi) -> None:
        best = uplot.Series(stroke=css_colour(EARLIER), width=2)
        shown = uplot.Series(stroke=css_colour(PLACED), points={"show": False})
        self._chart: Any = gui.add_uplot(
            curve_data([(0.0, 0.0)], 1.0, -1),
            (uplot.Series(), best, shown),
            title="objective ξ of the best placement",
            scales={"x": uplot.Scale(time=False)},
            axes=(uplot.Axis(label="s since the start"), uplot.Axis()),
            legend=uplot.Legend(show=False),
            aspect=2.0,
            visible=False,
        )
        self._drawn: object = None

    def draw(self, steps: Sequence[tuple[float, float]], end: float, chosen: int) -> None:
        """Show these, where they are others than before; see `curve_data`."""
        if self._drawn != (steps, end, chosen):
            self._drawn, self._chart.visible = (steps, end, chosen), bool(steps)
            if steps:
                self._chart.data = curve_data(steps, end, chosen)


def curve_data(
    steps: Sequence[tuple[float, float]], end: float, chosen: int
) -> tuple[Array, Array, Array]:
    """Corners of the steps, seconds and ξ, and ξ of the one that is shown at each corner.

    Args:
        steps: seconds since the start and ξ of every improvement, in order.
        end: seconds up to which the last holds.
        chosen: which of them is shown, by its place; -1 for the last.
    """
    times, values = np.array(steps).T
    corners = np.repeat([*times, max(end, times[-1])], 2)[1:-1]
    return corners, np.repeat(values, 2), np.full(len(corners), values[chosen])


def rejection_bars(rejected: Mapping[str, int], samples: int) -> str:
    """What became of the samples, a bar for each constraint in the order of the checks."""
    if not samples:
        return f'<div style="{_BOX};color:#666">Nothing tried so far.</div>'
    most = max(rejected.values(), default=0) or 1
    rows = "".join(
        '<div style="display:flex;align-items:center;margin:1px 0">'
        f'<span style="width:46%;text-align:right;padding-right:6px">'
        f"{escape(CONSTRAINTS.get(name, name.replace('_', ' ')))}</span>"
        f'<span style="width:30%"><span style="display:block;height:10px;border-radius:2px;'
        f'background:#c0563f;width:{max(1.0, 100.0 * number / most):.1f}%"></span></span>'
        f'<span style="width:24%;padding-left:6px;white-space:nowrap">{number:,}</span></div>'
        for name, number in rejected.items()
        if number
    )
    return (
        f'<div style="{_BOX};font-size:11.5px"><b>What was tried and rejected, and why</b>'
        f" ({samples:,} samples){rows}</div>"
    )


def colour_legend(earlier: bool, standing: bool, ghost: bool, obstacles: bool) -> str:
    """What the colours in the scene mean.

    Args:
        earlier: whether other placements are shown.
        standing: whether there are objects that earlier runs have placed.
        ghost: whether the start is shown as a ghost.
        obstacles: whether the obstacle set is shown.
    """
    entries = [(PLACED, "where the object will stand"), (HELD, "the object now, and its way")]
    entries += [(START, "ghost: robot and object at the start")] if ghost else []
    entries += [(EARLIER, "other placements found")] if earlier else []
    entries += [(STANDING, "placed by earlier runs")] if standing else []
    entries += [(VOLUME, "edges of the target volume V"), (REGION, "surfaces in V that can carry")]
    entries += [(OBSTACLES, "what counts as obstacle")] if obstacles else []
    swatches = "".join(
        f'<span style="white-space:nowrap;margin-right:10px"><span style="display:inline-block;'
        f'width:10px;height:10px;border-radius:2px;background:{css_colour(colour)}"></span> '
        f"{escape(words)}</span> "
        for colour, words in entries
    )
    return f'<div style="{_BOX};font-size:11.5px">{swatches}</div>'
