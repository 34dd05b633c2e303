"""What the paper's evaluation compares: the planner, its ablations and a plain baseline."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.experiments.baselines.rrt_connect import BaselinePlanner


@dataclass(frozen=True, slots=True)
class Variant:
    """One contender. All share checks, kernels and batching; only what is named differs."""

    planner: type[PlacementPlanner]
    settings: PlannerSettings
    description: str


_DEFAULTS = PlannerSettings()

VARIANTS: Mapping[str, Variant] = {
    "mcts+lo": Variant(PlacementPlanner, _DEFAULTS, "MCTS with local optimisation"),
    "uniform+lo": Variant(
        PlacementPlanner,
        replace(_DEFAULTS, sampler="uniform"),
        "uniform sampling with local optimisation",
    ),
    "uniform": Variant(
        PlacementPlanner,
        replace(_DEFAULTS, sampler="uniform", local_optimization=False),
        "uniform sampling without local optimisation",
    ),
    "mcts": Variant(
        PlacementPlanner,
        replace(_DEFAULTS, local_optimization=False),
        "MCTS without local optimisation",
    ),
    "baseline": Variant(
        BaselinePlanner, _DEFAULTS, "uniform samples, each planned for with stock RRTConnect"
    ),
    "mcts+lo+ucb1": Variant(
        PlacementPlanner,
        replace(_DEFAULTS, sampling=replace(_DEFAULTS.sampling, selection="ucb1")),
        "MCTS that selects by UCB1, as the paper does, with local optimisation",
    ),
    "mcts+lo+unpruned": Variant(
        PlacementPlanner,
        replace(
            _DEFAULTS,
            sampling=replace(_DEFAULTS.sampling, prune_reach=False, prune_support=False),
        ),
        "MCTS with local optimisation, without ruling out branches that hold nothing",
    ),
    "mcts+lo+gradient": Variant(
        PlacementPlanner,
        replace(_DEFAULTS, gradient_sampling=True),
        "MCTS with local optimisation, and samples that follow the gradient",
    ),
}
"""Name -> variant; the first is what the others are compared with."""

PAPER_VARIANTS = ("mcts+lo", "uniform+lo", "uniform", "mcts", "baseline")
"""Those that the presets run unless told otherwise."""
