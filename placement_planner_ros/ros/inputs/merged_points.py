"""Points accumulated from many clouds, thinned to one per cube, at the cost of what comes anew."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.types import Array

Index = npt.NDArray[np.int64]

_BITS = 21
"""Of a cube's number for each axis: 2.6 km in each direction of cubes of 2.5 mm."""


@dataclass(frozen=True, slots=True, eq=False)
class MergedPoints:
    """Of each cube the first point that came, in the order in which they came.

    Attributes:
        points: (n, 3) metres.
        edge: of the cubes, metres.
        cubes: (n,) numbers of the cubes, ascending; None where some are too far away for one, all
            points then being looked at for each cloud.
    """

    points: Array
    edge: float
    cubes: Index | None

    @classmethod
    def of(cls, points: Array, edge: float) -> MergedPoints:
        """Points (n, 3), thinned."""
        kept = points[_one_per_cube(points, edge)]
        cubes = _numbers(kept, edge)
        return cls(kept, edge, None if cubes is None else np.sort(cubes))

    def with_points(self, points: Array, edge: float) -> MergedPoints:
        """The same and the points (n, 3) that lie in further cubes; itself where none does."""
        if edge != self.edge:
            return MergedPoints.of(self.points, edge).with_points(points, edge)
        cubes = _numbers(points, edge)
        if cubes is None or self.cubes is None:
            together = MergedPoints.of(np.vstack([self.points, points]), edge)
            return together if len(together.points) > len(self.points) else self
        coming, first = np.unique(cubes, return_index=True)
        places = np.searchsorted(self.cubes, coming)
        known = np.zeros(len(coming), np.bool_)
        inside = places < len(self.cubes)
        known[inside] = self.cubes[places[inside]] == coming[inside]
        if known.all():
            return self
        further = points[np.sort(first[~known])]
        numbers = np.insert(self.cubes, places[~known], coming[~known])
        return MergedPoints(np.vstack([self.points, further]), edge, numbers)

    def without(self, which: npt.NDArray[np.bool_]) -> MergedPoints:
        """The same without some of the points (n,)."""
        return MergedPoints.of(self.points[~which], self.edge) if which.any() else self


def _numbers(points: Array, edge: float) -> Index | None:
    """(n,) number of the cube that each of (n, 3) points is in; None where some have none."""
    limit = 1 << _BITS - 1
    cubes = np.floor(points / edge)
    if len(cubes) and not -limit <= cubes.min() <= cubes.max() < limit:
        return None
    whole = cubes.astype(np.int64) + limit
    return np.asarray((whole[:, 0] << 2 * _BITS) + (whole[:, 1] << _BITS) + whole[:, 2])


def _one_per_cube(points: Array, edge: float) -> Index:
    """Rows, ascending, of the first of (n, 3) points in each cube of that edge."""
    cubes = _numbers(points, edge)
    if cubes is None:
        _, first = np.unique(np.floor(points / edge), axis=0, return_index=True)
    else:
        _, first = np.unique(cubes, return_index=True)
    return np.sort(first)
