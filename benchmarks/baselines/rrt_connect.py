"""A plain baseline: place as most systems do, with a stock planner, one goal at a time."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from ompl import geometric as og
from ompl import util as ou

from benchmarks.baselines.ompl_space import EdgeFree, EdgeSpace
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.types import Array, Goal

STOCK_SETTINGS = PlannerSettings(sampler="uniform", local_optimization=False)
SECONDS_PER_GOAL = 5.0
"""How long RRTConnect may take for one goal, of processor time."""


def rrt_connect(
    holding: Holding, goals: Sequence[Array], edge_free: EdgeFree, should_stop: Callable[[], bool]
) -> Array | None:
    """A path (n, dof) from q_0 to one of the goals (dof,) by OMPL's RRTConnect as it comes.

    Args:
        edge_free: whether a straight motion is free, its ends included.
    """
    ou.setLogLevel(ou.LOG_ERROR)
    space = EdgeSpace(holding.arm.lower, holding.arm.upper, edge_free)
    return space.planner(og.RRTConnect, holding.q_start, goals)(should_stop)


class RRTConnectMotion:
    """PlanMotion with OMPL's RRTConnect as it comes: a new search for every goal, in their order.

    Takes the place of `MotionPlanner`. OMPL draws from its own generator, so that runs of the
    baseline do not repeat exactly.
    """

    def __init__(self, holdings: Mapping[tuple[str, int], Holding]) -> None:
        self._holdings = holdings
        self._waiting: list[Goal] = []
        self.iterations = 0

    @property
    def goals(self) -> int:
        """Goals not tried yet."""
        return len(self._waiting)

    def add(self, goal: Goal) -> None:
        """One more goal to try."""
        self._waiting.append(goal)

    def retire(self, goal: Goal) -> None:
        """Forget a goal."""
        self._waiting = [g for g in self._waiting if g is not goal]

    def retire_up_to(self, bound: float) -> None:
        """Forget the goals with ξ ≤ bound."""
        self._waiting = [g for g in self._waiting if g.objective > bound]

    def plan(
        self, max_iterations: int, should_stop: Callable[[], bool]
    ) -> tuple[Goal, Array] | None:
        """Try the first goal until it is reached or `SECONDS_PER_GOAL` have passed.

        Args:
            max_iterations: not used; a stock planner is given time.

        Returns:
            The goal and the path (n, dof) from q_0 to its raised pre-placement, or None.
        """
        goal = self._waiting.pop(0)
        holding = self._holdings[goal.arm, goal.grasp]
        deadline = time.process_time() + SECONDS_PER_GOAL

        def edge_free(a: Array, b: Array) -> bool:
            self.iterations += 1
            return holding.transit_free(a, b)

        def late() -> bool:
            return should_stop() or time.process_time() > deadline

        path = rrt_connect(holding, [goal.q_raised], edge_free, late)
        return None if path is None else (goal, path)


class BaselinePlanner(PlacementPlanner):
    """Samples of position and yaw on the surfaces, IK, RRTConnect, the best is kept.

    `STOCK_SETTINGS` have it draw uniformly and leave out local optimisation. Samples that are no
    better than the best placement so far are not planned for. Everything but the way of sampling
    and planning, checks and timing included, is the planner's own.
    """

    def make_motion(self, rng: np.random.Generator) -> RRTConnectMotion:
        """One goal at a time, without `rng`, which OMPL does not draw from."""
        return RRTConnectMotion(self.holdings)
