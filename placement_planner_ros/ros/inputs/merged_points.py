"""Points accumulated from many clouds, thinned to one per cube, at the cost of what comes anew."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.types import Array

Index = npt.NDArray[np.int64]

CUBE_BITS = 21
"""Of a cube's number for each axis: 2.6 km in each direction of cubes of 2.5 mm, beyond which
nothing accumulates."""


@dataclass(frozen=True, slots=True, eq=False)
class MergedPoints:
    """Of each cube the first point that came, in the order in which they came.

    Attributes:
        points: (n, 3) metres.
        edge: of the cubes, metres.
        cubes: (n,) numbers of the cubes, ascending.
    """

    points: Array
    edge: float
    cubes: Index

    @classmethod
    def of(cls, points: Array, edge: float) -> MergedPoints:
        """Points (n, 3), thinned."""
        return cls(np.empty((0, 3)), edge, np.empty(0, np.int64)).with_points(points, edge)

    def with_points(self, points: Array, edge: float) -> MergedPoints:
        """The same and the points (n, 3) that lie in further cubes; itself where none does."""
        if edge != self.edge:
            return MergedPoints.of(self.points, edge).with_points(points, edge)
        limit = 1 << CUBE_BITS - 1
        cells = np.floor(points / edge)
        near = (np.abs(cells) < limit).all(axis=1)
        x, y, z = cells[near].astype(np.int64).T + limit
        coming, first = np.unique((x << 2 * CUBE_BITS) + (y << CUBE_BITS) + z, return_index=True)
        new = ~np.isin(coming, self.cubes, assume_unique=True)
        if not new.any():
            return self
        places = np.searchsorted(self.cubes, coming[new])
        cubes = np.insert(self.cubes, places, coming[new])
        further = points[near][np.sort(first[new])]
        return MergedPoints(np.vstack([self.points, further]), edge, cubes)

    def without(self, which: npt.NDArray[np.bool_]) -> MergedPoints:
        """The same without some of the points (n,)."""
        return MergedPoints.of(self.points[~which], self.edge) if which.any() else self
