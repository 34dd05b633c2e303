"""How an arm holds an object, puts it down, lets go and leaves."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from placement_planner_ros.core.collision.arm import CollisionSettings
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.reach.ik import IKSettings

LONGEST_RETREAT = 0.5
"""m."""
_SIDEWAYS = ((0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0))

Direction = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class ApproachSettings:
    """The straight way down onto the support.

    Attributes:
        approach_distance: height of the raised pre-placement above contact, metres.
        approach_minimum: the least height it may shrink to where there is less room, metres.
        approach_step: distance between joint waypoints, metres.
    """

    approach_distance: float = 0.05
    approach_minimum: float = 0.01
    approach_step: float = 0.01

    def __post_init__(self) -> None:
        if not 0.0 < self.approach_minimum <= self.approach_distance:
            raise ParameterError(
                "approach_distance",
                self.approach_distance,
                f"must be at least approach_minimum ({self.approach_minimum} m)",
            )
        if not self.approach_step > 0.0:
            raise ParameterError("approach_step", self.approach_step, "must be above zero")


@dataclass(frozen=True, slots=True)
class RetreatSettings:
    """The straight way of the open hand from the placed object.

    Attributes:
        retreat_distance: how far it goes at least, metres; it goes on until the hand keeps the
            collision margin from the object.
        retreat_step: distance between joint waypoints, metres.
        tip_directions: tried first, in the tip frame: the grasps' own directions of withdrawal. By
            default back along z, slanting to each side, then sideways.
        world_directions: tried next, in the planning frame.
    """

    retreat_distance: float = 0.1
    retreat_step: float = 0.01
    tip_directions: tuple[Direction, ...] = (
        (0.0, 0.0, -1.0),
        *((x, y, -1.0) for x, y in _SIDEWAYS),
        *((x, y, 0.0) for x, y in _SIDEWAYS),
    )
    world_directions: tuple[Direction, ...] = ((0.0, 0.0, 1.0),)

    def __post_init__(self) -> None:
        if not 0.01 <= self.retreat_distance <= LONGEST_RETREAT:
            raise ParameterError(
                "retreat_distance",
                self.retreat_distance,
                f"choose from 0.01 to {LONGEST_RETREAT} m",
            )
        if not 0.001 <= self.retreat_step <= 0.1:
            raise ParameterError("retreat_step", self.retreat_step, "choose from 0.001 to 0.1 m")
        if not (self.tip_directions or self.world_directions):
            raise ParameterError("tip_directions", (), "give at least one direction of retreat")
        for name in ("tip_directions", "world_directions"):
            for direction in getattr(self, name):
                length = float(np.linalg.norm(direction))
                if len(direction) != 3 or not 1e-6 < length < np.inf:
                    raise ParameterError(name, direction, "give three numbers, not all zero")


@dataclass(frozen=True, slots=True)
class GraspSettings:
    """Everything that holding, approach, release and retreat are checked by.

    Attributes:
        require_retreat: whether a placement without release and retreat counts for nothing.
    """

    collision: CollisionSettings = field(default_factory=CollisionSettings)
    ik: IKSettings = field(default_factory=IKSettings)
    approach: ApproachSettings = field(default_factory=ApproachSettings)
    retreat: RetreatSettings = field(default_factory=RetreatSettings)
    require_retreat: bool = True
