"""Clouds of a snapshot without flying pixels, no denser than planning needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.scene.flying_pixels import flying_pixels
from placement_planner_ros.core.scene.thinning import thinned
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.run.snapshot import Snapshot


@dataclass(frozen=True, slots=True, eq=False)
class RealCloud:
    """What is left of one cloud.

    Attributes:
        cloud: all of it, as it is in the snapshot.
        origin: (3,) where its sensor was, None where that is not known.
        placed: whether it is known rather than measured.
        cell_size: metres, for which it was thinned.
        points: (n, 3) those left, metres.
        flying: how many flying pixels it had.
    """

    cloud: Array
    origin: Array | None
    placed: bool
    cell_size: float
    points: Array
    flying: int

    @classmethod
    def all_of(cls, snapshot: Snapshot, before: Sequence[RealCloud] = ()) -> tuple[RealCloud, ...]:
        """Those of a snapshot, in its order.

        Args:
            before: of an earlier one; clouds that are the same are not looked at again.
        """
        known = {id(each.cloud): each for each in before}
        size = snapshot.parameters.grid_settings.cell_size
        origins = snapshot.origins or (None,) * len(snapshot.clouds)
        placed = snapshot.placed or (False,) * len(snapshot.clouds)
        found = []
        for cloud, origin, is_placed in zip(snapshot.clouds, origins, placed, strict=True):
            old = known.get(id(cloud))
            if old is None or not old._is_of(origin, is_placed, size):
                old = cls._of(cloud, origin, is_placed, size)
            found.append(old)
        return tuple(found)

    @classmethod
    def _of(cls, cloud: Array, origin: Array | None, placed: bool, size: float) -> RealCloud:
        if placed:
            return cls(cloud, origin, placed, size, cloud, 0)
        flies = np.zeros(len(cloud), np.bool_) if origin is None else flying_pixels(cloud, origin)
        points = cloud[~flies] if flies.any() else cloud
        rows = thinned(points, size)
        return cls(cloud, origin, placed, size, points[rows], int(flies.sum()))

    def _is_of(self, origin: Array | None, placed: bool, size: float) -> bool:
        known, asked = (np.empty(0) if at is None else at for at in (self.origin, origin))
        return self.placed == placed and self.cell_size == size and np.array_equal(known, asked)
