"""The figures of the evaluation, each as the bytes of a PNG."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from benchmarks.cases import OBJECTIVE_WORDS, Case, case_label, words
from benchmarks.evaluation.comparisons import (
    BASELINE,
    REFERENCE,
    Comparison,
    curve,
    finals,
    first_times,
    rejections,
)
from benchmarks.evaluation.resampling import Interval, mean_interval
from benchmarks.evaluation.results import Results, final
from placement_planner_ros.pictures.plots import new_figure, png

COLOURS = {
    "optimistic+lo": "#0072b2",
    "mcts+lo": "#009e73",
    "uniform+lo": "#d55e00",
    "optimistic": "#56b4e9",
    "mcts": "#cc79a7",
    "uniform": "#e69f00",
    "baseline": "#777777",
    "optimistic+lo+unpruned": "#f0e442",
}
"""Variant -> colour, told apart also by those who do not see all colours."""

_REJECTIONS = {
    "outside_volume": ("outside V", "#dddddd"),
    "unstable": ("no support", "#bbbbbb"),
    "colliding": ("object collides", "#e69f00"),
    "not_better": ("no better than best", "#f0e442"),
    "no_ik": ("out of reach", "#56b4e9"),
    "arm_colliding": ("arm collides", "#0072b2"),
    "no_release": ("hand cannot open", "#7a5195"),
    "no_approach": ("no approach", "#cc79a7"),
    "no_retreat": ("no retreat", "#d55e00"),
    "goals": ("goal", "#009e73"),
}
_POINTS = 240


def draw_overall(results: Results) -> bytes:
    """Mean relative objective over time, all cases."""
    figure = new_figure(8.0, 4.6)
    axes = figure.add_subplot()
    _draw_curves(axes, results, results.cases)
    axes.set_xlabel("time since start [s]")
    axes.set_ylabel("mean relative objective")
    axes.set_title(f"all {len(results.cases)} cases")
    axes.legend(loc="lower right", fontsize=9)
    return png(figure)


def draw_by_scene(results: Results) -> bytes:
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
            aim = OBJECTIVE_WORDS.get(objective, words(objective))
            axes.set_title(f"{words(scene)}, {aim}", fontsize=10)
            if row == len(objectives) - 1:
                axes.set_xlabel("time since start [s]")
            if column == 0:
                axes.set_ylabel("mean relative objective")
    lines = [Line2D([], [], color=COLOURS[v], linewidth=2, label=v) for v in results.variants]
    figure.legend(handles=lines, loc="outside lower center", ncols=len(lines), frameon=False)
    return png(figure)


def draw_first_solutions(results: Results) -> bytes:
    """Share of the runs that have a placement, over time."""
    figure = new_figure(8.0, 4.2)
    axes = figure.add_subplot()
    limit = results.horizon
    for variant in results.variants:
        times = np.sort(first_times(results, variant, results.cases))
        share = np.arange(1, len(times) + 1) / len(times)
        known = np.isfinite(times)
        if known.any():
            x = [times[0], *times[known], max(limit, *times[known])]
            y = [0.0, *share[known], share[known][-1]]
            axes.step(x, y, where="post", color=COLOURS[variant], linewidth=2, label=variant)
    axes.set_xscale("log")
    axes.set_ylim(0.0, 1.03)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("time since start [s], environment construction included")
    axes.set_ylabel("share of runs with a placement")
    axes.grid(alpha=0.3, which="both")
    axes.legend(loc="lower right", fontsize=9)
    return png(figure)


def draw_differences(comparisons: Sequence[Comparison], results: Results) -> bytes:
    """Reference minus each other variant, case by case, with 95 % intervals."""
    labels = [case_label(case) for case in results.cases]
    figure = new_figure(3.4 + 2.6 * len(comparisons), 1.2 + 0.24 * (len(labels) + 1))
    panels = figure.subplots(1, len(comparisons), sharex=True, sharey=True, squeeze=False)[0]
    rows = {case: row for row, case in enumerate(results.cases, start=1)}
    for axes, comparison in zip(panels, comparisons, strict=True):
        axes.axvline(0.0, color="black", linewidth=0.8)
        axes.axhline(0.5, color="black", linewidth=0.5)
        _draw_interval(axes, 0, comparison.pooled, "black", comparison.pooled.p < 0.05)
        for difference in comparison.by_case:
            mean = float(difference.interval.mean)
            colour = COLOURS[REFERENCE] if mean >= 0.0 else COLOURS["uniform+lo"]
            significant = difference.adjusted_p < 0.05
            _draw_interval(axes, rows[difference.case], difference.interval, colour, significant)
        axes.set_title(f"{REFERENCE} minus {comparison.other}", fontsize=10)
        axes.set_xlabel("area under the curve")
        axes.grid(alpha=0.3, axis="x")
    panels[0].set_yticks(range(len(labels) + 1), ["all cases", *labels], fontsize=8)
    panels[0].set_ylim(len(labels) + 0.6, -0.6)
    marks = [
        Line2D([], [], color="black", marker="o", linestyle="", label="differs after Holm, 5 %"),
        Line2D(
            [],
            [],
            color="black",
            marker="o",
            markerfacecolor="white",
            linestyle="",
            label="does not",
        ),
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    return png(figure)


def draw_rejections(results: Results) -> bytes:
    """Where samples end: shares per variant, for each scene and objective."""
    scenes = list(dict.fromkeys(case.scene for case in results.cases))
    figure = new_figure(9.0, 1.4 + 0.3 * len(scenes) * (len(results.variants) + 1))
    axes = figure.add_subplot()
    position, ticks, names = 0.0, [], []
    used: set[str] = set()
    for scene in scenes:
        cases = [case for case in results.cases if case.scene == scene]
        for variant in results.variants:
            shares = rejections(results, variant, cases)
            left = 0.0
            for key, (_, colour) in _REJECTIONS.items():
                width = shares.get(key, 0.0)
                used |= {key} if width > 0.0 else set()
                axes.barh(position, width, left=left, color=colour, height=0.85)
                left += width
            ticks.append(position)
            names.append(f"{words(scene)}, {variant}")
            position += 1.0
        position += 0.7
    axes.set_yticks(ticks, names, fontsize=9)
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.0)
    axes.set_xlabel("share of the samples, by the first check that failed")
    handles = [
        Line2D([], [], color=colour, marker="s", linestyle="", markersize=9, label=label)
        for key, (label, colour) in _REJECTIONS.items()
        if key in used
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    return png(figure)


def draw_gaps(results: Results) -> bytes:
    """What each variant has at the horizon, case by case, beside the dense search."""
    figure = new_figure(8.5, 1.4 + 0.26 * len(results.cases))
    axes = figure.add_subplot()
    rng = np.random.default_rng(0)
    offsets = np.linspace(-0.28, 0.28, len(results.variants))
    for row, case in enumerate(results.cases):
        dense = results.yardsticks[case]["best"]
        if dense is not None:
            level = results.scales[case].relative(float(dense))
            axes.plot([level] * 2, [row - 0.42, row + 0.42], color="black", linewidth=1.6)
        for variant, offset in zip(results.variants, offsets, strict=True):
            if results.of_variant(variant, case):
                found = mean_interval([finals(results, variant, case)], rng)
                _draw_interval(axes, row + offset, found, COLOURS[variant], filled=True)
        late = [final(results.steps(r)) for r in results.of_variant(BASELINE, case)]
        if late:
            axes.plot([np.mean(late)], [row + 0.28], "D", color=COLOURS[BASELINE], markersize=5)
        if row % 2:
            axes.axhspan(row - 0.5, row + 0.5, color="black", alpha=0.04, linewidth=0)
    axes.set_yticks(range(len(results.cases)), map(case_label, results.cases), fontsize=8)
    axes.set_ylim(len(results.cases) - 0.5, -0.5)
    axes.set_xlim(-0.03, 1.03)
    axes.set_xlabel(f"relative objective after {results.horizon:g} s")
    axes.grid(alpha=0.3, axis="x")
    marks = [
        Line2D([], [], color=COLOURS[v], marker="o", linestyle="", label=v)
        for v in results.variants
    ]
    if BASELINE in results.variants:
        marks.append(Line2D([], [], color=COLOURS[BASELINE], marker="D", linestyle=""))
        marks[-1].set_label("baseline at its end")
    marks.append(Line2D([], [], color="black", marker="|", linestyle="", markersize=12))
    marks[-1].set_label("dense search")
    figure.legend(handles=marks, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return png(figure)


def _draw_curves(axes: Axes, results: Results, cases: Sequence[Case]) -> None:
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


def _draw_interval(axes: Axes, row: float, found: Interval, colour: str, filled: bool) -> None:
    mean, low, high = float(found.mean), float(found.low), float(found.high)
    axes.plot([low, high], [row, row], color=colour, linewidth=1.4)
    axes.plot(
        [mean],
        [row],
        marker="o",
        markersize=4.5,
        color=colour,
        markerfacecolor=colour if filled else "white",
    )
