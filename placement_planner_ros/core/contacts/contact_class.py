"""Contact class: a kind of feature of the object, and what such features may rest on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import pinocchio as pin

from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.search.hierarchy import Ranges
from placement_planner_ros.core.types import Array, Contact, Index, Mask, Resting, Slope


@dataclass(frozen=True, slots=True)
class Missing:
    """What there is nothing of to rest on."""

    words: str
    parameter: str
    """What to change, and how."""
    remedy: str


class ContactClass(Protocol):
    """How features of the object rest on the surroundings; features are numbers from 0 on.

    Attributes:
        regions: where the features' reference points are placed.
        references: (k, 3) the point of each feature, in the object's frame, that says where the
            object is.
        frames: fT_o of features whose poses are `references` at a point, turned about the normal
            there; None of others.
    """

    @property
    def regions(self) -> tuple[Region, ...]: ...

    @property
    def references(self) -> Array: ...

    @property
    def frames(self) -> tuple[pin.SE3 | None, ...]: ...

    def ranges(self, feature: int, region: Region) -> Ranges:
        """In which angles a feature may be placed on one of the regions; () for not at all."""
        ...

    def poses(self, features: Index, points: Array, angles: Array, slopes: Array | None) -> Array:
        """(n, 4, 4) T_world_object with the reference points at (n, 3), on planes of slopes (n, 2),
        level unless given."""
        ...

    def stable(self, T: Array, features: Index, slope: Slope) -> Mask:
        """(n,) s(x) of poses (n, 4, 4) with these features (n,) on planes of one slope, but for
        `held`."""
        ...

    def held(self, T: Array, features: Index) -> Mask:
        """(n,) what of s(x) takes longer than c_f(x): of those alone that are free it is asked."""
        ...

    def free(self, T: Array, features: Index, heights: Array, raised: float, slope: Slope) -> Mask:
        """(n,) c_f(x), all along the straight way on which contacts open, that many metres long.

        Args:
            heights: (n,) z of the contact planes at x = y = 0, metres.
        """
        ...

    def opening(self, feature: int) -> Array:
        """(3,) unit direction in which all contacts open together."""
        ...

    def moved(self, T_world_object: pin.SE3, contact: Contact, change: Array) -> pin.SE3 | None:
        """The pose changed by (x, y, e_z) as far as the class leaves that free; None where it
        rests no more."""
        ...

    def excluded(self, features: Index, heights: Array, low: Array, high: Array) -> Mask:
        """(n,) boxes of places, of features (n,) on planes of heights (n,) at x = y = 0, from
        corner to corner, (n, 3) each of x, y and θ, that provably hold no pose with s(x)."""
        ...

    def resting(self, T_world_object: pin.SE3, feature: int) -> Resting:
        """What touches at a pose."""
        ...

    def missing(self) -> Missing | None:
        """What there is nothing of to rest on; None where there is something."""
        ...
