"""Tries to reach poses, counted per arm, grasp and face, and some poses refused."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.types import LEVEL, Array, Slope, Verdict

_REMEMBERED_POSES = 32
"""Poses remembered of each verdict, the newest."""
_REMEMBERED_VALUES = 10_000
"""Values remembered of poses that were not reached, the newest."""


class RejectedPose(NamedTuple):
    """A pose x that some constraint refused."""

    face: int
    """Index of the face f it stands on."""
    T_world_object: pin.SE3
    """x"""
    contact_height: float
    """z of the contact plane at x = y = 0, metres."""
    holding: int = -1
    """Index of what tried to reach it, as in `Rejections`; -1 where nothing did."""
    slope: Slope = LEVEL
    """Of the contact plane."""


class Rejections:
    """Counted for all of a run; poses are remembered for as long as nothing has been found.

    Attributes:
        tries: (holdings, |F|, |Verdict|) how many tries of each holding (arm after arm, grasp after
            grasp) to reach a pose on each face ended with each verdict. FEASIBLE are goals. Poses
            that no arm was to reach are not in here.
        poses: of each verdict the newest.
        missed: ξ of poses better than ξ_best that are free and stand, but were not reached.
    """

    def __init__(self, holdings: int, faces: int) -> None:
        self.tries: npt.NDArray[np.int64] = np.zeros(
            (holdings, faces, len(Verdict)), dtype=np.int64
        )
        self.missed: deque[float] = deque(maxlen=_REMEMBERED_VALUES)
        self.poses: dict[Verdict, deque[RejectedPose]] = {
            verdict: deque(maxlen=_REMEMBERED_POSES) for verdict in Verdict
        }

    def by_name(self, names: Sequence[str]) -> dict[str, npt.NDArray[np.int64]]:
        """(|Verdict|,) tries of all holdings that have the same of these names."""
        totals: dict[str, npt.NDArray[np.int64]] = {}
        for name, row in zip(names, self.tries.sum(axis=1), strict=True):
            totals[name] = totals.get(name, np.zeros_like(row)) + row
        return totals

    def remember(
        self,
        verdicts: npt.NDArray[np.int64],
        faces: npt.NDArray[np.int64],
        T: Array,
        heights: Array,
        slopes: Array,
    ) -> None:
        """Keep of a batch the first pose (4, 4) of each verdict that no arm had part in, with the
        height and slope of its contact plane."""
        known = verdicts.tolist()
        for verdict in (Verdict.UNSTABLE, Verdict.COLLIDING, Verdict.BREAKS_RULE):
            if verdict in known:
                k = known.index(verdict)
                slope = float(slopes[k, 0]), float(slopes[k, 1])
                pose = RejectedPose(int(faces[k]), pin.SE3(T[k]), float(heights[k]), slope=slope)
                self.poses[verdict].append(pose)
