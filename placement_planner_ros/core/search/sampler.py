"""SampleGoals (Algorithm 2): what its samplers share, from the budgets to the loop."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from placement_planner_ros.core.settings import Settings, setting
from placement_planner_ros.core.types import Array, Goal, Index, Mask, Verdict


@dataclass(frozen=True, slots=True)
class SamplerSettings(Settings):
    """Budgets of SampleGoals.

    Attributes:
        samples_per_call: g_max, samples after which a call ends with its batch.
        goals_per_call: a call ends once it has found that many goals.
        batch: samples whose cheap checks are made together.
    """

    samples_per_call: int = setting(200, "[1, inf)")
    goals_per_call: int = setting(1, "[1, inf)")
    batch: int = setting(64, "[1, inf)")


@dataclass(frozen=True, slots=True, eq=False)
class Draws:
    """Poses drawn but not checked yet, (n,) each; arm and grasp are -1 where any will do.

    Attributes:
        contact: (n, 3).
        slope: (n, 2) of the plane through it that the object stands on.
        least: (n,) ξ above which they are of use though not better than ξ_best, NaN: whatever it
            is; None: only those that are better.
    """

    arm: Index
    grasp: Index
    face: Index
    contact: Array
    angle: Array
    slope: Array
    least: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What became of a batch of draws.

    Attributes:
        verdicts: (n,) of each draw; NOT_BETTER of those, too, that nobody tried to reach.
        values: (n,) ξ where it was computed; less than 0 by what is lacking where a rule is broken;
            else -inf.
        usable: (n,) which of those that are of use (`Draws.least`) are free of collision, some arm
            that may be used being long enough and its hand free.
        tried: (n,) which of these some arm was asked to reach.
        goals: those found, in the order of the tries.
    """

    verdicts: Index
    values: Array
    usable: Mask
    tried: Mask
    goals: list[Goal]


TryOrder = Callable[[Index, Outcome, float], Iterator[int]]
"""Of the usable rows (n,) that are better than `best`, the next to be reached for; what became of
it is in the outcome when the one after it is asked for."""


def as_drawn(rows: Index, outcome: Outcome, best: float) -> Iterator[int]:
    """In the order of the draws."""
    yield from rows.tolist()


class GoalChecker(Protocol):
    """Checks samples against every constraint of the problem."""

    def check_batch(
        self,
        draws: Draws,
        best: float,
        goals: int,
        should_stop: Callable[[], bool],
        order: TryOrder,
    ) -> Outcome:
        """Each up to the first check that fails, cheap checks first, and then those that are better
        than `best` one after the other until there are so many goals, or it is told to stop."""
        ...


@dataclass(slots=True)
class SampleCount:
    """Running totals, read by other threads.

    Attributes:
        totals: (|Verdict|,) how many ended with each verdict; replaced as a whole at every change,
            so that who reads it sees one moment.
    """

    totals: Index = field(default_factory=lambda: np.zeros(len(Verdict), np.int64))

    @property
    def samples(self) -> int:
        """Samples tried."""
        return int(self.totals.sum())

    @property
    def verdicts(self) -> dict[Verdict, int]:
        """How many ended with each verdict."""
        return dict(zip(Verdict, self.totals.tolist(), strict=True))

    def add(self, verdicts: Index) -> None:
        """Count samples (n,) with these verdicts."""
        self.totals = self.totals + np.bincount(verdicts, minlength=len(Verdict))


class GoalSampler(Protocol):
    """SampleGoals with its state G_s."""

    count: SampleCount

    def sample_goals(self, best: float, should_stop: Callable[[], bool]) -> list[Goal]:
        """Goals better than `best`; ends at its budgets or when told to stop."""
        ...


class BatchSampler(ABC):
    """Algorithm 2 around a way to choose where to sample next.

    Args:
        checker: checks samples.
    """

    def __init__(self, checker: GoalChecker, settings: SamplerSettings) -> None:
        self.count = SampleCount()
        self._checker = checker
        self._budget = settings

    def sample_goals(self, best: float, should_stop: Callable[[], bool]) -> list[Goal]:
        """Goals better than `best`; ends at its budgets or when told to stop."""
        goals: list[Goal] = []
        tried, wanted = 0, self._budget.goals_per_call
        while tried < self._budget.samples_per_call and len(goals) < wanted and not should_stop():
            # A batch: draw, check, learn.
            draws = self._draw(best)
            outcome = self._checker.check_batch(
                draws, best, wanted - len(goals), should_stop, self._order
            )
            self._learn(outcome, best)
            self.count.add(outcome.verdicts)
            tried += len(draws.face)
            goals += outcome.goals
        return goals

    @abstractmethod
    def _draw(self, best: float) -> Draws:
        """The next poses to check, one at least."""

    def _order(self, rows: Index, outcome: Outcome, best: float) -> Iterator[int]:
        """`TryOrder` of the poses drawn last."""
        return as_drawn(rows, outcome, best)

    @abstractmethod
    def _learn(self, outcome: Outcome, best: float) -> None:
        """What became of the poses drawn last."""
