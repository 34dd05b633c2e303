"""The values of a clearance field on its grid of lines and levels."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.boxes_by_height import BoxesByHeight
from placement_planner_ros.core.scene.nearest_boxes import (
    Envelope,
    Lines,
    nearest_on_line,
)
from placement_planner_ros.core.types import Array

Field = npt.NDArray[np.float32]
Index = npt.NDArray[np.int32]

AROUND = 2
"""Levels from the middle of a voxel to its upper face."""


def fill_levels(
    boxes: BoxesByHeight,
    lines: Lines,
    rise: float,
    part: tuple[int, int, int, int],
    values: Field,
) -> None:
    """Put into values (nx, ny, nz) those of a part of the lines.

    They are the mean of the capped distance over `AROUND` slabs below and above each level.

    A slab is what lies between two levels. What ends in one counts below it with its whole height,
    and within it by its share; of all that ends in one slab, the nearest box in x and y.

    Works line by line, so that besides the values it takes little room.

    Args:
        part: first line along x, first along y, and the lines behind the last.
    """
    slabs = np.unique(boxes.slab)
    _fill(boxes, slabs, lines, rise, Envelope.for_boxes(boxes), part, values)


@kernel(nogil=True)
def _fill(
    boxes: BoxesByHeight,
    slabs: Index,
    lines: Lines,
    rise: float,
    room: Envelope,
    part: tuple[int, int, int, int],
    values: Field,
) -> None:
    """`fill_levels`; slabs (s,) are those in which anything ends, lowest first."""
    begin, nx, nz = part[0], part[2] - part[0], values.shape[2]
    next_box = boxes.column_start[:-1].copy()
    along, aside_along = np.empty((2, nx), np.int32), np.empty((2, nx), np.float32)
    nearest = np.empty((nx, len(slabs)), np.int32)
    aside = np.empty((nx, len(slabs)), np.float32)
    heights = (np.arange(nz) * rise).astype(np.float32)
    under, means = np.empty(nz + 1, np.float32), np.empty(nz, np.float32)
    front, born = np.empty((len(slabs), 2)), np.empty(len(slabs), np.int32)
    counting = np.empty(len(slabs), np.int32)
    for j in range(part[1], part[3]):
        s = -1
        for group in range(len(boxes.slab)):
            nearest_on_line(boxes, group, j, lines, next_box, room, begin, along[0], aside_along[0])
            if group > 0 and boxes.slab[group] == boxes.slab[group - 1]:
                _take_nearer(along, aside_along)
            else:
                s += 1
            if group + 1 == len(boxes.slab) or boxes.slab[group + 1] > boxes.slab[group]:
                nearest[:, s], aside[:, s] = along[0], aside_along[0]
            else:
                along[1], aside_along[1] = along[0], aside_along[0]
        for i in range(nx):
            count = _distances_above(
                boxes.height,
                slabs,
                nearest[i],
                aside[i],
                heights,
                lines.cap,
                front,
                born,
                counting,
                under,
            )
            _means_of_slabs(
                boxes.height,
                boxes.end,
                slabs,
                nearest[i],
                aside[i],
                heights,
                rise,
                counting[:count],
                under,
                means,
            )
            _means_around_levels(means, values[begin + i, j])


@kernel(lean=True)
def _take_nearer(nearest: Index, squared: Field) -> None:
    """Of two boxes (2, nx) at each point of a line, the nearer one, into the first row."""
    for i in range(nearest.shape[1]):
        if squared[1, i] < squared[0, i]:
            nearest[0, i], squared[0, i] = nearest[1, i], squared[1, i]


@kernel(lean=True)
def _distances_above(
    height: Array,
    slabs: Index,
    nearest: Index,
    squared: Field,
    heights: Field,
    cap: float,
    front: Array,
    born: Index,
    counting: Index,
    under: Field,
) -> int:
    """(nz + 1,) capped distance from each level up a vertical line to what ends above its slab.

    From above, each slab adds one box: at z, (squared distance aside) + max(lower face - z, 0)².
    Of two such, the one that lies lower gains on the other on the way down. So a box that lies no
    lower than another and is no nearer is not so further down either, and each is put down for
    the levels from where it comes in to where it is beaten.

    Args:
        height: (k,) z of the boxes' lower faces.
        slabs: (s,) those in which anything ends.
        nearest, squared: (s,) the box of each slab, and its squared distance aside.
        heights: (nz,) of the levels.
        front, born: room for (s, 2) squared distances aside and heights of the boxes that may be
            the nearest, and the level from which on they may be.
        counting: (s,) of the slabs, those whose box is not beaten at once by one of the others.

    Returns:
        how many these are.
    """
    under[:] = np.float32(cap * cap)
    count = counted = 0
    for s in range(len(nearest) - 1, -1, -1):
        aside = np.float64(squared[s])
        if aside >= cap * cap:
            continue
        level, bottom = slabs[s] - 1, height[nearest[s]]
        z = heights[level + 2]
        own = aside + max(bottom - z, 0.0) ** 2
        beaten = False
        for t in range(count - 1, -1, -1):
            if front[t, 1] <= bottom and front[t, 0] + max(front[t, 1] - z, 0.0) ** 2 <= own:
                beaten = True
                break
        if beaten:
            continue
        counting[counted] = s
        counted += 1
        kept = 0
        for t in range(count):
            if front[t, 1] >= bottom and front[t, 0] + max(front[t, 1] - z, 0.0) ** 2 >= own:
                _put_down(front[t, 0], front[t, 1], heights, level + 1, born[t], under)
            else:
                front[kept, 0], front[kept, 1], born[kept] = front[t, 0], front[t, 1], born[t]
                kept += 1
        front[kept, 0], front[kept, 1], born[kept] = aside, bottom, level
        count = kept + 1
    for t in range(count):
        _put_down(front[t, 0], front[t, 1], heights, 0, born[t], under)
    for level in range(len(under)):
        under[level] = np.sqrt(under[level])
    return counted


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
    height: Array,
    end: Array,
    slabs: Index,
    nearest: Index,
    squared: Field,
    heights: Field,
    rise: float,
    counting: Index,
    under: Field,
    means: Field,
) -> None:
    """(nz,) mean over each slab: of both its levels, and of what ends in it by its share.

    Args:
        counting, under: see `_distances_above`.
        end: (k,) how far above the lower level of their slab the boxes end.
    """
    for level in range(len(means)):
        means[level] = np.float32(0.5) * (under[level] + under[level + 1])
    for s in counting:  # what ends in a slab counts for the whole of the one below
        level = slabs[s]
        if level > 0:
            up = max(height[nearest[s]] - heights[level], 0.0)
            whole = np.float32(math.sqrt(squared[s] + up * up))
            if whole < under[level]:
                means[level - 1] = np.float32(0.5) * (under[level - 1] + whole)
    for s in counting:
        level, top = slabs[s], end[nearest[s]]
        up = max(height[nearest[s]] - heights[level] - 0.5 * top, 0.0)
        distance = math.sqrt(squared[s] + up * up)
        if distance < means[level]:
            share = min(top / rise, 1.0)
            means[level] = np.float32(share * distance + (1.0 - share) * means[level])


@kernel(lean=True)
def _means_around_levels(means: Field, values: Field) -> None:
    """(nz,) of each level, the mean of the `AROUND` slabs below and above it."""
    last = len(means) - 1
    for level in range(AROUND):
        values[level] = _mean_around(means, level, last)
    for level in range(AROUND, last - AROUND + 1):
        total = np.float32(0.0)
        for n in range(-AROUND, AROUND):
            total += means[level + n]
        values[level] = total / np.float32(2 * AROUND)
    for level in range(last - AROUND + 1, last + 1):
        values[level] = _mean_around(means, level, last)


@kernel(lean=True)
def _mean_around(means: Field, level: int, last: int) -> np.float32:
    total = np.float32(0.0)
    for n in range(-AROUND, AROUND):
        total += means[min(max(level + n, 0), last)]
    return np.float32(total / np.float32(2 * AROUND))
