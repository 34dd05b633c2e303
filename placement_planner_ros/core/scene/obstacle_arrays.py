"""The obstacle set as kernels read it, in a file that does not change where it is made anew."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.types import Array


class ObstacleArrays(NamedTuple):
    """What kernels read of an `ObstacleSet`: its fields of these names."""

    origin: Array
    cell_size: float
    cells: npt.NDArray[np.int32]
    lower: Array
    upper: Array
    number_at: npt.NDArray[np.int32]
    next: npt.NDArray[np.int32]
