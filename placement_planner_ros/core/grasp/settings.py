"""Settings of holding an object, putting it down, letting go and leaving."""

from __future__ import annotations

from dataclasses import dataclass, field

from placement_planner_ros.core.carry.settings import TiltLimit
from placement_planner_ros.core.collision.arm import CollisionSettings
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.reach.ik import IKSettings
from placement_planner_ros.core.settings import Settings, setting

LONGEST_RETREAT_M = 0.5
"""m."""


@dataclass(frozen=True, slots=True)
class ApproachSettings(Settings):
    """The straight way down onto the support.

    Attributes:
        approach_distance: height of the raised pre-placement above contact.
        approach_minimum: the least height it may shrink to where there is less room.
        approach_step: distance between joint waypoints.
    """

    approach_distance: float = setting(
        0.05,
        "[0.01, 0.5]",
        "m",
        "Length of the straight way down onto the support; shorter where there is less room.",
    )
    approach_minimum: float = setting(0.01, "(0, 0.5]", "m")
    approach_step: float = setting(0.01, "(0, inf)", "m")

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.approach_minimum > self.approach_distance:
            raise ParameterError(
                "approach_distance",
                self.approach_distance,
                f"must be at least approach_minimum ({self.approach_minimum} m)",
            )


@dataclass(frozen=True, slots=True)
class RetreatSettings(Settings):
    """The straight way of the open hand from the placed object.

    Attributes:
        retreat_distance: at least; it goes on until the hand keeps the collision margin from the
            object.
        retreat_step: distance between joint waypoints.
    """

    retreat_distance: float = setting(
        0.1,
        f"[0.01, {LONGEST_RETREAT_M}]",
        "m",
        "Least length of the straight way that the open hand takes off the placed object.",
    )
    retreat_step: float = setting(0.01, "[0.001, 0.1]", "m")


@dataclass(frozen=True, slots=True)
class GraspSettings:
    """Everything that holding, approach, release and retreat are checked by.

    Attributes:
        require_retreat: whether a placement without release and retreat counts for nothing.
        tilt: by how much the held object may lean; None for any.
        limit_inset: rad or m, how far within the joint limits configurations are planned.
    """

    collision: CollisionSettings = field(default_factory=CollisionSettings)
    ik: IKSettings = field(default_factory=IKSettings)
    approach: ApproachSettings = field(default_factory=ApproachSettings)
    retreat: RetreatSettings = field(default_factory=RetreatSettings)
    require_retreat: bool = True
    tilt: TiltLimit | None = None
    limit_inset: float = 0.0
