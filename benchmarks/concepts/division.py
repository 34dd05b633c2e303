"""How the hierarchy divides what can be chosen, and where two ways to search it look."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch, Polygon, Rectangle, Wedge

from benchmarks.cases import Case, make_problem
from benchmarks.concepts.recorded import RecordedPlanner
from benchmarks.drawing.plots import new_figure
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.search.hierarchy import AfrHierarchy, AfrNode, HierarchySettings
from placement_planner_ros.core.types import Array, Verdict

CASE = Case("table", "small_crayons_box", "maximize_clearance")
SAMPLES = 6000
"""That each way to search tries."""
_SEED = 1
MCTS = replace(PlannerSettings(), sampler="mcts")
_LOOKED = {
    "nothing carries it there": ((Verdict.OUTSIDE_VOLUME, Verdict.UNSTABLE), "#a8a8a8"),
    "it would hit something": ((Verdict.COLLIDING,), "#e08050"),
    "good pose, but no better": ((Verdict.NOT_BETTER,), "#7fb0d8"),
    "the arm cannot do it": (tuple(range(Verdict.NO_IK, Verdict.FEASIBLE)), "#8050a0"),
    "goal": ((Verdict.FEASIBLE,), "#107010"),
}
_LEVELS = 3
_REGION = "#e4ead8"


def draw_division(path: Path) -> None:
    """Write a PNG of both.

    Args:
        path: of the PNG.
    """
    figure = new_figure(13.0, 4.6)
    axes = figure.subplots(1, 3)
    problem, _ = make_problem(CASE, np.random.default_rng(_SEED))
    _draw_hierarchy(axes[0], problem)
    _draw_search(axes[1], MCTS, "UCB1 (the paper's)")
    _draw_search(axes[2], PlannerSettings(), "optimistic (the default)")
    region = Patch(fc=_REGION, label="region")
    handles = [axes[1].plot([], [], "o", color=c, label=n)[0] for n, (_, c) in _LOOKED.items()]
    star = axes[1].plot([], [], "*", color="gold", markeredgecolor="black", markersize=12)[0]
    figure.legend(
        [region, *handles, star], ["region", *_LOOKED, "best placement"],
        loc="outside lower center", ncols=7,
        fontsize=8, frameon=False,
    )  # fmt: skip
    figure.savefig(path)


def _draw_hierarchy(axes: Axes, problem: Problem) -> None:
    """One region, divided again and again towards one place, with the turns left at each level."""
    regions = problem.environment.regions
    _draw_regions(axes, regions)
    largest = max(regions, key=lambda region: region.area)
    hierarchy = AfrHierarchy([1], 1, [largest], HierarchySettings())
    node = hierarchy.root
    while node.region is None:
        node = hierarchy.child(node, 0)
    for level in range(_LEVELS):
        _outline_cell(axes, node, level)
        if level + 1 < _LEVELS:
            node = hierarchy.child(node, hierarchy.child_count(node) // 2 + 1)
    axes.set_title("the hierarchy: a region and the turns about\nits normal, divided together")
    _frame_volume(axes, problem)


def _outline_cell(axes: Axes, node: AfrNode, level: int) -> None:
    assert node.region is not None
    colour = ("#1f5fa8", "#c05010", "#107010")[level]
    low, high = node.region.rectangles[:, :2].min(axis=0), node.region.rectangles[:, 2:].max(axis=0)
    x, y = (low + high) / 2
    axes.add_patch(Rectangle(low, *(high - low), fill=False, ec=colour, lw=1.8))
    first, last = np.degrees([node.angle_min, node.angle_max])
    radius = 0.25 * float((high - low).min())
    axes.add_patch(Wedge((x, y), radius, first, last, fc=colour, alpha=0.45))


def _draw_search(axes: Axes, settings: PlannerSettings, name: str) -> None:
    """What was tried within `SAMPLES`."""
    problem, objective = make_problem(CASE, np.random.default_rng(_SEED))
    planner = RecordedPlanner(problem, objective, settings, np.random.default_rng(_SEED))
    placed = list(planner.run(lambda: planner.statistics.samples >= SAMPLES))
    _draw_regions(axes, problem.environment.regions)
    places, verdicts = planner.record.places, planner.record.verdicts
    for verdicts_of, colour in _LOOKED.values():
        these = places[np.isin(verdicts, verdicts_of)]
        axes.plot(these[:, 0], these[:, 1], ".", color=colour, markersize=2.5)
    found = f"best after {len(places)} poses: none"
    if placed:
        at = placed[-1].goal.T_world_object.translation
        axes.plot(at[0], at[1], "*", color="gold", markeredgecolor="black", markersize=14)
        found = f"ξ {placed[-1].objective:.3f} m after {len(places):,} poses"
    axes.set_title(f"{name}\n{found}")
    _frame_volume(axes, problem)


def _draw_regions(axes: Axes, regions: tuple[Region, ...]) -> None:
    for region in regions:
        for outline in outlines(region):
            axes.add_patch(Polygon(outline, fc=_REGION, ec="none"))


def outlines(region: Region) -> list[Array]:
    """The corners (4, 2) of its rectangles."""
    return [
        np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
        for x0, y0, x1, y1 in region.rectangles.tolist()
    ]


def _frame_volume(axes: Axes, problem: Problem) -> None:
    lower, upper = problem.volume.lower, problem.volume.upper
    axes.set_xlim(lower[0] - 0.02, upper[0] + 0.02)
    axes.set_ylim(lower[1] - 0.02, upper[1] + 0.02)
    axes.set_aspect("equal")
    axes.set_xlabel("x in m")
    axes.set_ylabel("y in m")
