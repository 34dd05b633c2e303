"""The object as an arm has it: attached to the hand, or placed where it stands."""

from __future__ import annotations

from dataclasses import dataclass

import pinocchio as pin

from placement_planner_ros.core.body.body import Body


@dataclass(frozen=True, slots=True, eq=False)
class AttachedObject:
    """The object moves with the hand.

    Attributes:
        grasp: index into the arm's grasps.
    """

    body: Body
    grasp: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class PlacedObject:
    """The object stands at x; to the arm it is an obstacle."""

    body: Body
    T_world_object: pin.SE3
