"""The margin from what was measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

import coal
import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, QhullError, cKDTree

from .insides import DEEP, in_bounds, inside
from .poses import Poses
from .shapes import corners_of
from .task import Array, Tolerances

if TYPE_CHECKING:
    from .world import World

_STRETCH = 0.04
"""m of way for which the boxes that can be met are looked up at once."""
_PLANES = 64
"""Of the hull of a thing that are looked at before it is held against a box."""


def too_near(
    world: World,
    poses: Poses,
    times: Array,
    approach_start: float,
    tolerances: Tolerances,
) -> list[str]:
    """What the arm moves and brings nearer than the margin to what was measured, per link.

    Of the object on its way down its support is left out.
    """
    if world.measured is None or world.support is None:
        return []
    down = int(np.searchsorted(times, approach_start - 1e-9))
    measured = _Measured(world.measured)
    worst: dict[str, tuple[float, float]] = {}
    for i in world.moving:
        link = world.links[i]
        nearer = _Nearer(world, measured, poses, i, tolerances)
        without = (down, world.support) if link == "object" else None
        for row, gap in nearer.all(without):
            if gap < worst.get(link, (np.inf, 0.0))[0]:
                worst[link] = gap, float(times[row])
    return [
        f"margin: {link} is {1000 * gap:.2f} mm from what was measured at {time:.3f} s"
        for link, (gap, time) in worst.items()
    ]


class _Measured:
    """Boxes (2, n, 3), and a tree of their middles."""

    def __init__(self, boxes: Array) -> None:
        self.low, self.high = boxes
        self.middle, self.half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        self.tree = cKDTree(self.middle)
        self.largest = float(np.linalg.norm(self.half, axis=1).max(initial=0.0))


class _Nearer:
    """Which states bring one geometry nearer than the margin to a box.

    A bound below the distance, or the distance, tells up to which state a box can be left out.
    """

    def __init__(
        self, world: World, measured: _Measured, poses: Poses, i: int, tolerances: Tolerances
    ) -> None:
        self._measured = measured
        self._poses = poses
        self._index = i
        self._thing = world.geometry.geometryObjects[i].geometry
        self._closed = [corners for corners, closed in world.pieces.get(i, []) if closed]
        self._margin = tolerances.margin - tolerances.penetration
        self._travel = poses.travel(i)
        self._middles, self._radius = poses.middles[:, i], poses.radii[i]
        self._corners = corners_of(self._thing)
        self._planes = _planes(self._corners)
        self._next = np.zeros(len(measured.middle), dtype=int)

    def all(self, without: tuple[int, npt.NDArray[np.bool_]] | None) -> list[tuple[int, float]]:
        """(row, gap) of states and boxes that are nearer.

        Args:
            without: from which row on which boxes do not count.
        """
        found, begin = [], 0
        while begin < len(self._travel):
            reached = self._travel[begin] + _STRETCH
            end = max(int(np.searchsorted(self._travel, reached, side="right")), begin + 1)
            found += self._within(begin, end, without)
            begin = end
        return found

    def _within(
        self, begin: int, end: int, without: tuple[int, npt.NDArray[np.bool_]] | None
    ) -> list[tuple[int, float]]:
        """Of states begin … end - 1."""
        reach = self._margin + self._travel[end - 1] - self._travel[begin]
        radius = self._radius + self._measured.largest + reach
        near = self._measured.tree.query_ball_point(self._middles[begin], radius)
        boxes = np.array(near, dtype=int)
        found = []
        row = begin
        while len(boxes):
            row = max(row, int(self._next[boxes].min()))
            if row >= end:
                break
            if without is not None and row >= without[0]:
                boxes = boxes[~without[1][boxes]]
            due = boxes[self._next[boxes] <= row]
            gaps = self._bounds(due, row)
            for k in np.flatnonzero(gaps <= self._margin).tolist():
                gaps[k] = self._gap(int(due[k]), row)
                if gaps[k] < self._margin:
                    found.append((row, float(gaps[k])))
            free = self._travel[row] + np.maximum(gaps - self._margin, 0.0)
            self._next[due] = np.maximum(np.searchsorted(self._travel, free, side="right"), row + 1)
            row += 1
        return found

    def _bounds(self, boxes: npt.NDArray[np.int64], row: int) -> Array:
        """(n,) no more than the distances of the boxes: along axes, and to planes of the hull."""
        T = self._poses.of(self._index)[row]
        points = self._corners @ T[:3, :3].T + T[:3, 3]
        low, high = self._measured.low[boxes], self._measured.high[boxes]
        apart = np.maximum(np.maximum(low - points.max(axis=0), points.min(axis=0) - high), 0.0)
        bounds = np.linalg.norm(apart, axis=1)
        close = np.flatnonzero(bounds <= self._margin)
        if not len(close):
            return np.asarray(bounds)
        normals = self._planes[:, :3] @ T[:3, :3].T
        offsets = self._planes[:, 3] - normals @ T[:3, 3]
        middle, half = self._measured.middle[boxes[close]], self._measured.half[boxes[close]]
        beyond = middle @ normals.T + offsets - half @ np.abs(normals).T
        bounds[close] = np.maximum(bounds[close], beyond.max(axis=1, initial=0.0))
        return np.asarray(bounds)

    def _gap(self, box: int, row: int) -> float:
        """The distance of a box; what is inside of a solid of triangles is deep."""
        middle = self._measured.middle[box]
        solid, where = coal.Box(2 * self._measured.half[box]), coal.Transform3s(np.eye(3), middle)
        at = self._poses.at(self._index, row)
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        gap = coal.distance(self._thing, at, solid, where, request, result)
        if self._closed:
            T = self._poses.of(self._index)[row]
            center = (middle - T[:3, 3]) @ T[:3, :3]
            if in_bounds(self._thing, center) and any(inside(c, center) for c in self._closed):
                return -DEEP
        return float(gap)


def _planes(points: Array) -> Array:
    """(n, 4) outward normals and offsets of the hull of (k, 3) points: some of them, or none."""
    try:
        planes = np.unique(ConvexHull(points).equations.round(9), axis=0)
    except QhullError:
        return np.empty((0, 4))
    return np.asarray(planes[:: 1 + len(planes) // _PLANES])
