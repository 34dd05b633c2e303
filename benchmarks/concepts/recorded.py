"""A planner that remembers every pose it checked, and what became of it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from placement_planner_ros.core.planner import PlacementPlanner
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.search.sampler import (
    Draws,
    GoalChecker,
    GoalSampler,
    Index,
    Outcome,
)
from placement_planner_ros.core.types import Array


class CheckRecord:
    """Checks as it is given, and keeps what was checked.

    Args:
        checker: what checks.
    """

    def __init__(self, checker: GoalChecker) -> None:
        self._checker = checker
        self._places: list[Array] = []
        self._verdicts: list[Index] = []

    @property
    def places(self) -> Array:
        """(n, 3) contact points, in order."""
        return np.concatenate([np.zeros((0, 3)), *self._places])

    @property
    def verdicts(self) -> Index:
        """(n,) of each."""
        return np.concatenate([np.zeros(0, dtype=np.int64), *self._verdicts])

    def check_batch(
        self, draws: Draws, best: float, goals: int, should_stop: Callable[[], bool]
    ) -> Outcome:
        """As `GoalChecker` says."""
        outcome = self._checker.check_batch(draws, best, goals, should_stop)
        self._places.append(draws.contact[: len(outcome.verdicts)].copy())
        self._verdicts.append(outcome.verdicts.copy())
        return outcome


class RecordedPlanner(PlacementPlanner):
    """The planner, with a `record` of what it checks."""

    record: CheckRecord

    def make_sampler(
        self, hierarchy: AfrHierarchy, checker: GoalChecker, rng: np.random.Generator
    ) -> GoalSampler:
        """As its settings say, around the record."""
        self.record = CheckRecord(checker)
        return super().make_sampler(hierarchy, self.record, rng)
