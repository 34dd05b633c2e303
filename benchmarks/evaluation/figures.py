"""The figures of the evaluation, each as the bytes of a PNG."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from benchmarks.cases import OBJECTIVE_WORDS, Case, in_words
from benchmarks.evaluation.comparisons import REFERENCE, curve
from benchmarks.evaluation.plots import new_figure, png
from benchmarks.evaluation.results import EvaluationResults

COLOURS = {
    "optimistic+lo": "#0072b2",
    "mcts+lo": "#009e73",
    "uniform+lo": "#d55e00",
    "optimistic": "#56b4e9",
    "mcts": "#cc79a7",
    "uniform": "#e69f00",
    "baseline": "#777777",
    "plain": "#000000",
}
"""Variant -> colour, told apart also by those who do not see all colours."""

_POINTS = 240


def draw_overall(results: EvaluationResults) -> bytes:
    """Mean relative objective over time, all cases."""
    figure = new_figure(8.0, 4.6)
    axes = figure.add_subplot()
    _draw_curves(axes, results, results.cases)
    axes.set_xlabel("time since start [s]")
    axes.set_ylabel("mean relative objective")
    axes.set_title(f"all {len(results.cases)} cases")
    axes.legend(loc="lower right", fontsize=9)
    return png(figure)


def draw_by_scene(results: EvaluationResults) -> bytes:
    """The paper's figure: one panel for each scene and objective, over all objects."""
    scenes = list(dict.fromkeys(case.scene for case in results.cases))
    objectives = list(dict.fromkeys(case.objective for case in results.cases))
    figure = new_figure(1.2 + 3.6 * len(scenes), 0.9 + 2.7 * len(objectives))
    panels = figure.subplots(len(objectives), len(scenes), sharex=True, sharey=True, squeeze=False)
    for row, objective in enumerate(objectives):
        for column, scene in enumerate(scenes):
            axes = panels[row, column]
            cases = [c for c in results.cases if (c.scene, c.objective) == (scene, objective)]
            if not cases:
                axes.set_axis_off()
                continue
            _draw_curves(axes, results, cases)
            aim = OBJECTIVE_WORDS.get(objective, in_words(objective))
            axes.set_title(f"{in_words(scene)}, {aim}", fontsize=10)
            if row == len(objectives) - 1:
                axes.set_xlabel("time since start [s]")
            if column == 0:
                axes.set_ylabel("mean relative objective")
    lines = [Line2D([], [], color=COLOURS[v], linewidth=2, label=v) for v in results.variants]
    figure.legend(handles=lines, loc="outside lower center", ncols=len(lines), frameon=False)
    return png(figure)


def _draw_curves(axes: Axes, results: EvaluationResults, cases: Sequence[Case]) -> None:
    times = np.linspace(0.0, results.horizon, _POINTS)
    for variant in results.variants:
        if any(results.of_variant(variant, case) for case in cases):
            found = curve(results, variant, cases, times)
            colour = COLOURS[variant]
            front = 4 if variant == REFERENCE else 3
            axes.fill_between(
                times, found.low, found.high, color=colour, alpha=0.13, linewidth=0, zorder=1
            )
            axes.plot(times, found.mean, color=colour, linewidth=2, label=variant, zorder=front)
    axes.set_xlim(0.0, results.horizon)
    axes.set_ylim(0.0, 1.02)
    axes.grid(alpha=0.3)
