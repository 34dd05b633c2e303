"""The values of a clearance field on its grid of lines and levels."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.nearest_boxes import (
    BoxesByHeight,
    Envelope,
    Lines,
    nearest_on_line,
)
from placement_planner_ros.core.types import Array

Field = npt.NDArray[np.float32]
Index = npt.NDArray[np.int32]

AROUND = 2
"""Levels from the middle of a voxel to its upper face."""


def clearance_levels(
    boxes: BoxesByHeight, lines: Lines, shape: tuple[int, int, int], rise: float
) -> Field:
    """(nx, ny, nz) mean of the capped distance over `AROUND` slabs below and above each level.

    A slab is what lies between two levels. What ends in one counts below it with its whole height,
    and within it by its share; of all that ends in one slab, the nearest box in x and y.

    Works line by line, so that besides the values it takes little room.
    """
    values = np.empty(shape, np.float32)
    _fill(boxes, lines, rise, Envelope.for_boxes(boxes), values)
    return values


@kernel(nogil=True)
def _fill(boxes: BoxesByHeight, lines: Lines, rise: float, room: Envelope, values: Field) -> None:
    nx, ny, nz = values.shape
    slabs = np.unique(boxes.slab)
    next_box = boxes.column_start[:-1].copy()
    nearest = np.empty((len(slabs), nx), np.int32)
    squared = np.empty((len(slabs), nx), np.float32)
    other, squared_other = np.empty(nx, np.int32), np.empty(nx, np.float32)
    heights = (np.arange(nz) * rise).astype(np.float32)
    under, means = np.empty(nz + 1, np.float32), np.empty(nz, np.float32)
    front, born = np.empty((len(slabs), 2)), np.empty(len(slabs), np.int32)
    for j in range(ny):
        s = -1
        for group in range(len(boxes.slab)):
            if group == 0 or boxes.slab[group] > boxes.slab[group - 1]:
                s += 1
                nearest_on_line(boxes, group, j, lines, next_box, room, nearest[s], squared[s])
            else:
                nearest_on_line(boxes, group, j, lines, next_box, room, other, squared_other)
                _take_nearer(nearest[s], squared[s], other, squared_other)
        for i in range(nx):
            found, aside = nearest[:, i], squared[:, i]
            _distances_above(boxes, slabs, found, aside, heights, lines.cap, front, born, under)
            _means_of_slabs(boxes, slabs, found, aside, heights, rise, under, means)
            _means_around_levels(means, values[i, j])


@kernel(lean=True)
def _take_nearer(nearest: Index, squared: Field, other: Index, squared_other: Field) -> None:
    """Of two boxes at each point of a line, the nearer one."""
    for i in range(len(nearest)):
        if squared_other[i] < squared[i]:
            nearest[i], squared[i] = other[i], squared_other[i]


@kernel(lean=True)
def _distances_above(
    boxes: BoxesByHeight,
    slabs: Index,
    nearest: Index,
    squared: Field,
    heights: Field,
    cap: float,
    front: Array,
    born: Index,
    under: Field,
) -> None:
    """(nz + 1,) capped distance from each level up a vertical line to what ends above its slab.

    From above, each slab adds one box: at z, (squared distance aside) + max(lower face - z, 0)².
    Of two such, the one that lies lower gains on the other on the way down. So a box that lies no
    lower than another and is no nearer is not so further down either, and each is put down for
    the levels from where it comes in to where it is beaten.

    Args:
        slabs: (s,) those in which anything ends.
        nearest, squared: (s,) the box of each slab, and its squared distance aside.
        heights: (nz,) of the levels.
        front, born: room for (s, 2) squared distances aside and heights of the boxes that may be
            the nearest, and the level from which on they may be.
    """
    under[:] = np.float32(cap * cap)
    count = 0
    for s in range(len(nearest) - 1, -1, -1):
        r, level = nearest[s], slabs[s] - 1
        if squared[s] >= cap * cap or level < 0:
            continue
        z = heights[level]
        aside, height = np.float64(squared[s]), boxes.height[r]
        own = _squared(aside, height, z)
        beaten = False
        for t in range(count - 1, -1, -1):
            if front[t, 1] <= height and _squared(front[t, 0], front[t, 1], z) <= own:
                beaten = True
                break
        if beaten:
            continue
        kept = 0
        for t in range(count):
            if front[t, 1] >= height and _squared(front[t, 0], front[t, 1], z) >= own:
                _put_down(front[t, 0], front[t, 1], heights, level + 1, born[t], under)
            else:
                front[kept, 0], front[kept, 1], born[kept] = front[t, 0], front[t, 1], born[t]
                kept += 1
        front[kept, 0], front[kept, 1], born[kept] = aside, height, level
        count = kept + 1
    for t in range(count):
        _put_down(front[t, 0], front[t, 1], heights, 0, born[t], under)
    for level in range(len(under)):
        under[level] = np.sqrt(under[level])


@kernel(lean=True)
def _squared(aside: float, height: float, z: float) -> float:
    up = max(height - z, 0.0)
    return aside + up * up


@kernel(lean=True)
def _put_down(
    aside: float, height: float, heights: Field, first: int, last: int, under: Field
) -> None:
    """Lower the squared distances of the levels from first to last to those of one box."""
    a, h = np.float32(aside), np.float32(height)
    for level in range(first, last + 1):
        up = max(h - heights[level], np.float32(0.0))
        candidate = a + up * up
        under[level] = candidate if candidate < under[level] else under[level]


@kernel(lean=True)
def _means_of_slabs(
    boxes: BoxesByHeight,
    slabs: Index,
    nearest: Index,
    squared: Field,
    heights: Field,
    rise: float,
    under: Field,
    means: Field,
) -> None:
    """(nz,) mean over each slab: of both its levels, and of what ends in it by its share.

    Args:
        under: (nz + 1,) `_distances_above`.
    """
    for level in range(len(means)):
        means[level] = np.float32(0.5) * (under[level] + under[level + 1])
    for s in range(len(nearest)):  # what ends in a slab counts for the whole of the one below
        r, level = nearest[s], slabs[s]
        if squared[s] < np.inf and level > 0:
            whole = math.sqrt(_squared(squared[s], boxes.height[r], heights[level]))
            means[level - 1] = min(means[level - 1], np.float32(0.5 * (under[level - 1] + whole)))
    for s in range(len(nearest)):
        r, level = nearest[s], slabs[s]
        if squared[s] < np.inf:
            end = boxes.end[r]
            share = min(end / rise, 1.0)
            middle = heights[level] + 0.5 * end
            distance = math.sqrt(_squared(squared[s], boxes.height[r], middle))
            if distance < means[level]:
                means[level] = share * distance + (1.0 - share) * means[level]


@kernel(lean=True)
def _means_around_levels(means: Field, values: Field) -> None:
    """(nz,) of each level, the mean of the `AROUND` slabs below and above it."""
    last = len(means) - 1
    for level in range(len(means)):
        total = np.float32(0.0)
        if AROUND <= level <= last - AROUND:
            for n in range(-AROUND, AROUND):
                total += means[level + n]
        else:
            for n in range(-AROUND, AROUND):
                total += means[min(max(level + n, 0), last)]
        values[level] = total / np.float32(2 * AROUND)
