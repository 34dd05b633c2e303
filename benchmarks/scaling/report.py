"""Figure and table of the scaling runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.ticker import LogLocator, NullFormatter

from benchmarks.cases import OBJECTIVE_WORDS
from benchmarks.scaling.growth import WANTED, Growth
from benchmarks.scaling.runs import AXES
from benchmarks.text_table import TextTable
from placement_planner_ros.pictures.plots import new_figure, png

_COLOURS = {"maximize_clearance": "#0072b2", "minimize_clearance": "#d55e00"}

_FEWEST = 3
"""Runs per setting below which an interval says nothing."""


def draw_scaling(found: Sequence[Growth]) -> bytes:
    """Time to a good placement over the factor, one panel per axis, beside linear growth."""
    axes_run = [axis for axis in AXES if any(g.axis == axis for g in found)]
    figure = new_figure(1.2 + 3.4 * len(axes_run), 3.8)
    panels = figure.subplots(1, len(axes_run), sharey=True, squeeze=False)[0]
    for panel, axis in zip(panels, axes_run, strict=True):
        for growth in found:
            if growth.axis != axis:
                continue
            colour = _COLOURS[growth.objective]
            for factor, times in zip(growth.factors, growth.times, strict=True):
                reached = times[np.isfinite(times)]
                panel.plot([factor] * len(reached), reached, ".", color=colour, alpha=0.35)
            panel.plot(
                growth.factors,
                growth.medians,
                "o-",
                color=colour,
                label=f"{OBJECTIVE_WORDS[growth.objective]}: exponent {growth.exponent:.2f}",
            )
            if np.isfinite(growth.medians[0]):
                linear = growth.medians[0] * growth.factors / growth.factors[0]
                panel.plot(growth.factors, linear, ":", color=colour, linewidth=1)
        panel.set_xscale("log", base=2)
        panel.set_yscale("log")
        panel.xaxis.set_major_formatter("×{x:g}")
        # Plain numbers, few enough to be read: powers of ten say little of 0.2 to 10 s.
        panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.yaxis.set_major_formatter("{x:g}")
        panel.yaxis.set_minor_formatter(NullFormatter())
        panel.set_xlabel(AXES[axis])
        panel.grid(alpha=0.3, which="both")
        panel.legend(fontsize=8, loc="upper left")
    panels[0].set_ylabel(f"seconds to relative objective {WANTED}")
    return png(figure)


def scaling_table(found: Sequence[Growth]) -> TextTable:
    """Medians and exponents."""
    rows = []
    for growth in found:
        low, high = growth.interval
        fewest = min(map(len, growth.times))
        rows.append(
            (
                AXES[growth.axis],
                OBJECTIVE_WORDS[growth.objective],
                " → ".join(_size_words(size) for size in growth.sizes[[0, -1]]),
                " → ".join(f"{t:.2f}" if np.isfinite(t) else "never" for t in growth.medians),
                f"{growth.exponent:.2f} [{low:.2f}, {high:.2f}]",
                "too few runs" if fewest < _FEWEST else "yes" if high < 1.0 else "no",
            )
        )
    factors = " → ".join(f"×{f:g}" for f in found[0].factors) if found else ""
    return TextTable(
        ("doubled", "objective", "from, to", f"median seconds ({factors})", "exponent", "below 1"),
        tuple(rows),
        f"Processor time from the start to relative objective {WANTED}, environment construction "
        "included; 1 is the best of the setting's own runs. The exponent is the slope of the "
        "medians, both as logarithms, with its 95 % bootstrap interval over the runs. Dotted: "
        "linear growth.",
    )


def _size_words(size: float) -> str:
    return f"{size:,.0f}" if size >= 1.0 else f"{size:.4f} m³"
