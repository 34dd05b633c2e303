"""Live counters of a run."""

from __future__ import annotations

from dataclasses import dataclass

from placement_planner_ros.core.search.sampler import SampleCount
from placement_planner_ros.core.types import Verdict


@dataclass(slots=True)
class Statistics:
    """Live counters of a run; written by the planner, read by any thread.

    Attributes:
        count: goal samples and their verdicts.
        goals: goals found, each a candidate for motion planning.
        motion_iterations: iterations of the bidirectional RRTs.
        unreached: motions to goals that could not be certified once timed.
        solutions: placements published.
        best: ξ_best; -inf before the first.
        gap: by how much ξ_best can be exceeded at most by placements on the placement regions,
            whatever the arms reach; None where that is not known. It never rises.
    """

    count: SampleCount
    goals: int = 0
    motion_iterations: int = 0
    unreached: int = 0
    solutions: int = 0
    best: float = float("-inf")
    gap: float | None = None

    @property
    def samples(self) -> int:
        """Goal samples tried."""
        return self.count.samples

    @property
    def rejected(self) -> dict[str, int]:
        """How many samples each constraint rejected, by its name in lower case."""
        return {
            verdict.name.lower(): number
            for verdict, number in self.count.verdicts.items()
            if verdict is not Verdict.FEASIBLE
        }
