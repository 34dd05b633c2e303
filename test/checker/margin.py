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
_PAIRS = 20_000
"""Of states and boxes that are looked at at once."""
_PLANES = 64
"""Of the hull of a thing that are looked at before it is held against a box."""


def too_near(
    world: World, poses: Poses, times: Array, approach_start: float, tolerances: Tolerances
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

    Boxes are left out where a bound below their distance is enough; a distance tells up to which
    state a box can be left out.
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
        self._free = np.full(len(measured.middle), -np.inf)

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
        boxes = boxes[self._along_axes(boxes, begin, begin + 1)[0] <= reach]
        found = []
        some = max(1, _PAIRS // max(len(boxes), 1))
        for first in range(begin, end, some) if len(boxes) else ():
            last = min(first + some, end)
            close = self._along_axes(boxes, first, last) <= self._margin
            close &= self._travel[first:last, None] > self._free[boxes]
            if without is not None:
                close[max(without[0] - first, 0) :, without[1][boxes]] = False
            rows, columns = np.nonzero(close)
            pairs = np.column_stack([rows + first, boxes[columns]])
            for row, box in pairs[self._to_planes(pairs) <= self._margin].tolist():
                if self._travel[row] <= self._free[box]:
                    continue
                gap = self._gap(box, row)
                if gap < self._margin:
                    found.append((row, gap))
                else:
                    self._free[box] = self._travel[row] + gap - self._margin
        return found

    def _along_axes(self, boxes: npt.NDArray[np.int64], first: int, last: int) -> Array:
        """(k, n) no more than the distances of the boxes in states first … last - 1."""
        T = self._poses.of(self._index)[first:last]
        points = self._corners @ T[:, :3, :3].transpose(0, 2, 1) + T[:, None, :3, 3]
        low, high = points.min(axis=1)[:, None], points.max(axis=1)[:, None]
        apart = np.maximum(self._measured.low[boxes] - high, low - self._measured.high[boxes])
        np.maximum(apart, 0.0, out=apart)
        return np.sqrt(np.einsum("kni,kni->kn", apart, apart))

    def _to_planes(self, pairs: npt.NDArray[np.int64]) -> Array:
        """(n,) no more than the distances of pairs of state and box: to planes of the hull."""
        if not len(self._planes) or not len(pairs):
            return np.zeros(len(pairs))
        rows, starts = np.unique(pairs[:, 0], return_index=True)  # they come row by row
        T = self._poses.of(self._index)[rows]
        normals = self._planes[:, :3] @ T[:, :3, :3].transpose(0, 2, 1)
        offsets = self._planes[:, 3] - np.einsum("kpi,ki->kp", normals, T[:, :3, 3])
        bounds = []
        for k, boxes in enumerate(np.split(pairs[:, 1], starts[1:])):
            middle, half = self._measured.middle[boxes], self._measured.half[boxes]
            beyond = middle @ normals[k].T + offsets[k] - half @ np.abs(normals[k]).T
            bounds.append(beyond.max(axis=1))
        return np.concatenate(bounds)

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
