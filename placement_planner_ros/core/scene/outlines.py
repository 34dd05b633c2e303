"""Convex outlines, seen from above, of points that do not fill the box around them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.runs import rows_of_runs
from placement_planner_ros.core.types import Array

_WAYS = 16
"""Corners that an outline has at most: the points that reach furthest in so many directions."""
_COS, _SIN = (np.array([way(2.0 * math.pi * d / _WAYS) for d in range(_WAYS)])
              for way in (math.cos, math.sin))  # fmt: skip
_CORNER = 0.1
"""Points that stay off a corner of their box by less than this share of a cell, in x + y, ..."""
_NOISE = 2.0
"""... or, in noise, by less than so many standard deviations, fill it, ..."""
_THIN = 0.25
"""... and so do those whose box is thinner than so much of that."""


class Outlines(NamedTuple):
    """Outlines of k boxes, n corners in all."""

    bounds: Array
    """(k, 4) least x and y of the points, greatest x and y."""
    start: npt.NDArray[np.int64]
    """(k + 1,) the first corner of each; none of what fills its box."""
    corners: Array
    """(n, 2) counter-clockwise."""

    @property
    def counts(self) -> npt.NDArray[np.int64]:
        """(k,) corners of each."""
        return np.diff(self.start)

    def of_rows(self, rows: npt.NDArray[np.int64]) -> Outlines:
        """Those of some of the boxes (m,)."""
        counts = self.counts[rows]
        start = np.append(0, counts.cumsum())
        corners = self.corners[rows_of_runs(self.start[rows], counts)]
        return Outlines(self.bounds[rows], start, corners)

    def followed_by(self, others: Outlines) -> Outlines:
        """These and the others."""
        return Outlines(
            np.concatenate([self.bounds, others.bounds]),
            np.append(self.start, self.start[-1] + others.start[1:]),
            np.concatenate([self.corners, others.corners]),
        )


def find_outlines(
    points: npt.NDArray[np.float32],
    first: npt.NDArray[np.int64],
    count: npt.NDArray[np.int64],
    cell_size: float,
    noise: float,
) -> Outlines:
    """Outlines of points[first : first + count] of each of k boxes, one point at least.

    Args:
        points: (n, 3).
        noise: standard deviation of the points, metres.
    """
    return Outlines(*_find_outlines(points, first, count, max(_CORNER * cell_size, _NOISE * noise)))


@kernel(nogil=True)
def _find_outlines(
    points: npt.NDArray[np.float32],
    first: npt.NDArray[np.int64],
    count: npt.NDArray[np.int64],
    corner: float,
) -> tuple[Array, npt.NDArray[np.int64], Array]:
    k = len(first)
    bounds, start = np.empty((k, 4)), np.zeros(k + 1, np.int64)
    room = 0
    for n in range(k):
        room += min(count[n], _WAYS)
    corners, reach = np.empty((room, 2)), np.empty(_WAYS, np.int64)
    for n in range(k):
        start[n + 1] = start[n]
        if _stays_off(points, first[n], count[n], bounds[n], corner):
            _reach(points, first[n], count[n], reach)
            start[n + 1] = _put_outline(points, reach, corners, start[n])
    return bounds, start, corners[: start[-1]].copy()


@kernel(lean=True)
def _stays_off(
    points: npt.NDArray[np.float32],
    first: int,
    count: int,
    bounds: Array,
    corner: float,
) -> bool:
    """Whether points[first : first + count] stay off a corner of the box around them by so much.

    Args:
        bounds: (4,) of that box, put here.
    """
    low_x, low_y = low_plus, low_minus = np.inf, np.inf
    high_x, high_y = high_plus, high_minus = -np.inf, -np.inf
    for p in range(first, first + count):
        x, y = np.float64(points[p, 0]), np.float64(points[p, 1])
        low_x, high_x = min(low_x, x), max(high_x, x)
        low_y, high_y = min(low_y, y), max(high_y, y)
        low_plus, high_plus = min(low_plus, x + y), max(high_plus, x + y)
        low_minus, high_minus = min(low_minus, x - y), max(high_minus, x - y)
    bounds[0], bounds[1], bounds[2], bounds[3] = low_x, low_y, high_x, high_y
    off = max(
        low_plus - low_x - low_y,
        high_x + high_y - high_plus,
        low_minus - low_x + high_y,
        high_x - low_y - high_minus,
    )
    return min(high_x - low_x, high_y - low_y) > _THIN * corner and off > corner


@kernel(lean=True)
def _put_outline(
    points: npt.NDArray[np.float32], reach: npt.NDArray[np.int64], corners: Array, at: int
) -> int:
    """Put each point that reaches furthest in some way once into `corners`, from `at` on.

    Returns:
        where the next outline begins.
    """
    last = reach[_WAYS - 1]
    for d in range(_WAYS):
        if reach[d] != last:
            last = reach[d]
            corners[at, 0], corners[at, 1] = points[last, 0], points[last, 1]
            at += 1
    return at


@kernel(lean=True)
def _reach(
    points: npt.NDArray[np.float32], first: int, count: int, reach: npt.NDArray[np.int64]
) -> None:
    """Of points[first : first + count], those that reach furthest in each direction, (_WAYS,)."""
    for d in range(_WAYS):
        furthest = -np.inf
        for p in range(first, first + count):
            along = _COS[d] * points[p, 0] + _SIN[d] * points[p, 1]
            if along > furthest:
                furthest = along
                reach[d] = p


@kernel(inline=True)
def aside(start: npt.NDArray[np.int64], corners: Array, r: int, x: float, y: float) -> float:
    """Squared distance in x and y from a point to the outline of box r, 0 within."""
    first, last = start[r], start[r + 1]
    least, outside = np.inf, False
    px, py = corners[last - 1, 0], corners[last - 1, 1]
    for c in range(first, last):
        qx, qy = corners[c, 0], corners[c, 1]
        ex, ey, dx, dy = qx - px, qy - py, x - px, y - py
        if ex * dy <= ey * dx:  # on its outer side
            outside = True
            along = min(max((ex * dx + ey * dy) / (ex * ex + ey * ey), 0.0), 1.0)
            dx -= along * ex
            dy -= along * ey
            least = min(least, dx * dx + dy * dy)
        px, py = qx, qy
    return least if outside else 0.0
