"""The face that an object at a pose stands on, and the slope under it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.types import LEVEL, Array, Index, upright


@dataclass(frozen=True, slots=True, eq=False)
class SupportingFace:
    """What (n,) objects stand on.

    Attributes:
        face: indices.
        slope: indices of `SupportingFaces.slopes`.
    """

    face: Index
    slope: Index


def padded_rows(rows: Sequence[Array]) -> Array:
    """(n, k, m) of n arrays of at most k rows each, (≤ k, m), whose last row stands for what is
    lacking."""
    most = max((len(each) for each in rows), default=0)
    each_of = [each[np.minimum(np.arange(most), len(each) - 1)] for each in rows]
    return np.array(each_of).reshape(len(rows), most, -1)


class SupportingFaces:
    """Tells it by which face points most nearly against the normal of some surface.

    Attributes:
        slopes: of the surfaces; the first is level.
        middles: (|F|, 3) of v(f), in the object's frame.
    """

    def __init__(self, context: ObjectiveContext) -> None:
        if not context.body.faces:
            raise ParameterError(
                "`terms`",
                "terms of the face that is down",
                "the object can stand on none: leave out high, edge, aligned and stance",
            )
        self.slopes = LEVEL, *(each.slope for each in context.environment.inclines)
        self.middles = np.array([face.vertices.mean(axis=0) for face in context.body.faces])
        self._up = upright(self.slopes)[:, :, 2]
        self._down = np.array([face.normal for face in context.body.faces]).T

    def at(self, T_world_object: Array) -> SupportingFace:
        """At poses (n, 4, 4)."""
        # Level surfaces only.
        if len(self.slopes) == 1:
            face = (T_world_object[:, 2, :3] @ self._down).argmin(axis=1)
            return SupportingFace(face, np.zeros(len(face), np.int64))
        # The pair of slope and face whose normals are most opposed.
        off = self._up @ (T_world_object[:, :3, :3] @ self._down)  # (n, slopes, faces)
        pairs = off.reshape(len(off), off.shape[1] * off.shape[2])
        slope, face = np.divmod(pairs.argmin(axis=1), off.shape[2])
        return SupportingFace(face, slope)
