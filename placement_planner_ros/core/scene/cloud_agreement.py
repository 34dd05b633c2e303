"""Agreement of two clouds: do they show the same surfaces at the same height?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy import ndimage

from placement_planner_ros.core import stopping
from placement_planner_ros.core.scene.cloud import STEP_M
from placement_planner_ros.core.types import Array, Index, Mask

COLUMN_M = 0.02
"""m, edge of the columns in which heights are compared; points of a level surface in one of them
reach up and down by no more, with noise and slope."""
_SURFACE_POINTS = 9
"""Points of a surface in a column, at least; and of these, whose errors are independent, at most:
neighbouring pixels err alike."""
_CALIBRATION_M = 0.12
"""m between two surfaces that may be one; boards of a shelf are farther apart."""
_TOGETHER_S = 0.5
"""s between two clouds between which nothing has moved."""


@dataclass(frozen=True, slots=True, eq=False)
class Disagreement:
    """Where two clouds differ in height.

    Attributes:
        first, second: the names of the clouds.
        height: by how much the second is above the first, metres; the median over the patches.
        points: (k, 3) of both, where nothing is to be put down: all of them where most of what both
            see differs so, as what one of them alone sees is off then, too.
    """

    first: str
    second: str
    height: float
    points: Array

    def __str__(self) -> str:
        way = "above" if self.height > 0.0 else "below"
        return f"{self.second} is {abs(self.height):.4f} m {way} {self.first}"


@dataclass(frozen=True, slots=True, eq=False)
class _Surfaces:
    """Level surfaces of one cloud, column by column, ascending.

    Attributes:
        columns: (s, 2) numbers along x and y.
        height, error: (s,) mean height and its standard error, metres.
        rows: the cloud's points, sorted; surface k has those from first[k] to last[k].
    """

    columns: Index
    height: Array
    error: Array
    rows: Index
    first: Index
    last: Index

    @classmethod
    def of(cls, points: Array) -> _Surfaces:
        stopping.step("finding the heights that each cloud shows")
        columns = np.floor(points[:, :2] / COLUMN_M).astype(np.int64)
        rows = np.argsort(_in_one_number([columns], [points[:, 2]])[0])
        columns, z = columns[rows], points[rows, 2]
        # a surface ends with its column, or where a gap is above it
        ends = (np.diff(columns, axis=0) != 0).any(axis=1) | (np.diff(z) > STEP_M)
        first = np.append(0, np.flatnonzero(ends) + 1)
        last = np.append(first[1:], len(z))
        count = (last - first).astype(np.float64)
        level = (count >= _SURFACE_POINTS) & (z[last - 1] - z[first] <= COLUMN_M)
        height = np.add.reduceat(z, first) / count
        square = np.add.reduceat((z - np.repeat(height, last - first)) ** 2, first)
        error = np.sqrt(square / np.maximum(count - 1.0, 1.0) / np.minimum(count, _SURFACE_POINTS))
        return cls(
            columns[first[level]], height[level], error[level], rows, first[level], last[level]
        )

    def points(self, which: Index) -> Index:
        """The rows of the cloud's points on some of them."""
        parts = [self.rows[self.first[k] : self.last[k]] for k in which.tolist()]
        return np.concatenate(parts) if parts else self.rows[:0]


def disagreements(
    clouds: Sequence[Array], names: Sequence[str], times: Sequence[float], tolerance: float
) -> list[Disagreement]:
    """Pairs of clouds whose surfaces differ in height over a patch, in one direction.

    By more than the tolerance and three times the mean's error; nothing is put down where it is
    more than `STEP_M`, too: what is falls no deeper. Where something has moved between two clouds,
    only part of what both see differs.

    Args:
        clouds: (n, 3) metres each, without the robot, of a space of some metres.
        times: when they were taken, s.
        tolerance: metres that what stands may be off by.
    """
    surfaces = [_Surfaces.of(points) if len(points) else None for points in clouds]
    found = []
    for i, j in combinations(range(len(clouds)), 2):
        first, second = surfaces[i], surfaces[j]
        if first is None or second is None:
            continue
        stopping.step(f"comparing the clouds on {names[i]} and {names[j]}")
        a, b = _matched_surfaces(first, second)
        if not len(a):
            continue
        higher = second.height[b] - first.height[a]
        doubt = 3.0 * np.hypot(first.error[a], second.error[b])
        together = abs(times[i] - times[j]) <= _TOGETHER_S
        differing = np.abs(higher) > tolerance + doubt
        deep = np.abs(higher) > max(tolerance, STEP_M) + doubt
        for way in (1.0, -1.0):
            differs = differing & (way * higher > 0.0)
            apart = differs & _in_patches(first.columns[a], differs)
            if not apart.any() or not (together or differing.mean() > 0.5):
                continue
            where = [clouds[i], clouds[j]]
            if deep.mean() <= 0.5:  # else also what one of them alone sees is off
                rows = a[apart & deep], b[apart & deep]
                where = [clouds[i][first.points(rows[0])], clouds[j][second.points(rows[1])]]
            height = float(np.median(higher[apart]))
            found.append(Disagreement(names[i], names[j], height, np.vstack(where)))
    return found


def _matched_surfaces(first: _Surfaces, second: _Surfaces) -> tuple[Index, Index]:
    """Rows of surfaces in the same column that are each other's nearest and no further apart."""
    both = first, second
    keys = _in_one_number([s.columns for s in both], [s.height for s in both])
    there, back = _nearest_heights(keys[0], keys[1]), _nearest_heights(keys[1], keys[0])
    if not len(keys[0]) or not len(keys[1]):
        return there[:0], there[:0]
    rows = np.flatnonzero(back[there] == np.arange(len(keys[0])))
    rows = rows[np.abs(keys[0][rows] - keys[1][there[rows]]) <= _CALIBRATION_M]
    return rows, there[rows]


def _in_one_number(columns: Sequence[Index], heights: Sequence[Array]) -> list[Array]:
    """Of columns (n, 2) and heights (n,) in them one number each: columns are farther apart in it
    than any two heights."""
    low = np.min([each.min(axis=0, initial=0) for each in columns], axis=0)
    wide = 1 + max(int(each[:, 1].max(initial=0)) for each in columns) - low[1]
    apart = 1.0 + 2.0 * max(float(np.abs(each).max(initial=0.0)) for each in heights)
    return [
        ((each[:, 0] - low[0]) * wide + each[:, 1] - low[1]) * apart + height
        for each, height in zip(columns, heights, strict=True)
    ]


def _nearest_heights(of: Array, among: Array) -> Index:
    """For each of some numbers the row of the nearest among others, ascending."""
    after = np.clip(np.searchsorted(among, of), 1, max(len(among) - 1, 1))
    if len(among) < 2:
        return np.zeros(len(of), np.int64)
    return after - (of - among[after - 1] <= among[np.minimum(after, len(among) - 1)] - of)


def _in_patches(columns: Index, which: Mask) -> Mask:
    """(n,) those of some columns (n, 2) that are of a square of three by three, 6 cm wide."""
    at = columns - columns.min(axis=0)
    grid = np.zeros(at.max(axis=0) + 1, np.bool_)
    grid[tuple(at[which].T)] = True
    patches: Mask = ndimage.binary_opening(grid, np.ones((3, 3)))
    return np.asarray(which & patches[tuple(at.T)])
