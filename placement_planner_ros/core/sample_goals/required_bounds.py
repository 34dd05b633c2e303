"""Cells of the pose sets Ŝ(r, f) that provably lack what is required."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.objective.objective import PoseRanges
from placement_planner_ros.core.objective.terms import term_ends
from placement_planner_ros.core.types import Array

_TERM_ROUNDING = 1e-6
"""More than arithmetic is off by, in a term's unit."""


class RequiredBound:
    """What required terms are at most at all poses of a cell: of those that change slowly by what
    they are in its middle, of others by their ends.

    Args:
        poses: the required terms.
    """

    def __init__(self, poses: PoseConstraints) -> None:
        self._terms = () if poses.required is None else poses.required.terms_asked

    def lacking(self, ranges: PoseRanges) -> npt.NDArray[np.bool_]:
        """(n,) cells at all of whose poses one of them is too low."""
        result = np.zeros(len(ranges.T), np.bool_)
        for name, most in self.most(ranges).items():
            result |= most < self.at_least[name] - _TERM_ROUNDING
        return result

    @property
    def at_least(self) -> dict[str, float]:
        """What each must reach, by its name."""
        return {name: least for name, _, least in self._terms}

    def most(self, ranges: PoseRanges) -> dict[str, Array]:
        """(n,) of each, by its name, what it is at most at any pose of the cells."""
        return {name: term_ends(term, ranges)[1] for name, term, _ in self._terms}
