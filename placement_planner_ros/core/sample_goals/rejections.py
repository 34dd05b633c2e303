"""Tries to reach poses, counted per arm, grasp and face, and what was missed."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.search.cell_layout import MAX_CELLS
from placement_planner_ros.core.types import Verdict


class Rejections:
    """Counted for all of a run.

    Attributes:
        tries: (holdings, |F|, |Verdict|) how many tries of each holding (arm after arm, grasp after
            grasp) to reach a pose on each face ended with each verdict. FEASIBLE are goals. Poses
            that no arm was to reach are not in here.
        missed: ξ of poses better than ξ_best that are free and stand, but were not reached.
    """

    def __init__(self, holdings: int, faces: int) -> None:
        self.tries: npt.NDArray[np.int64] = np.zeros(
            (holdings, faces, len(Verdict)), dtype=np.int64
        )
        self.missed: deque[float] = deque(maxlen=MAX_CELLS)
