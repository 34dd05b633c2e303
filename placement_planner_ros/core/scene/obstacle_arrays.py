"""The obstacle set as kernels read it, in a file that does not change where it is made anew."""

from __future__ import annotations

from typing import NamedTuple

from placement_planner_ros.core.types import Array, Index32


class ObstacleArrays(NamedTuple):
    """What kernels read of an `ObstacleSet`: its fields of these names."""

    origin: Array
    cell_size: float
    cells: Index32
    lower: Array
    upper: Array
    number_at: Index32
    next: Index32
