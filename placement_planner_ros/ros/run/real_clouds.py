"""Clouds of a snapshot without flying pixels, no denser than planning needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.scene.cloud import thinned
from placement_planner_ros.core.scene.flying_pixels import flying_pixels
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.cloud_store import PointSet
from placement_planner_ros.ros.run.snapshot import Snapshot


@dataclass(frozen=True, slots=True, eq=False)
class RealCloud:
    """What is left of one cloud.

    Attributes:
        part: all of it, as it is in the snapshot.
        cell_size: metres, for which it was thinned.
        points: (n, 3) those left, metres.
        flying: how many flying pixels it had.
    """

    part: PointSet
    cell_size: float
    points: Array
    flying: int

    @classmethod
    def all_of(cls, snapshot: Snapshot, before: Sequence[RealCloud] = ()) -> tuple[RealCloud, ...]:
        """Those of a snapshot, in its order.

        Args:
            before: of an earlier one; clouds that are the same are not looked at again.
        """
        size = snapshot.parameters.grid_settings.cell_size
        return tuple(
            next(
                (old for old in before if old.cell_size == size and old.part.same(part)),
                None,
            )
            or cls._of(part, size)
            for part in snapshot.parts
        )

    @classmethod
    def _of(cls, part: PointSet, size: float) -> RealCloud:
        if part.placed:
            return cls(part, size, part.points, 0)
        flies = np.zeros(len(part.points), np.bool_)
        if part.origin is not None:
            flies = flying_pixels(part.points, part.origin)
        points = part.points[~flies] if flies.any() else part.points
        return cls(part, size, points[thinned(points, size)], int(flies.sum()))
