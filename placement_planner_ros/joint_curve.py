"""Joint positions over time, as pictures and pages play them: straight between points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.types import Array


@dataclass(frozen=True, slots=True, eq=False)
class JointCurve:
    """Joint positions over time.

    Attributes:
        joints: (dof) names.
        times: (n,) seconds, increasing from 0 on.
        positions: (n, dof) rad or m.
    """

    joints: tuple[str, ...]
    times: Array
    positions: Array

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self.times[-1])

    def at(self, time: float) -> dict[str, float]:
        """Position of each joint."""
        values = (np.interp(time, self.times, column) for column in self.positions.T)
        return dict(zip(self.joints, map(float, values), strict=True))
