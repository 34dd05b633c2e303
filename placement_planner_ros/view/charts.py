"""Charts: the objective over time, and what each constraint rejects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
import viser
from viser import uplot

from placement_planner_ros.core.types import Array

_BOX = "padding:2px 14px;font-size:12px;color:#222"


class ObjectiveCurve:
    """ξ of the best placement over time as steps."""

    def __init__(self, gui: viser.GuiApi) -> None:
        best = uplot.Series(stroke="rgb(105,60,170)", width=2)
        self._chart: Any = gui.add_uplot(
            curve_data([(0.0, 0.0)], 1.0),
            (uplot.Series(), best),
            title="objective ξ of the best placement",
            scales={"x": uplot.Scale(time=False)},
            axes=(uplot.Axis(label="s since the start"), uplot.Axis()),
            legend=uplot.Legend(show=False),
            aspect=2.0,
            visible=False,
        )
        self._drawn: object = None

    def draw(self, steps: Sequence[tuple[float, float]], end: float) -> None:
        """Show these, where they are others than before; see `curve_data`."""
        if self._drawn != (steps, end):
            self._drawn, self._chart.visible = (steps, end), bool(steps)
            if steps:
                self._chart.data = curve_data(steps, end)


def curve_data(steps: Sequence[tuple[float, float]], end: float) -> tuple[Array, Array]:
    """Corners of the steps, seconds and ξ.

    Args:
        steps: seconds since the start and ξ of every improvement, in order.
        end: seconds up to which the last holds.
    """
    times, values = np.array(steps).T
    # each value holds until the next, so times are shifted by one against values
    corners = np.repeat([*times, max(end, times[-1])], 2)[1:-1]
    return corners, np.repeat(values, 2)


def rejection_bars(rejected: Mapping[str, int], samples: int) -> str:
    """What became of the samples, a bar for each constraint in the order of the checks."""
    if not samples:
        return f'<div style="{_BOX};color:#666">Nothing tried so far.</div>'
    # the longest bar is the most frequent reason
    most = max(rejected.values(), default=0) or 1
    rows = "".join(
        '<div style="display:flex;align-items:center;margin:1px 0">'
        f'<span style="width:46%;text-align:right;padding-right:6px">'
        f"{escape(name.replace('_', ' '))}</span>"
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
