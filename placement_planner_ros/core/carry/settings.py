"""Settings of the way on which the object is carried."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.settings import Settings, setting
from placement_planner_ros.core.types import Array, frozen_array

_DESCENT_TURN_RAD = 2e-3
"""rad, by which the object may be turned on its straight way down, where it strays from it."""


@dataclass(frozen=True, slots=True)
class CarrySettings(Settings):
    """What is kept on all of transit and approach, the placement included."""

    max_tilt: float = setting(
        math.pi,
        f"[0, {math.pi}]",
        "rad",
        "Angle between `up` and the vertical that the object is never tilted by on its way, "
        "nor where it stands; pi: any.",
    )
    max_acceleration: float = setting(
        0.0,
        "[0, inf)",
        "m/s^2",
        "Acceleration of the object's centre of mass that is never exceeded on its way; 0: any.",
    )

    def tilt_limit(self, up: Sequence[float]) -> TiltLimit | None:
        """By how much the object may lean; None for any.

        Args:
            up: `TurnSettings.up`, (3,) or empty.

        Raises:
            ParameterError: there is a limit, but no direction to hold it to.
        """
        if self.max_tilt >= math.pi:
            return None
        if not len(up):
            raise ParameterError(
                "`max_tilt`",
                self.max_tilt,
                "needs `up`, the direction of the object that is kept near the vertical; set it, "
                "or leave `max_tilt` at its default, pi",
            )
        return TiltLimit(np.array(up), self.max_tilt)


@dataclass(frozen=True, slots=True, eq=False)
class TiltLimit:
    """A direction of the object, and how far from the vertical it may be.

    Attributes:
        up: (3,) unit vector in the object's frame.
        most: rad, below π.
    """

    up: Array
    most: float

    def __post_init__(self) -> None:
        up = np.asarray(self.up, dtype=np.float64)
        object.__setattr__(self, "up", frozen_array(up / np.linalg.norm(up), (3,)))

    @property
    def at_rest(self) -> float:
        """By how much it may lean where it stands, rad: the way down needs the rest."""
        return max(self.most - _DESCENT_TURN_RAD, 0.0)

    def tilt(self, R_world_object: Array) -> float:
        """The angle, rad, at a rotation (3, 3)."""
        x, y, z = np.asarray(R_world_object) @ self.up
        return math.atan2(math.hypot(x, y), z)
