"""Free space: what sensors have seen to be free, and unknown space, from lines of sight of clouds.

Every measured point shows that the line from its sensor to it is free. A cell that no such line
crosses, and that holds no measured point, has not been seen. It is *unknown* if something measured
hides it from a sensor (the shadow of clutter, the inside of things, the space under a table), or if
it lies in V, where nothing is taken on trust. Elsewhere, outside every field of view and further
from V than things count for clearance, unseen space is taken to be free: that is where the arm
mostly starts and moves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.errors import CloudError
from placement_planner_ros.core.scene.clearance_table import CAP
from placement_planner_ros.core.scene.cloud import STEP_M, thinned
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import (
    SINGLE_ROUNDING,
    Array,
    Index,
    Index32,
    Mask,
    TargetVolume,
    frozen_array,
)
from placement_planner_ros.core.uncounted import Uncounted

Flags = npt.NDArray[np.uint8]

OutsideRobot = Callable[[Array, float], Mask]
"""Which of (n, 3) points are further than a distance, metres, from the robot and what it holds."""

CEILING_M = 0.3
"""m above V in which a ceiling would matter: about what a hand takes above the object."""
UNSEEN, FREE, OCCUPIED = 0, 1, 2
"""States of a cell."""
BINS = 128
"""Directions from a sensor are told apart by a cube of bins around it, this many along an edge:
less than 1° each."""
_BLOCK = 8
"""Edge of the blocks of cells that are looked at one by one only where the robot is near."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What a sensor measured from one place, in the planning frame.

    Attributes:
        points: (n, 3) metres; NaN where nothing was measured.
        origin: (3,) where the sensor was, metres.
        hides: (n,) False for points that hide nothing, such as those on the robot, which will
            move out of the way. True for all unless given.

    Raises:
        CloudError: a wrong shape, or a position that is not finite.
    """

    points: Array
    origin: Array
    hides: Mask | None = None

    def __post_init__(self) -> None:
        points = np.ascontiguousarray(self.points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise CloudError("view.points", points.shape, "give points of shape (n, 3)")
        origin = np.array(self.origin, dtype=np.float64)
        if origin.shape != (3,) or not np.isfinite(origin).all():
            raise CloudError("view.origin", origin.tolist(), "give three finite numbers")
        if self.hides is not None and np.shape(self.hides) != (len(points),):
            raise CloudError("view.hides", np.shape(self.hides), "give one value per point")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "origin", frozen_array(origin))

    def towards(self, lower: Array, upper: Array, cell_size: float) -> View:
        """The same with only those points whose lines of sight, or what is behind their points on
        these, lead through a box of corners (3,); no denser there than `thinned` leaves them."""
        rows, ends = _points_towards(self.points, self.origin, lower, upper)
        rows = rows[thinned(ends, cell_size)]
        hides = None if self.hides is None else self.hides[rows]
        return View(self.points[rows], self.origin, hides)


@dataclass(frozen=True, eq=False)
class SeenSpace:
    """What sensors saw in and around V, in cells of the lattice that the obstacle set has.

    Attributes:
        measured: the obstacle set; its cells are not unknown.
        views: clouds whose sensors' positions are known.
        volume: V.
        origin: (3,) lower corner, metres.
        shape: number of cells along x, y, z.
        goes_on: (3, 2) whether there is space beyond the lower and the upper end of each axis.
    """

    measured: ObstacleSet
    views: tuple[View, ...]
    volume: TargetVolume
    origin: Array
    shape: tuple[int, int, int]
    goes_on: Mask

    @classmethod
    def around(
        cls,
        measured: ObstacleSet,
        views: Sequence[View],
        volume: TargetVolume,
        lower: Array,
        upper: Array,
    ) -> SeenSpace:
        """The space no further than things count for clearance from V.

        Args:
            lower, upper: (3,) corners of all space that anything gets to.
        """
        size = measured.cell_size
        low = np.maximum(volume.lower - CAP, lower)
        high = np.minimum(volume.upper + CAP, upper)
        first = np.floor((low - measured.origin) / size + SINGLE_ROUNDING)
        sides = np.floor((high - measured.origin) / size + SINGLE_ROUNDING) - first + 1.0
        shape = (int(sides[0]), int(sides[1]), int(sides[2]))
        goes_on = np.stack([low > lower, high < upper], axis=1)
        origin = frozen_array(measured.origin + first * size)
        return cls(measured, tuple(views), volume, origin, shape, goes_on)

    @cached_property
    def state(self) -> Flags:
        """(nx, ny, nz) `FREE` where a line of sight crosses a cell on its way to its point,
        `OCCUPIED` where something was measured, `UNSEEN` elsewhere."""
        free = np.zeros(self.shape, np.bool_)
        for view in self.views:
            _carve_rays(view.points, view.origin, self.origin, self.measured.cell_size, free)
        state = free.view(np.uint8)
        cells = self.measured.cells + self._shift
        state[tuple(cells[self._within(cells)].T)] = OCCUPIED
        return state

    @property
    def _shift(self) -> Index:
        """What takes cells of the obstacle set to those of here."""
        off = (self.measured.origin - self.origin) / self.measured.cell_size
        return np.asarray(off.round().astype(np.int64))

    def _within(self, cells: Index) -> Mask:
        return np.asarray(((cells >= 0) & (cells < self.shape)).all(axis=1))

    def unseen(self, points: Array) -> Mask:
        """(n,) which points (n, 3) lie where no sensor looked and something may be.

        In V and up to `CEILING_M` above it, all that is unseen; further away from V, cells whose
        middle something measured hides; nothing beyond these cells.
        """
        # cells that no sensor looked into
        cells = np.floor((points - self.origin) / self.measured.cell_size).astype(np.int64)
        rows = np.flatnonzero(self._within(cells))
        rows = rows[self.state[tuple(cells[rows].T)] == UNSEEN]
        lower, upper = self.volume.boxes[:, 0], self.volume.boxes[:, 1] + [0.0, 0.0, CEILING_M]
        at = points[rows, None]
        in_volume = np.any(np.all((at >= lower) & (at <= upper), axis=2), axis=1)
        result = np.zeros(len(points), np.bool_)
        result[rows] = in_volume | self._hidden[tuple(cells[rows].T)]
        return result

    @cached_property
    def _hidden(self) -> Mask:
        """(nx, ny, nz) unseen cells whose centres something measured hides from a sensor."""
        hidden, size = np.zeros(self.shape, np.bool_), self.measured.cell_size
        for view in self.views:
            points = view.points if view.hides is None else view.points[view.hides]
            points, sensor = (points - self.origin) / size, (view.origin - self.origin) / size
            _mark_hidden(points, sensor, self.state, hidden)
        return hidden

    @property
    def share_of_volume(self) -> float:
        """Of the cells that V reaches into, how many were seen free or hold something measured."""
        of_volume = np.zeros(self.shape, np.bool_)
        size = self.measured.cell_size
        for lower, upper in self.volume.boxes:
            first = np.floor((lower - self.origin) / size).astype(int).clip(min=0)
            last = np.ceil((upper - self.origin) / size).astype(int).clip(min=0)
            of_volume[tuple(slice(a, b) for a, b in zip(first, last, strict=True))] = True
        return float((self.state[of_volume] != UNSEEN).mean()) if of_volume.any() else 1.0

    def unknown(
        self, below_measured: bool = False, outside_robot: OutsideRobot | None = None
    ) -> Index32:
        """The cells that unknown space begins with: those with a face towards any other space.

        Nothing gets to the cells behind them, or nearer to those than to these.

        Args:
            below_measured: cells above the highest in which something was measured are free.
            outside_robot: cells not wholly outside the robot, where it is, are taken to be free.

        Returns:
            (k, 3) in lexicographic order.
        """
        unknown = self._in_volume() | self._hidden
        if below_measured:
            highest = np.max(self.measured.cells[:, 2], initial=-1) + self._shift[2]
            unknown[:, :, max(int(highest) + 1, 0) :] = False
        if outside_robot is not None:
            self._clear_robot(unknown, outside_robot)
        return _surface_cells(unknown, self.goes_on)

    def with_unknown(self, cells: Index32) -> ObstacleSet:
        """The obstacle set with these cells (k, 3) as obstacles on which nothing stands.

        Raises:
            CloudError: they make the grid too large.
        """
        if not len(cells):
            return self.measured
        size = self.measured.cell_size
        lower, upper = (self.origin + (end + 0.5) * size for end in (cells.min(0), cells.max(0)))
        larger = self.measured.reaching(lower, upper)
        shift = replace(self, measured=larger)._shift.astype(np.int32)
        # What stands on a surface keeps the margin and planning's reserve (4.2 mm by default) from
        # unknown space, which else begins anywhere within a cell below; and nothing that keeps
        # 2.5 mm or more from both fits between them.
        return larger.with_full_cells(cells - shift, STEP_M)

    def _in_volume(self) -> Mask:
        """(nx, ny, nz) unseen cells whose centres lie in V."""
        unknown = np.zeros(self.shape, np.bool_)
        size = self.measured.cell_size
        for lower, upper in self.volume.boxes:
            first = np.ceil((lower - self.origin) / size - 0.5).astype(int).clip(min=0)
            last = np.floor((upper - self.origin) / size - 0.5).astype(int).clip(min=-1)
            inside = tuple(slice(a, b + 1) for a, b in zip(first, last, strict=True))
            unknown[inside] = self.state[inside] == UNSEEN
        return unknown

    def _clear_robot(self, unknown: Mask, outside_robot: OutsideRobot) -> None:
        """Unset cells that are not wholly outside the robot."""
        size = self.measured.cell_size
        # blocks of cells near the robot, then those of their cells that are
        blocks = [-(-n // _BLOCK) for n in self.shape]
        centers = self.origin + (np.indices(blocks).reshape(3, -1).T + 0.5) * _BLOCK * size
        near = ~outside_robot(centers, math.sqrt(0.75) * _BLOCK * size).reshape(blocks)
        for axis, n in enumerate(self.shape):
            near = near.repeat(_BLOCK, axis).take(range(n), axis)
        cells = np.argwhere(unknown & near)
        centers = self.origin + (cells + 0.5) * size
        cells = cells[~outside_robot(centers, math.sqrt(0.75) * size)]
        unknown[tuple(cells.T)] = False


@njit(cache=True, nogil=True)
def _points_towards(
    points: Array, sensor: Array, lower: Array, upper: Array
) -> tuple[Index, Array]:
    """Rows of points (n, 3) that lie from the sensor in a direction in which the box lies, too;
    these points, or where their lines of sight leave the box before."""
    rows, ends = np.empty(len(points), np.int64), np.empty((len(points), 3))
    low, high, along = lower - sensor, upper - sensor, np.empty(3)
    count = 0
    for p in range(len(points)):
        for a in range(3):
            along[a] = points[p, a] - sensor[a]
        first, final = _within_box(along, low, high)
        # it ends at its point, or where it leaves the box before
        if first <= final:
            rows[count] = p
            share = min(final, 1.0)
            for a in range(3):
                ends[count, a] = sensor[a] + share * along[a]
            count += 1
    return rows[:count], ends[:count]


@njit(cache=True, nogil=True)
def _carve_rays(points: Array, sensor: Array, origin: Array, size: float, free: Mask) -> None:
    """Mark the cells between the sensor and each point as free, the point's own cell left out.

    Cells are walked as by Amanatides and Woo. Of the lines that end in the same eighth of a cell,
    or leave the grid in the same eighth, one is walked: they cross nearly the same cells.
    """
    shape = free.shape
    strides = (shape[1] * shape[2], shape[2], 1)
    cells = free.reshape(-1)
    ends = np.zeros(cells.size, np.uint8)  # the eighths of each cell in which a line has ended
    exits = np.zeros(cells.size, np.uint8)  # ... and through which one has left the grid
    # where the sensor is, in cells
    start = (sensor - origin) / size
    low, high, along = -start, np.array(shape) - start, np.empty(3)
    step = np.empty(3, np.int64)
    left = np.empty(3, np.int64)
    crossing = np.empty(3)
    between = np.empty(3)
    for p in range(len(points)):
        for a in range(3):
            along[a] = (points[p, a] - sensor[a]) / size
        first, final = _within_box(along, low, high)
        final = min(final, 1.0)
        if first >= final:
            continue
        # per axis the cells to cross, where on the line the first face between two comes and how
        # far apart they are
        cell = end = eighth = 0
        for a in range(3):
            entry = min(max(start[a] + first * along[a], 0.0), float(shape[a]))
            last = min(max(start[a] + final * along[a], 0.0), float(shape[a]))
            from_layer, to_layer = min(int(entry), shape[a] - 1), min(int(last), shape[a] - 1)
            cell += from_layer * strides[a]
            end += to_layer * strides[a]
            eighth += (last - to_layer >= 0.5) << a
            left[a] = abs(to_layer - from_layer)
            crossing[a] = between[a] = np.inf
            if left[a] > 0:
                upwards = to_layer > from_layer
                step[a] = strides[a] if upwards else -strides[a]
                crossing[a] = (from_layer + upwards - start[a]) / along[a]
                between[a] = 1.0 / abs(along[a])
        # one of those that end, or leave, alike is enough
        done = ends if final == 1.0 else exits
        if done[end] >> eighth & 1:
            continue
        done[end] |= 1 << eighth
        # the last cell is free, too, where the line leaves the grid there
        _walk_cells(cells, cell, left, step, crossing, between)
        if final < 1.0:
            cells[end] = True


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _within_box(along: Array, low: Array, high: Array) -> tuple[float, float]:
    """From which to which multiple of its length a line is within a box, no further back than it
    begins; the second is below the first where it misses the box, or is not finite.

    Args:
        along: (3,) the whole line.
        low, high: (3,) corners of the box, from where the line begins.
    """
    first, final = 0.0, np.inf
    for a in range(3):
        if along[a] > 0.0:
            first, final = max(first, low[a] / along[a]), min(final, high[a] / along[a])
        elif along[a] < 0.0:
            first, final = max(first, high[a] / along[a]), min(final, low[a] / along[a])
        elif not low[a] <= 0.0 <= high[a]:
            final = -1.0
    if not math.isfinite(along[0] + along[1] + along[2]):
        final = -1.0
    return first, final


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _walk_cells(
    cells: Mask, cell: int, left: Index, step: Index, crossing: Array, between: Array
) -> None:
    """Set the cells of a line but the last: always across the face that comes first."""
    # plain numbers, which stay in registers
    t0, t1, t2 = crossing[0], crossing[1], crossing[2]
    left0, left1, left2 = left[0], left[1], left[2]
    for _ in range(left0 + left1 + left2):
        cells[cell] = True
        # across the face that comes first
        if t0 <= t1 and t0 <= t2:
            cell += step[0]
            left0 -= 1
            t0 = t0 + between[0] if left0 > 0 else np.inf
        elif t1 <= t2:
            cell += step[1]
            left1 -= 1
            t1 = t1 + between[1] if left1 > 0 else np.inf
        else:
            cell += step[2]
            left2 -= 1
            t2 = t2 + between[2] if left2 > 0 else np.inf


@njit(cache=True, nogil=True)
def _mark_hidden(points: Array, sensor: Array, state: Flags, hidden: Mask) -> None:
    """Mark the unseen cells that are hidden from a sensor: their centres lie behind the nearest of
    points (n, 3) in the bin of directions that they lie in. All in cells."""
    # of each bin the square of the distance to its nearest point, inf without any
    nearest = np.full(6 * BINS * BINS, np.inf)
    for p in range(len(points)):
        x, y, z = points[p, 0] - sensor[0], points[p, 1] - sensor[1], points[p, 2] - sensor[2]
        square = x * x + y * y + z * z
        # NaN was not measured, and a point at the sensor has no direction
        if 0.0 < square < np.inf:
            at = _direction_bin(x, y, z)
            nearest[at] = min(nearest[at], square)
    for i in range(state.shape[0]):
        for j in range(state.shape[1]):
            for k in range(state.shape[2]):
                if state[i, j, k] == UNSEEN:
                    x, y, z = i + 0.5 - sensor[0], j + 0.5 - sensor[1], k + 0.5 - sensor[2]
                    square = x * x + y * y + z * z
                    # a cell that the sensor is in the middle of has no direction, either
                    if square > 0.0 and square > nearest[_direction_bin(x, y, z)]:
                        hidden[i, j, k] = True


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _direction_bin(x: float, y: float, z: float) -> int:
    """The bin of a direction, on the cube's side that it leaves through."""
    # the side, the way along it and up to it
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        side, u, v, w = (0 if x > 0.0 else 1), y, z, ax
    elif ay >= az:
        side, u, v, w = (2 if y > 0.0 else 3), x, z, ay
    else:
        side, u, v, w = (4 if z > 0.0 else 5), x, y, az
    # where on that side
    row = min(int((u / w + 1.0) * 0.5 * BINS), BINS - 1)
    column = min(int((v / w + 1.0) * 0.5 * BINS), BINS - 1)
    return (side * BINS + row) * BINS + column


def _surface_cells(unknown: Mask, goes_on: Mask) -> Index32:
    """(k, 3) set cells with a face towards one that is not set, or towards space further away."""
    enclosed = unknown.copy()
    for axis in range(3):
        along, inner = np.moveaxis(unknown, axis, 0), np.moveaxis(enclosed, axis, 0)
        # enclosed is what is set on both sides along every axis
        inner[1:] &= along[:-1]
        inner[:-1] &= along[1:]
        # and at an end of the grid where no space goes on
        for end in range(2):
            inner[-end] &= not goes_on[axis, end]
    # several times as quick as argwhere of three axes
    rows = np.flatnonzero(unknown & ~enclosed)
    return np.column_stack(np.unravel_index(rows, unknown.shape)).astype(np.int32)
