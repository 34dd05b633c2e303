"""Live counters of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.sample_goals.rejections import Rejections
from placement_planner_ros.core.search.sampler import SampleCount, summed_by_name
from placement_planner_ros.core.types import Verdict


@dataclass(slots=True)
class Statistics:
    """Live counters of a run; written by the planner, read by any thread.

    Attributes:
        count: goal samples and their verdicts.
        rejections: of these, what became of the tries to reach poses.
        arms: the name of the arm of each of its holdings.
        groups: what the samples of each feature of the object are counted under.
        goals: goals found, each a candidate for motion planning.
        motion_iterations: iterations of the bidirectional RRTs.
        unreached: motions to goals that could not be certified once timed.
        solutions: placements published.
        best: ξ_best; -inf before the first.
        gap: by how much ξ_best can be exceeded at most by placements on the placement regions,
            whatever the arms reach; None where that is not known. It never rises.
    """

    count: SampleCount
    rejections: Rejections
    arms: tuple[str, ...]
    groups: tuple[str, ...] = ()
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
    def missed(self) -> tuple[int, float]:
        """How many poses that are free, stand and are better than ξ_best were tried and not
        reached, and the largest ξ of those; -inf where there are none."""
        values = np.array(self.rejections.missed)
        values = values[values > self.best]
        return len(values), float(values.max(initial=-np.inf))

    @property
    def rejected(self) -> dict[str, int]:
        """How many samples each constraint rejected, by its name in lower case."""
        return {
            verdict.name.lower(): number
            for verdict, number in self.count.verdicts.items()
            if verdict is not Verdict.FEASIBLE
        }

    @property
    def rejected_by_group(self) -> dict[str, dict[str, int]]:
        """The same of each placement face, and of each wall that edges lean on."""
        return {
            group: _rejected_counts(row)
            for group, row in summed_by_name(self.groups, self.count.by_face).items()
        }

    @property
    def rejected_by_arm(self) -> dict[str, dict[str, int]]:
        """How many tries of each arm to reach a pose each constraint rejected."""
        return {
            name: _rejected_counts(row)
            for name, row in summed_by_name(self.arms, self.rejections.tries.sum(axis=1)).items()
        }


def _rejected_counts(row: npt.NDArray[np.int64]) -> dict[str, int]:
    """What is not 0 of the counts (|Verdict|,), by the constraint's name in lower case."""
    return {
        verdict.name.lower(): int(row[verdict])
        for verdict in Verdict
        if verdict is not Verdict.FEASIBLE and row[verdict]
    }
