"""PlanMotion: transit to any goal of the set 𝒢, one goal-set RRT per arm and grasp (M_s)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from placement_planner_ros.core.motion.birrt import GoalSetRRT, GoalSetRRTSettings
from placement_planner_ros.core.holding import Holding
from placement_planner_ros.core.types import Array, Goal


class MotionPlanner:
    """Trees that persist over a run, and the goals they may connect to.

    Args:
        holdings: every usable arm with each of its grasps.
        rng: split among the trees.
    """

    def __init__(
        self, holdings: list[Holding], settings: GoalSetRRTSettings, rng: np.random.Generator
    ) -> None:
        self._trees: dict[tuple[str, int], GoalSetRRT] = {}
        self._goals: dict[tuple[str, int], dict[int, Goal]] = {}
        for holding, child in zip(holdings, rng.spawn(len(holdings)), strict=True):
            tree = (holding.arm.name, holding.grasp)
            self._trees[tree] = GoalSetRRT(
                holding.arm.lower,
                holding.arm.upper,
                holding.q_start,
                holding.transit_free,
                settings,
                child,
            )
            self._goals[tree] = {}
        self._next_key = 0

    @property
    def goals(self) -> int:
        """|𝒢|."""
        return sum(len(goals) for goals in self._goals.values())

    @property
    def iterations(self) -> int:
        """RRT iterations spent so far."""
        return sum(tree.iterations for tree in self._trees.values())

    def add(self, goal: Goal) -> None:
        """𝒢 ← 𝒢 ∪ {g}."""
        tree = (goal.arm, goal.grasp)
        self._trees[tree].add_goal(self._next_key, goal.q_raised)
        self._goals[tree][self._next_key] = goal
        self._next_key += 1

    def retire(self, unwanted: Callable[[Goal], bool]) -> None:
        """𝒢 ← 𝒢 \\ {g | unwanted}; their trees are kept."""
        for tree, goals in self._goals.items():
            for key in [key for key, goal in goals.items() if unwanted(goal)]:
                self._trees[tree].retire_goal(key)
                del goals[key]

    def plan(
        self, max_iterations: int, should_stop: Callable[[], bool]
    ) -> tuple[Goal, Array] | None:
        """Spend up to m_max iterations on each tree that has goals, the least used tree first.

        Returns:
            A goal reached and the path (n, dof) from q_0 to its raised pre-placement, or None.
        """
        for tree in sorted(self._trees, key=lambda t: self._trees[t].iterations):
            if not self._goals[tree] or should_stop():
                continue
            found = self._trees[tree].solve(max_iterations, should_stop)
            if found is not None:
                key, path = found
                return self._goals[tree][key], path
        return None
