"""What the paper's evaluation compares: the planner, its ablations and a plain baseline."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from benchmarks.baselines.rrt_connect import STOCK_SETTINGS, BaselinePlanner
from benchmarks.cases import boxes_ready
from placement_planner_ros.core.planner import (
    SAMPLERS,
    PlacementPlanner,
    PlannerSettings,
    SamplerName,
)
from placement_planner_ros.core.problem import Problem


@dataclass(frozen=True, slots=True)
class Variant:
    """One contender. All share checks, kernels and batching; only what is named differs.

    Attributes:
        ready: what belongs to the environment's construction.
    """

    planner: type[PlacementPlanner]
    settings: PlannerSettings
    description: str
    ready: Callable[[Problem], object] = boxes_ready


_DEFAULTS = PlannerSettings()

_WORDS = {"optimistic": "optimistic search", "mcts": "tree search by UCB1 and H, as in the paper"}


def _variant_of(sampler: SamplerName, local_optimization: bool) -> Variant:
    settings = replace(_DEFAULTS, sampler=sampler, local_optimization=local_optimization)
    words = _WORDS.get(sampler, f"{sampler} sampling")
    how = "with" if local_optimization else "without"
    return Variant(PlacementPlanner, settings, f"{words}, {how} local optimisation")


VARIANTS: Mapping[str, Variant] = {
    **{f"{sampler}+lo": _variant_of(sampler, True) for sampler in SAMPLERS},
    **{sampler: _variant_of(sampler, False) for sampler in SAMPLERS},
    "baseline": Variant(
        BaselinePlanner, STOCK_SETTINGS, "uniform samples, each planned for with stock RRTConnect"
    ),
}
"""Name -> variant; the first is what the others are compared with."""

PAPER_VARIANTS = ("optimistic+lo", "mcts+lo", "uniform+lo", "uniform", "optimistic", "baseline")
"""Those that the presets run unless told otherwise."""
