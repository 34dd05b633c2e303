"""Joint positions over time, as pictures and pages play them: straight between points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

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

    @classmethod
    def of(cls, message: Any) -> JointCurve:
        """Of a JointTrajectory with points.

        Raises:
            ValueError: its points do not fit its joints, or are not finite, or not in order.
        """
        points, joints = message.points, tuple(message.joint_names)
        times = np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in points])
        positions = np.array([p.positions for p in points], dtype=np.float64)
        if positions.shape != (len(points), len(joints)):
            raise ValueError(f"its points do not fit its {len(joints)} joints")
        if not np.isfinite(positions).all() or (np.diff(times) < 0.0).any():
            raise ValueError("its points are not finite, or not in order")
        return cls(joints, times, positions)

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self.times[-1])

    def at(self, time: float) -> dict[str, float]:
        """Position of each joint."""
        values = (np.interp(time, self.times, column) for column in self.positions.T)
        return dict(zip(self.joints, map(float, values), strict=True))
