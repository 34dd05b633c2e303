"""Protrusions under an object between its contacts: ribs, coins, waves of cloth."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import numpy as np

from placement_planner_ros.core.body.placement_face import PlacementFace
from placement_planner_ros.core.contacts.coplanarity import MAX_LEAN_SLOPE
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import Array, Index, Mask, Slope

_RISE_NOISES = 1.6
"""Times the noise of heights by which single surfaces under an object may be above their plane."""


class Protrusions:
    """Whether something under an object lifts it off what is taken to carry it.

    Args:
        environment: its surfaces.
        faces: on which the object may stand.
        touching: (k, 2) points of the object that lie in the plane of one of these, in its frame;
            asked for once where something is in the way.
        tolerance: m above the contact plane up to which surfaces count; with what is higher the
            object collides.
    """

    def __init__(
        self,
        environment: Environment,
        faces: Sequence[PlacementFace],
        touching: Callable[[int], Array],
        tolerance: float,
    ) -> None:
        self._environment = environment
        inward = [face.T_face_object.inverse() for face in faces]
        self._inward = np.array([T.homogeneous for T in inward]).reshape(-1, 4, 4)
        self._touching = functools.cache(touching)
        self._tolerance = tolerance

    def lift(
        self, T: Array, faces: Index, slope: Slope, planes: Array, widths: Array, noise: Array
    ) -> Mask:
        """(n,) whether something lifts the object at poses (n, 4, 4) on these faces (n,).

        On what is higher in its middle by d an object leans by d over half its width. That may be
        as much as in `coplanar_support`.

        Args:
            slope: of the contact planes.
            planes: (n, 3) of what carries: m above the contact plane at the origin of the frame of
                each face, and by how much more along its axes.
            widths: (n,) m across what carries, where that is narrowest.
            noise: (n,) m, of heights.
        """
        support = self._environment.support_of(slope)
        low = 0.5 * MAX_LEAN_SLOPE * widths + planes[:, 0] + _RISE_NOISES * noise
        frames = T @ self._inward[faces]
        found = np.zeros(len(T), np.bool_)
        for face in np.unique(faces):
            on = np.flatnonzero(faces == face)
            points = self._touching(int(face))
            if len(points):
                found[on] = support.rising(points, frames[on], low[on], planes[on], self._tolerance)
        return found
