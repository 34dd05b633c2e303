"""The picture of what was measured."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from benchmarks.speed.rows import Entry, SpeedLine, first_seconds
from placement_planner_ros.pictures.plots import new_figure, png

_MET, _MISSED, _OTHER, _PLAIN = "#009e73", "#d55e00", "#0072b2", "#777777"
_WIDEST = 100.0
_LABEL = 90
_DECADES = 3.0
"""From this many on, numbers between powers of ten would touch each other."""


def draw_speed(lines: Sequence[SpeedLine], entries: Sequence[Entry]) -> bytes:
    """A PNG: every figure against its target, and the distributions behind the latencies."""
    sound = [entry for entry in entries if "error" not in entry]
    figure = new_figure(17.0, max(7.0, 1.5 + 0.3 * len(lines)))
    halves = figure.subfigures(1, 2, width_ratios=[1.7, 1.0], squeeze=False)
    left, right = halves[0]
    _draw_margins(left.subplots(), lines)
    drawings = (_draw_first, _draw_goal_sets, _draw_ratios, _draw_node)
    for axes, drawing in zip(right.subplots(2, 2).flat, drawings, strict=True):
        axes.tick_params(labelsize=8)
        drawing(axes, sound)
        if not axes.has_data():
            axes.text(0.5, 0.5, "not measured", ha="center", va="center", color=_PLAIN)
            axes.set_xticks([])
            axes.set_yticks([])
        elif axes.get_legend_handles_labels()[0]:
            # Below the axes: curves from corner to corner leave no room in them.
            axes.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.2), frameon=False)
    return png(figure)


def _draw_margins(axes: Axes, lines: Sequence[SpeedLine]) -> None:
    for place, line in enumerate(lines):
        colour = _MET if line.met else _MISSED
        margin = math.log10(min(max(line.margin, 1.0 / _WIDEST), _WIDEST))
        if line.target != 0.0:
            axes.barh(place, margin, color=colour, height=0.62)
        beside = max(margin, 0.0) if line.target != 0.0 else 0.0
        axes.text(beside + 0.03, place, line.told, va="center", fontsize=8, color=colour)
    labels = [
        f"{line.what[: _LABEL - 1] + '…' if len(line.what) > _LABEL else line.what}  {line.wanted}"
        for line in lines
    ]
    axes.set_yticks(range(len(lines)), labels, fontsize=8)
    axes.axvline(0.0, color="black", linewidth=1.0)
    ticks = [0.01, 0.1, 1, 10, 100]
    axes.set_xticks(np.log10(ticks), [f"{tick:g}x" for tick in ticks])
    axes.set_xlim(-2.05, 3.2)
    axes.set_ylim(len(lines) - 0.4, -0.6)
    axes.set_xlabel("times better than the target")
    axes.set_title("figures against their targets", fontsize=10)
    axes.spines[["top", "right"]].set_visible(False)


def _draw_first(axes: Axes, entries: Sequence[Entry]) -> None:
    ours = [e for e in entries if e["row"] == "first"]
    plain = [e for e in entries if e["row"] == "plain"]
    for name, group, environment, colour in (
        ("environment ready", ours, False, _MET),
        ("environment included", ours, True, _OTHER),
        ("uniform + RRTConnect + coal", plain, False, _PLAIN),
    ):
        _draw_shares(axes, [first_seconds(e, environment=environment) for e in group], name, colour)
    _finish_latencies(axes, "first placement", "seconds from start")


def _draw_goal_sets(axes: Axes, entries: Sequence[Entry]) -> None:
    own = [e for e in entries if e["row"] == "goal_sets"]
    _draw_shares(axes, [e["seconds"] for e in own], "goal-set RRT", _MET)
    plain = [e["plain_seconds"] for e in own if "plain_seconds" in e]
    _draw_shares(axes, plain, "RRTConnect, coal every 5 mm", _PLAIN)
    _finish_latencies(axes, "planning to a goal set", "seconds")


def _draw_ratios(axes: Axes, entries: Sequence[Entry]) -> None:
    for row, colour in (("answers", _OTHER), ("edges", _MET)):
        own = [e["exact_seconds"] / e["seconds"] for e in entries if e["row"] == row]
        _draw_shares(axes, own, row, colour)
    _finish_latencies(axes, "times faster than coal alone, by case", "ratio")


def _draw_node(axes: Axes, entries: Sequence[Entry]) -> None:
    own = [e for e in entries if e["row"] == "node"]
    for kind, name, colour in (
        ("start", "~/start answers", _OTHER),
        ("service", "other services in a search", "#e69f00"),
        ("stop", "stop to idle", _MISSED),
        ("first", "start to ~/solution", _MET),
    ):
        _draw_shares(axes, [e["seconds"] for e in own if e["kind"] == kind], name, colour)
    _finish_latencies(axes, "the node", "seconds")


def _draw_shares(axes: Axes, values: Sequence[float], name: str, colour: str) -> None:
    if values:
        axes.ecdf(values, label=f"{name} ({len(values)})", color=colour)


def _finish_latencies(axes: Axes, title: str, unit: str) -> None:
    if not axes.has_data():
        return
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    steps = (1.0, 3.0) if math.log10(high / low) < _DECADES else (1.0,)
    axes.xaxis.set_major_locator(LogLocator(subs=steps))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_ylim(0.0, 1.02)
    axes.axhline(0.5, color="#cccccc", linewidth=0.6)
    axes.axhline(0.95, color="#cccccc", linewidth=0.6)
    axes.set_xlabel(unit, fontsize=8)
    axes.set_ylabel("share", fontsize=8)
    axes.set_title(title, fontsize=9)
