"""Charts as HTML: the objective over time, what each constraint rejects, the legend."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from itertools import pairwise

from placement_planner_ros.view.colours import (
    EARLIER,
    HELD,
    OBSTACLES,
    PLACED,
    STANDING,
    START,
    VOLUME,
    css,
    scale_css,
)
from placement_planner_ros.view.words import CONSTRAINTS

_WIDTH, _HEIGHT = 320, 130
_LEFT, _RIGHT, _TOP, _BOTTOM = 46, 12, 18, 28
_TEXT = "font-family:sans-serif;font-size:11px"
_BOX = "padding:2px 14px;font-size:12px;color:#222"


def objective_over_time(steps: Sequence[tuple[float, float]], end: float, chosen: int) -> str:
    """The best objective over time as steps, an SVG.

    Args:
        steps: seconds since the start and ξ of every improvement, in order.
        end: seconds up to which the last holds.
        chosen: which of them is shown, by its place; -1 for none.
    """
    if not steps:
        return f'<div style="{_BOX};color:#666">ξ over time: no placement so far</div>'
    end = max(end, steps[-1][0], 1e-3)
    low, high = _range([value for _, value in steps])

    def x(time: float) -> float:
        return _LEFT + (_WIDTH - _LEFT - _RIGHT) * time / end

    def y(value: float) -> float:
        return _HEIGHT - _BOTTOM - (_HEIGHT - _TOP - _BOTTOM) * (value - low) / (high - low)

    path = f"M{x(steps[0][0]):.1f},{y(steps[0][1]):.1f}"
    for (_, _), (time, value) in pairwise(steps):
        path += f"H{x(time):.1f}V{y(value):.1f}"
    path += f"H{x(end):.1f}"
    dots = "".join(
        f'<circle cx="{x(time):.1f}" cy="{y(value):.1f}" r="{4.5 if k == chosen else 2.5}" '
        f'fill="{css(PLACED) if k == chosen else css(EARLIER)}"/>'
        for k, (time, value) in enumerate(steps)
    )
    floor, middle = _HEIGHT - _BOTTOM, (_LEFT + _WIDTH - _RIGHT) / 2
    texts = [
        (_LEFT - 5, y(low) + 4, "end", f"{low:.3g}"),
        (_LEFT - 5, y(high) + 4, "end", f"{high:.3g}"),
        (_LEFT, floor + 14, "middle", "0"),
        (_WIDTH - _RIGHT, floor + 14, "end", f"{end:.1f} s"),
        (middle, floor + 14, "middle", "time since the start"),
        (_LEFT - 5, 11, "start", "objective ξ of the best placement"),
    ]
    written = "".join(
        f'<text x="{at:.1f}" y="{height:.1f}" text-anchor="{anchor}" style="{_TEXT}" '
        f'fill="#444">{text}</text>'
        for at, height, anchor, text in texts
    )
    frame = f"M{_LEFT},{_TOP}V{floor}H{_WIDTH - _RIGHT}"
    return (
        f'<div style="{_BOX}"><svg viewBox="0 0 {_WIDTH} {_HEIGHT}" width="100%" '
        f'role="img" aria-label="objective over time">'
        f'<path d="{frame}" fill="none" stroke="#999"/>'
        f'<path d="{path}" fill="none" stroke="{css(EARLIER)}" stroke-width="1.6"/>'
        f"{dots}{written}</svg></div>"
    )


def _range(values: Sequence[float]) -> tuple[float, float]:
    """Round numbers around the values."""
    low, high = min(values), max(values)
    if not (math.isfinite(low) and math.isfinite(high)):
        return 0.0, 1.0
    wide = max(high - low, 1e-3 * max(abs(low), abs(high)), 1e-6)
    step = 10.0 ** math.floor(math.log10(wide))
    below, above = math.floor(low / step) * step, math.ceil(high / step) * step
    return (below, above) if above > below else (below, below + step)


def rejections(rejected: Mapping[str, int], samples: int) -> str:
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


def legend(
    heat: tuple[float, float] | None, earlier: bool, standing: bool, ghost: bool, obstacles: bool
) -> str:
    """What the colours in the scene mean.

    Args:
        heat: ξ at the ends of the scale where regions are coloured by it, else None.
        earlier: whether other placements are shown.
        standing: whether there are objects that earlier runs have placed.
        ghost: whether the start is shown as a ghost.
        obstacles: whether the obstacle set is shown.
    """
    entries = [(PLACED, "where the object will stand"), (HELD, "the object now, and its way")]
    entries += [(START, "ghost: robot and object at the start")] if ghost else []
    entries += [(EARLIER, "other placements found")] if earlier else []
    entries += [(STANDING, "placed by earlier runs")] if standing else []
    entries += [(VOLUME, "edges of the target volume V")]
    entries += [(OBSTACLES, "what counts as obstacle")] if obstacles else []
    swatches = "".join(
        f'<span style="white-space:nowrap;margin-right:10px"><span style="display:inline-block;'
        f'width:10px;height:10px;border-radius:2px;background:{css(colour)}"></span> '
        f"{escape(words)}</span> "
        for colour, words in entries
    )
    bar = "surfaces in V that can carry it: plain blue"
    if heat is not None:
        bar = (
            "surfaces in V, by ξ if the object stood there turned like this (estimated here):"
            f'<div style="height:10px;border-radius:2px;background:{scale_css()}"></div>'
            '<div style="display:flex;justify-content:space-between">'
            f"<span>{heat[0]:.3f} worst</span><span>{heat[1]:.3f} best</span></div>"
            "Where a bright place was not taken, something else rejects it: see the bars."
        )
    return f'<div style="{_BOX};font-size:11.5px">{swatches}<div>{bar}</div></div>'
