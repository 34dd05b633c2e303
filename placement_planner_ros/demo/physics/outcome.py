"""The result of carrying out a placement, in numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.types import Array

_ARRIVED_WITHIN = 0.002
"""Metres from where it was planned at which a held thing has not reached it."""


@dataclass(frozen=True, slots=True)
class CarryOutcome:
    """How far things went otherwise than planned.

    Attributes:
        off: metres that the held thing was from its planned place at the end of the trajectory.
        moved: metres that it stands from there at last; both of its centre of mass.
        tilted: rad between the direction that was to be up and the one that is.
        struck: pairs of names that pressed on each other and should not have.
    """

    off: float
    moved: float
    tilted: float
    struck: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(
        cls,
        center_of_mass: Array,
        planned: pin.SE3,
        arrived: pin.SE3,
        stands: pin.SE3,
        struck: set[tuple[str, str]],
    ) -> CarryOutcome:
        """Of a thing's centre of mass (3,) in its frame, and its poses in the world."""
        return cls(
            apart(center_of_mass, planned, arrived),
            apart(center_of_mass, planned, stands),
            leaning(planned, stands),
            tuple(sorted(struck)),
        )

    @property
    def reached(self) -> bool:
        """Whether the thing came where it should, and nothing was struck on the way."""
        return self.off < _ARRIVED_WITHIN and not self.struck


def leaning(before: pin.SE3, after: pin.SE3) -> float:
    """rad between a body's direction that was up and where that points now."""
    turned = np.asarray(after.rotation @ before.rotation.T)
    return float(np.arctan2(np.hypot(turned[0, 2], turned[1, 2]), turned[2, 2]))


def apart(center: Array, one: pin.SE3, other: pin.SE3) -> float:
    return float(np.linalg.norm(one.act(center) - other.act(center)))
