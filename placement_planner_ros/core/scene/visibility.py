"""Unknown space: what no sensor has seen to be free, from the lines of sight of clouds.

Every measured point shows that the line from its sensor to it is free. A cell that no such line
crosses, and that holds no measured point, has not been seen. It is *unknown* if something measured
hides it from a sensor (the shadow of clutter, the inside of things, the space under a table), or if
it lies in V, where nothing is taken on trust. Elsewhere, outside every field of view, unseen space
is taken to be free: that is where the arm mostly starts and moves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.errors import CloudError
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import Array, TargetVolume, frozen_array

Flags = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]

OutsideRobot = Callable[[Array, float], Mask]
"""Which of (n, 3) points are further than a distance, metres, from the robot and what it holds."""

_UNSEEN, _OCCUPIED = 0, 2
"""States of a cell; 1 is seen free."""
_BINS = 128
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


def unknown_cells(
    obstacles: ObstacleSet,
    views: Sequence[View],
    volume: TargetVolume,
    outside_robot: OutsideRobot | None = None,
    *,
    below_measured: bool = False,
    free: Mask | None = None,
) -> npt.NDArray[np.int32]:
    """The cells that unknown space begins with: those with a face towards any other space.

    Nothing gets to the cells behind them, or nearer to those than to these.

    Args:
        obstacles: what was measured; its cells are not unknown.
        views: clouds whose sensors' positions are known. Without any, nothing is unknown.
        volume: V.
        outside_robot: cells not wholly outside the robot, where it is, are taken to be free.
        below_measured: cells above the highest that holds something measured are taken to be free.
        free: what `seen_free` says of the views, where that is known already.

    Returns:
        (k, 3) cells of the obstacle set's grid, in lexicographic order.
    """
    if not views:
        return np.zeros((0, 3), np.int32)
    free = seen_free(obstacles, views) if free is None else free.copy()
    state = free.view(np.uint8)
    state[tuple(obstacles.cells.T)] = _OCCUPIED
    unknown = _in_volume(obstacles, volume, state)
    for view in views:
        points = view.points if view.hides is None else view.points[view.hides]
        nearest = _nearest(points, view.origin)
        _add_hidden(nearest, view.origin, obstacles.origin, obstacles.cell_size, state, unknown)
    if below_measured:
        unknown[:, :, np.max(obstacles.cells[:, 2], initial=-1) + 1 :] = False
    if outside_robot is not None:
        _clear_robot(unknown, obstacles, outside_robot)
    return np.asarray(_surface(unknown))


def seen_free(obstacles: ObstacleSet, views: Sequence[View]) -> Mask:
    """(nx, ny, nz) the cells of the grid that a line of sight crosses on its way to its point."""
    free = np.zeros(obstacles.shape, np.bool_)
    for view in views:
        _carve(view.points, view.origin, obstacles.origin, obstacles.cell_size, free)
    return free


def share_seen(obstacles: ObstacleSet, free: Mask, volume: TargetVolume) -> float:
    """Of the cells that V reaches into, how many were seen free or hold something measured.

    Args:
        free: what `seen_free` says.
    """
    of_volume = np.zeros(obstacles.shape, np.bool_)
    for lower, upper in volume.joined:
        first = np.floor((lower - obstacles.origin) / obstacles.cell_size).astype(int).clip(min=0)
        last = np.ceil((upper - obstacles.origin) / obstacles.cell_size).astype(int).clip(min=0)
        of_volume[tuple(slice(a, b) for a, b in zip(first, last, strict=True))] = True
    known = int((of_volume & free).sum())
    held = tuple(obstacles.cells.T)
    known += int((of_volume[held] & ~free[held]).sum())
    return known / max(int(of_volume.sum()), 1)


def _in_volume(obstacles: ObstacleSet, volume: TargetVolume, state: Flags) -> Mask:
    """Unseen cells whose centres lie in V."""
    unknown = np.zeros(obstacles.shape, np.bool_)
    size = obstacles.cell_size
    for lower, upper in volume.joined:
        first = np.ceil((lower - obstacles.origin) / size - 0.5).astype(int).clip(min=0)
        last = np.floor((upper - obstacles.origin) / size - 0.5).astype(int).clip(min=-1)
        inside = tuple(slice(a, b + 1) for a, b in zip(first, last, strict=True))
        unknown[inside] = state[inside] == _UNSEEN
    return unknown


def _clear_robot(unknown: Mask, obstacles: ObstacleSet, outside_robot: OutsideRobot) -> None:
    """Unset cells that are not wholly outside the robot."""
    size = obstacles.cell_size
    blocks = np.indices([-(-n // _BLOCK) for n in obstacles.shape]).reshape(3, -1).T
    centers = obstacles.origin + (blocks + 0.5) * _BLOCK * size
    near = blocks[~outside_robot(centers, math.sqrt(0.75) * _BLOCK * size)]
    within = np.indices((_BLOCK,) * 3).reshape(3, -1).T
    cells = (near[:, None] * _BLOCK + within).reshape(-1, 3)
    cells = cells[(cells < obstacles.shape).all(axis=1)]
    cells = cells[unknown[tuple(cells.T)]]
    centers = obstacles.origin + (cells + 0.5) * size
    cells = cells[~outside_robot(centers, math.sqrt(0.75) * size)]
    unknown[tuple(cells.T)] = False


@kernel(nogil=True)
def _carve(points: Array, sensor: Array, origin: Array, size: float, free: Mask) -> None:
    """Mark the cells between the sensor and each point as free, the point's own cell left out.

    Cells are walked as by Amanatides and Woo. Of the lines that end in the same eighth of a cell,
    or leave the grid in the same eighth, one is walked: they cross nearly the same cells.
    """
    shape = free.shape
    strides = (shape[1] * shape[2], shape[2], 1)
    cells = free.reshape(-1)
    ends = np.zeros(cells.size, np.uint8)  # the eighths of each cell in which a line has ended
    exits = np.zeros(cells.size, np.uint8)  # ... and through which one has left the grid
    start = (sensor - origin) / size
    along = np.empty(3)
    step = np.empty(3, np.int64)
    left = np.empty(3, np.int64)
    crossing = np.empty(3)
    between = np.empty(3)
    for p in range(len(points)):
        first, final = _within_grid(points[p], sensor, size, start, shape, along)
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
        done = ends if final == 1.0 else exits
        if done[end] >> eighth & 1:
            continue
        done[end] |= 1 << eighth
        _walk(cells, cell, left, step, crossing, between)
        if final < 1.0:
            cells[end] = True


@kernel(lean=True)
def _within_grid(
    point: Array,
    sensor: Array,
    size: float,
    start: Array,
    shape: tuple[int, int, int],
    along: Array,
) -> tuple[float, float]:
    """From which to which share of its length the line from sensor to point is within the grid.

    The second is not above the first where it misses the grid or the point is not finite.

    Args:
        start: (3,) the sensor in cells from the grid's corner.
        along: (3,), filled: the whole line, in cells.
    """
    first, final = 0.0, 1.0
    for a in range(3):
        along[a] = (point[a] - sensor[a]) / size
        if along[a] != 0.0:
            low, high = -start[a] / along[a], (shape[a] - start[a]) / along[a]
            first, final = max(first, min(low, high)), min(final, max(low, high))
        elif start[a] < 0.0 or start[a] >= shape[a]:
            final = -1.0
    if not math.isfinite(along[0] + along[1] + along[2]):
        return 0.0, -1.0
    return first, final


@kernel(lean=True)
def _walk(
    cells: npt.NDArray[np.bool_],
    cell: int,
    left: npt.NDArray[np.int64],
    step: npt.NDArray[np.int64],
    crossing: Array,
    between: Array,
) -> None:
    """Set the cells of a line but the last: always across the face that comes first."""
    # plain numbers, which stay in registers
    t0, t1, t2 = crossing[0], crossing[1], crossing[2]
    left0, left1, left2 = left[0], left[1], left[2]
    for _ in range(left0 + left1 + left2):
        cells[cell] = True
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


@kernel(lean=True)
def _bin(x: float, y: float, z: float) -> int:
    """The bin of a direction, on the cube's side that it leaves through."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        side, u, v, w = (0 if x > 0.0 else 1), y, z, ax
    elif ay >= az:
        side, u, v, w = (2 if y > 0.0 else 3), x, z, ay
    else:
        side, u, v, w = (4 if z > 0.0 else 5), x, y, az
    row = min(int((u / w + 1.0) * 0.5 * _BINS), _BINS - 1)
    column = min(int((v / w + 1.0) * 0.5 * _BINS), _BINS - 1)
    return (side * _BINS + row) * _BINS + column


@kernel(nogil=True)
def _nearest(points: Array, sensor: Array) -> Array:
    """(6 · bins²,) square of the distance to the nearest point of each bin, inf without any."""
    nearest = np.full(6 * _BINS * _BINS, np.inf)
    for p in range(len(points)):
        x, y, z = points[p, 0] - sensor[0], points[p, 1] - sensor[1], points[p, 2] - sensor[2]
        square = x * x + y * y + z * z
        if math.isfinite(square) and square > 0.0:
            b = _bin(x, y, z)
            nearest[b] = min(nearest[b], square)
    return nearest


@kernel(nogil=True)
def _add_hidden(
    nearest: Array, sensor: Array, origin: Array, size: float, state: Flags, unknown: Mask
) -> None:
    """Set unseen cells whose centres lie behind something as seen by a sensor.

    Something: the nearest point in the bin of directions that the centre lies in.
    """
    nx, ny, nz = state.shape
    closest = np.inf
    for square in nearest:
        closest = min(closest, square)
    for i in range(nx):
        x = origin[0] + (i + 0.5) * size - sensor[0]
        for j in range(ny):
            y = origin[1] + (j + 0.5) * size - sensor[1]
            for k in range(nz):
                if state[i, j, k] != _UNSEEN or unknown[i, j, k]:
                    continue
                z = origin[2] + (k + 0.5) * size - sensor[2]
                square = x * x + y * y + z * z
                if square > closest and square > nearest[_bin(x, y, z)]:
                    unknown[i, j, k] = True


@kernel(lean=True)
def _at_surface(unknown: Mask, i: int, j: int, k: int) -> bool:
    """Whether one of the six cells beside a cell is not set."""
    nx, ny, nz = unknown.shape
    return (
        (k > 0 and not unknown[i, j, k - 1])
        or (k + 1 < nz and not unknown[i, j, k + 1])
        or (j > 0 and not unknown[i, j - 1, k])
        or (j + 1 < ny and not unknown[i, j + 1, k])
        or (i > 0 and not unknown[i - 1, j, k])
        or (i + 1 < nx and not unknown[i + 1, j, k])
    )


@kernel(nogil=True)
def _surface(unknown: Mask) -> npt.NDArray[np.int32]:
    """(k, 3) set cells with a face towards one that is not set."""
    nx, ny, nz = unknown.shape
    cells = np.empty((1 << 16, 3), np.int32)
    count = 0
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                if unknown[i, j, k] and _at_surface(unknown, i, j, k):
                    if count == len(cells):
                        cells = np.concatenate((cells, np.empty_like(cells)))
                    cells[count, 0], cells[count, 1], cells[count, 2] = i, j, k
                    count += 1
    return cells[:count].copy()
