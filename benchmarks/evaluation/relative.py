"""The relative objective: 1 is the best placement known, 0 a random one or none at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.types import Array

Steps = Sequence[tuple[float, float]]
"""(seconds from the start, value) of every improvement, in order; each holds until the next."""


@dataclass(frozen=True, slots=True)
class Scale:
    """What makes the ξ of different cases comparable.

    Attributes:
        best: ξ of the best placement known.
        random: median ξ of random feasible placements.
    """

    best: float
    random: float

    def __post_init__(self) -> None:
        if not self.best > self.random:
            raise ParameterError(
                "best", self.best, f"must be above what a random placement has, {self.random}"
            )

    def relative(self, objective: float) -> float:
        """(ξ - random) / (best - random); 0 where worse than random, above 1 where above best."""
        return max(0.0, (objective - self.random) / (self.best - self.random))


def values_at(times: Array, steps: Steps) -> Array:
    """(k,) the value held at each of the (k,) times; 0 before the first improvement."""
    moments = np.array([moment for moment, _ in steps])
    values = np.array([0.0, *(value for _, value in steps)])
    return np.asarray(values[np.searchsorted(moments, times, side="right")])


def area_under_curve(steps: Steps, horizon: float) -> float:
    """The mean over time of the value held, from 0 to `horizon` seconds; 0 before the first."""
    within = [(moment, value) for moment, value in steps if moment < horizon]
    ends = [*(moment for moment, _ in within[1:]), horizon]
    held = zip(within, ends, strict=False)
    return sum(value * (end - moment) for (moment, value), end in held) / horizon
