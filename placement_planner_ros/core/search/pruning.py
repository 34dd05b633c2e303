"""Branches that provably hold nothing, or nothing better."""

from __future__ import annotations

import enum
from typing import Protocol

from placement_planner_ros.core.search.cell_layout import Cells
from placement_planner_ros.core.types import Array, Index


class Ruling(enum.IntEnum):
    """What is known of a cell."""

    OPEN = 0
    """It may hold a goal."""
    OUT_OF_REACH = 1
    """At every pose the object is out of reach of every arm in every grasp."""
    UNSUPPORTED = 2
    """At every pose a vertex of v(f) has no support, or the centre of mass is outside V."""
    BREAKS_RULE = 3
    """At every pose a term that is required is too low."""
    COLLIDING = 4
    """At every pose the object overlaps an obstacle."""


class CellBounds(Protocol):
    """Judges whole cells at once."""

    @property
    def bounded(self) -> bool:
        """Whether anything is known of ξ."""
        ...

    @property
    def turn_radius(self) -> float:
        """m that one radian counts as."""
        ...

    def rulings(self, cells: Cells) -> Index:
        """(n,) `Ruling` of each of the (n,) cells; any but OPEN is proven for all its poses."""
        ...

    def most(self, cells: Cells, rough: bool = False) -> Array:
        """(n,) what ξ does not exceed at any pose of the cells; roughly, where that will do."""
        ...
