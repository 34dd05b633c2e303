"""Settings of what is asked of a placement: turn of the object, terms, requirements."""

from __future__ import annotations

import math
from dataclasses import dataclass

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.settings import Settings, setting
from placement_planner_ros.core.wishes import checks


@dataclass(frozen=True, slots=True)
class TurnSettings(Settings):
    """How the object shall be turned where it stands; each rule has a tolerance.

    Attributes:
        up: (3,) a direction in the object's frame that shall point up; () for none.
        up_tolerance: how far from the vertical it may be.
        front: (3,) a direction in the object's frame whose horizontal part shall face an azimuth;
            () for none.
        front_direction: that azimuth, from x towards y of the planning frame.
        front_tolerance: how far from that azimuth it may be.
    """

    up: tuple[float, ...] = setting(
        (), text="Direction in the object's frame that points up where it stands; empty: any may."
    )
    up_tolerance: float = setting(
        0.17, f"[0, {math.pi}]", "rad", "How far `up` may be from the vertical."
    )
    front: tuple[float, ...] = setting(
        (),
        text="Direction in the object's frame whose horizontal part faces "
        "`front_direction` where it stands; empty: any may. Rests in which it is within 5 "
        "degrees of the vertical are out.",
    )
    front_direction: float = setting(
        0.0, unit="rad", text="Azimuth that `front` faces, from x towards y of `root frame`."
    )
    front_tolerance: float = setting(
        0.26, f"[0, {math.pi}]", "rad", "How far `front` may be from `front_direction`."
    )

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        checks.check_direction("`up`", self.up)
        checks.check_direction("`front`", self.front)

    @property
    def asks(self) -> bool:
        """Whether anything is asked."""
        return bool(self.up or self.front)


@dataclass(frozen=True, slots=True)
class WishSettings(Settings):
    """What a weighted objective is the sum of, and below what terms must never be.

    Attributes:
        terms: names of terms, see `objective.terms`.
        weights: one per term; () for 1 each. A negative one reverses its term.
        near_pose: (7,) x y z qx qy qz qw, what `near` and `turn` are measured to; () for none.
        required: names of terms that are never below `at_least`.
        at_least: one per required term, in its own unit.
    """

    terms: tuple[str, ...] = setting(
        (),
        text="With objective: weighted, names of the terms it is the sum of: clearance, near, "
        "turn, high, edge, aligned, stance, or entry points in the group "
        "placement_planner_ros.objectives.",
    )
    weights: tuple[float, ...] = setting(
        (),
        "[-10000, 10000]",
        text="Weights of `terms`, one each; empty: all 1. A negative one reverses its term.",
    )
    near_pose: tuple[float, ...] = setting(
        (),
        unit="m",
        text="Pose of the object in `root frame` that near and turn are measured to: "
        "x y z qx qy qz qw; empty: none.",
    )
    required: tuple[str, ...] = setting(
        (),
        text="Names of terms, as in `terms`, that are never below `at_least`, "
        "whatever the objective.",
    )
    at_least: tuple[float, ...] = setting(
        (), text="What `required` are never below, one number each, in the term's own unit."
    )

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        checks.check_pose_value("near_pose", self.near_pose)

    def require_consistent(self) -> None:
        """Refuse lists that do not fit each other.

        Raises:
            ParameterError: lengths differ, or a term needs `near_pose`.
        """
        # One weight for each term, or none.
        if self.weights and len(self.weights) != len(self.terms):
            raise ParameterError(
                "`weights`",
                list(self.weights),
                f"give one for each of the {len(self.terms)} `terms`, or none",
            )
        # One number for each requirement.
        if len(self.at_least) != len(self.required):
            raise ParameterError(
                "`at_least`",
                list(self.at_least),
                f"give one number for each of the {len(self.required)} `required`",
            )
        # Terms that need a pose, and those named twice.
        for name, given in (("`terms`", self.terms), ("`required`", self.required)):
            if not self.near_pose and {"near", "turn"} & set(given):
                raise ParameterError(name, list(given), "near and turn need near_pose; give it")
            if len(set(given)) != len(given):
                raise ParameterError(name, list(given), "name each term once")
