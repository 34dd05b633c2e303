"""Cells of the pose sets Ŝ(r, f) that provably lack what is required."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.objective.terms import SlowTerm
from placement_planner_ros.core.sample_goals.placed_cells import PlacedCells
from placement_planner_ros.core.types import Array

_TERM_ROUNDING = 1e-6
"""More than arithmetic is off by, in a term's unit."""


class RequiredBound:
    """What required terms are at most at all poses of a cell: of those that change slowly by what
    they are in its middle, of others by their ends.

    Args:
        poses: the required terms, and how faces are placed.
    """

    def __init__(self, poses: PoseConstraints) -> None:
        faces = poses.problem.body.faces
        self._T_face_object = np.array([face.T_face_object.homogeneous for face in faces])
        self._terms = () if poses.required is None else poses.required.terms_asked

    def lacking(self, placed: PlacedCells) -> npt.NDArray[np.bool_]:
        """(n,) cells at all of whose poses one of them is too low."""
        result = np.zeros(len(placed.face), np.bool_)
        for name, most in self.most(placed).items():
            result |= most < self.at_least[name] - _TERM_ROUNDING
        return result

    @property
    def at_least(self) -> dict[str, float]:
        """What each must reach, by its name."""
        return {name: least for name, _, least in self._terms}

    def most(self, placed: PlacedCells) -> dict[str, Array]:
        """(n,) of each, by its name, what it is at most at any pose of the cells."""
        if not self._terms:
            return {}
        T = placed.poses(self._T_face_object)
        origins = self._T_face_object[placed.face, :3, 3][:, None]
        aside = np.linalg.norm(placed.half, axis=1) + placed.strays(origins)[:, 0]
        away = np.hypot(aside, placed.rises(origins)[:, 0])
        return {
            name: term.most_around(T, away, placed.half_turn, placed.rise)
            if isinstance(term, SlowTerm)
            else np.full(len(T), term.ends[1])
            for name, term, _ in self._terms
        }
