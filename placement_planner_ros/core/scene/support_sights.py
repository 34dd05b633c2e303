"""Gaps that lines of sight prove: what was seen below a surface was seen through a hole in it.

A ray that crosses the height of a surface and ends well below it proves that there is nothing where
it crosses. Around that place the disc up to the nearest point of the surface is a gap: none of the
surface was measured there, and its middle is known to be free. Rays that end on a surface, and
pixels that saw nothing, prove nothing, so that holes in what a camera saw are none in the surface.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.support_columns import Columns, surface_at
from placement_planner_ros.core.scene.support_points import on_surface
from placement_planner_ros.core.scene.support_spacing import (
    COSINES,
    SINES,
    SPIRAL,
    TURNS,
    near_column,
)
from placement_planner_ros.core.scene.visibility import View
from placement_planner_ros.core.types import LEVEL, Array, Slope

_BELOW = 0.005
"""m below a surface that a point must lie at least to have been seen through it, ..."""
_NOISES = 6.0
"""... and so many times the noise."""
_NARROWEST = 0.001
"""m, radius of the smallest discs that are told: of one of many pixels on a dense surface it is
less than half of the spacing."""
_WITHIN = 0.7
"""Of a disc's radius, within which some of it must be surrounded; else it lies beyond an end."""
_LEVELS = 60
"""Heights of surfaces that are told apart at most."""
_BLOCK = 8
"""Columns along each edge of the blocks in which rays are held against no column one by one."""
_PARTS = 4
"""Along each edge of a column; of the discs whose middles lie in one part the widest is kept."""


def seen_through(
    columns: Columns,
    asked: npt.NDArray[np.bool_],
    sights: Sequence[View],
    slope: Slope,
    noise: float,
) -> Array:
    """(k, 4) x, y, radius and height of discs that lines of sight prove to be gaps.

    Args:
        columns: without gaps yet.
        asked: (s,) the surfaces whose gaps count.
        sights: what sensors at known places measured, not sheared.
        slope: by which all heights in `columns` are sheared.
        noise: of the points, metres.
    """
    if not sights or not asked.any():
        return np.zeros((0, 4))
    heights = columns.height[asked]
    lowest = float(heights.min()) - columns.step
    apart = max(columns.step, (float(heights.max()) - lowest) / (_LEVELS - 2))
    below = max(_BELOW, _NOISES * noise)
    level = np.full(len(asked), -1)
    level[asked] = (heights - lowest) / apart
    at_levels, used = _at_levels(columns, level), np.unique(level[asked])
    middles, blocks = lowest + (used + 0.5) * apart, _in_blocks(at_levels)
    found = [
        _crossings(columns, at_levels, blocks, used, middles, below, *_sheared(view, slope))
        for view in sights
    ]
    discs = np.vstack(found)
    discs = _widest(discs, columns.cell_size / _PARTS, columns.step)
    return discs[_within(columns, discs)]


def _widest(discs: Array, part: float, step: float) -> Array:
    """Of discs (k, 4), in each square of that side and each step of heights, the widest."""
    sizes = np.array([part, part, step])
    x, y, height = np.floor(discs[:, [0, 1, 3]] / sizes).astype(np.int64).T
    key = np.zeros(len(discs), np.int64)  # one number, for it is sorted in 0.6 of the time
    for value in (height, y, x):
        low = value.min(initial=0)
        key = key * (value.max(initial=0) - low + 1) + value - low
    order = np.lexsort((-discs[:, 2], key))
    first = np.ones(len(order), np.bool_)
    first[1:] = np.diff(key[order]) != 0
    return np.ascontiguousarray(discs[order[first]])


def _sheared(view: View, slope: Slope) -> tuple[Array, Array]:
    """Its points (n, 3), and where it was; lines of sight stay straight."""
    points, origin = view.points.copy(), view.origin.copy()  # always: kernels know one type then
    if slope != LEVEL:
        points[:, 2] -= points[:, :2] @ np.array(slope)
        origin[2] -= origin[:2] @ np.array(slope)
    return points, origin


@kernel(nogil=True)
def _at_levels(columns: Columns, level: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """(nx, ny) a bit for each level at which a surface lies in a column or beside it.

    Args:
        level: (s,) of each surface; -1 for none.
    """
    at_levels = np.zeros((columns.nx, columns.ny), np.int64)
    for i in range(columns.nx):
        for j in range(columns.ny):
            column = i * columns.ny + j
            bits = 0
            for s in range(columns.start[column], columns.start[column + 1]):
                if level[s] >= 0:
                    bits |= 1 << level[s]
            if bits == 0:
                continue
            for u in range(max(i - 1, 0), min(i + 2, columns.nx)):
                for v in range(max(j - 1, 0), min(j + 2, columns.ny)):
                    at_levels[u, v] |= bits
    return at_levels


@kernel(nogil=True)
def _in_blocks(at_levels: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """The same of all columns in a block, or in those around it."""
    nx, ny = at_levels.shape
    blocks = np.zeros((nx // _BLOCK + 1, ny // _BLOCK + 1), np.int64)
    for i in range(nx):
        for j in range(ny):
            if at_levels[i, j] == 0:
                continue
            a, b = i // _BLOCK, j // _BLOCK
            for u in range(max(a - 1, 0), min(a + 2, blocks.shape[0])):
                for v in range(max(b - 1, 0), min(b + 2, blocks.shape[1])):
                    blocks[u, v] |= at_levels[i, j]
    return blocks


@kernel(nogil=True)
def _crossings(
    columns: Columns,
    at_levels: npt.NDArray[np.int64],
    blocks: npt.NDArray[np.int64],
    levels: npt.NDArray[np.int64],
    middles: Array,
    below: float,
    points: Array,
    sensor: Array,
) -> Array:
    """(k, 4) discs without points around the places at which rays cross surfaces.

    Args:
        at_levels, blocks: `_at_levels`, `_in_blocks`.
        levels, middles: (l,) those with surfaces, and the middles of their heights, metres.
    """
    found = np.empty((1024, 4))
    count = 0
    per_metre = 1.0 / columns.cell_size
    for p in range(len(points)):
        fall = sensor[2] - points[p, 2]
        if not fall > below:  # nor where nothing was measured
            continue
        dx, dy = (points[p, 0] - sensor[0]) / fall, (points[p, 1] - sensor[1]) / fall
        lowest = max(points[p, 2] + below, middles[0])
        highest = min(middles[-1], sensor[2])
        if lowest > highest:
            continue
        near = 0  # the levels of all surfaces in the blocks that the ray passes, and those around
        wide = (highest - lowest) * max(abs(dx), abs(dy)) / (_BLOCK * columns.cell_size)
        steps = int(wide) + 1
        for k in range(steps + 1):
            z = lowest + (highest - lowest) * k / steps
            x, y = sensor[0] + (sensor[2] - z) * dx, sensor[1] + (sensor[2] - z) * dy
            i = int((x - columns.origin[0]) * per_metre) // _BLOCK
            j = int((y - columns.origin[1]) * per_metre) // _BLOCK
            near |= blocks[min(max(i, 0), blocks.shape[0] - 1), min(max(j, 0), blocks.shape[1] - 1)]
        last = -1
        for k in range(len(levels)):
            z = middles[k]
            if near >> levels[k] & 1 == 0 or not lowest <= z < sensor[2]:
                continue
            x, y = sensor[0] + (sensor[2] - z) * dx, sensor[1] + (sensor[2] - z) * dy
            i = math.floor((x - columns.origin[0]) * per_metre)
            j = math.floor((y - columns.origin[1]) * per_metre)
            if not (0 <= i < columns.nx and 0 <= j < columns.ny):
                continue
            if at_levels[i, j] >> levels[k] & 1 == 0:
                continue
            s = _surface_near(columns, i, j, z, columns.step)
            if s < 0 or s == last:  # levels are as near to each other as surfaces are sought
                continue
            last = s
            z = columns.height[s]
            if points[p, 2] + below >= z:
                continue
            x, y = sensor[0] + (sensor[2] - z) * dx, sensor[1] + (sensor[2] - z) * dy
            radius = _room(columns, s, x, y)
            if radius < _NARROWEST:
                continue
            if count == len(found):
                found = np.concatenate((found, np.empty_like(found)))
            found[count, 0], found[count, 1], found[count, 2], found[count, 3] = x, y, radius, z
            count += 1
    return found[:count].copy()


@kernel(lean=True)
def _surface_near(columns: Columns, ci: int, cj: int, z: float, tolerance: float) -> int:
    """A surface at height z in column ci, cj or one beside it, or -1."""
    for turn in range(9):
        i, j = ci + SPIRAL[turn, 0], cj + SPIRAL[turn, 1]
        if 0 <= i < columns.nx and 0 <= j < columns.ny:
            s = surface_at(columns.start, columns.height, i * columns.ny + j, z, tolerance)
            if s >= 0:
                return s
    return -1


@kernel(lean=True)
def _room(columns: Columns, s: int, x: float, y: float) -> float:
    """How far a place is from all points of surface s, at most a cell, metres.

    Less than `_NARROWEST` stands for any such.
    """
    ci = math.floor((x - columns.origin[0]) / columns.cell_size)
    cj = math.floor((y - columns.origin[1]) / columns.cell_size)
    square = columns.cell_size * columns.cell_size
    for turn in range(9):
        i, j = ci + SPIRAL[turn, 0], cj + SPIRAL[turn, 1]
        if not near_column(columns, i, j, x, y, math.sqrt(square)):
            continue
        column = i * columns.ny + j
        step = 2.0 * columns.step
        t = surface_at(columns.start, columns.height, column, columns.height[s], step)
        if t < 0:
            continue
        for m in range(columns.first[t], columns.first[t + 1]):
            dx, dy = columns.points[m, 0] - x, columns.points[m, 1] - y
            square = min(square, dx * dx + dy * dy)
        if square < _NARROWEST * _NARROWEST:
            break
    return math.sqrt(square)


@kernel(nogil=True)
def _within(columns: Columns, discs: Array) -> npt.NDArray[np.bool_]:
    """(k,) whether some of each disc is surrounded by points of the surface."""
    result = np.zeros(len(discs), np.bool_)
    for n in range(len(discs)):
        x, y, z, far = discs[n, 0], discs[n, 1], discs[n, 3], _WITHIN * discs[n, 2]
        result[n] = on_surface(columns, x, y, z, columns.step) >= 0
        for k in range(0, TURNS, TURNS // 4):
            if not result[n]:
                there = x + far * COSINES[k], y + far * SINES[k]
                result[n] = on_surface(columns, there[0], there[1], z, columns.step) >= 0
    return result
