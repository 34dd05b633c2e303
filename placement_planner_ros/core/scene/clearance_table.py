"""The table of d_S: from what was measured to a raster of distances.

What was measured is taken apart into *runs*: in columns of 2.5 mm, the points of neighbouring
heights together, from their lowest to their highest, at the mean of their x and y. A run counts for
what lies no higher than its end. Between the heights at which runs end lie *slices*, for which a
raster holds the distance at their lower and at their upper face: from above, what ends at each face
comes in, and the nearest run is handed on from pixel to pixel.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from placement_planner_ros.core import stopping
from placement_planner_ros.core.scene.cloud import AROUND_M, CONTACT_TOLERANCE_M
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.rasters import (
    MOST_HEIGHTS,
    MOST_PIXELS,
    Field,
    hand_on_nearest,
)
from placement_planner_ros.core.types import Array, Index, Slope, TargetVolume

CAP = 0.5
"""m, the greatest distance that counts: what an empty table has."""
VOXEL_M = 0.005
"""m of height that a point of a body stands for."""
COLUMN_M, RUN_M = 0.5 * VOXEL_M, 2.0 * VOXEL_M
"""m, side of the columns that points are gathered in, and heights whose points are of one run."""
END_STEP_M = 0.25 * VOXEL_M
"""m between heights at which runs may end."""
LIFT_M = CONTACT_TOLERANCE_M + 0.5 * VOXEL_M + END_STEP_M
"""m above a body's lowest point at which what of it is lower is judged: support may rise so far."""
SLICE_M = 4.0 * VOXEL_M
"""m of the thickest slice: within it, distances to what is overhead are linear."""


class Runs(NamedTuple):
    """What was measured, as n vertical lines."""

    at: Array
    """(n, 2) x and y, m."""
    bottom: Array
    """(n,) z of the lowest point, m."""
    end: Array
    """(n,) z of the highest point, m."""


class ClearanceTable(NamedTuple):
    """d_S on a raster, as kernels read it."""

    values: Field
    """(slices, nx, ny, 2) at the lower and the upper face of each slice, m."""
    faces: Array
    """(slices + 1,) z between the slices, m; above the last nothing counts."""
    origin: Array
    """(2,) of the first pixel, m."""
    pixel: float
    """m."""
    lift: float
    """m above a body's lowest point at which what is lower is judged."""


def new_table(
    obstacles: ObstacleSet, volume: TargetVolume, beyond: float, slope: Slope
) -> ClearanceTable:
    """The table of a `ClearanceField`, with its arguments."""
    grown = volume.boxes + np.array([[-beyond], [beyond]])
    runs = _vertical_runs(obstacles.points, grown, slope)
    low, high = volume.lower[:2] - AROUND_M, volume.upper[:2] + AROUND_M
    sides = high - low
    pixel = max(obstacles.cell_size, math.sqrt(float(sides.prod()) / MOST_PIXELS))
    # the raster holds all runs, so that they are handed on from where they are
    least, most = (
        np.array([of(along, initial=end) for along in runs.at.T])
        for of, end in ((np.min, np.inf), (np.max, -np.inf))
    )
    first, last = np.floor((least - low) / pixel), np.ceil((most - low) / pixel)
    kept = np.ceil(sides / pixel).astype(np.int64) + 1
    before = np.maximum(-np.nan_to_num(first, posinf=0.0), 0.0).astype(np.int64)
    after = np.maximum(np.nan_to_num(last, neginf=0.0) - kept + 1, 0.0).astype(np.int64)
    rises = np.array([volume.lower[:2], volume.upper[:2]]) * np.array(slope)
    faces, number = _slices_of_ends(runs.end, float(volume.lower[2] - rises.max(axis=0).sum()))
    shape = (int(before[0] + kept[0] + after[0]), int(before[1] + kept[1] + after[1]))
    at = (runs.at - low) / pixel + before
    rows = _telling_runs(at, runs.bottom, number, len(faces), shape)
    elements = np.zeros((len(rows), 4))
    elements[:, :2] = at[rows]
    stopping.step("handing distances on")
    values = np.full((len(faces) - 1, *kept, 2), np.float32(CAP))
    _fill_slices(elements, runs.bottom[rows], number[rows], faces, pixel, shape, before, values)
    for array in (values, faces, low):
        array.setflags(write=False)
    return ClearanceTable(values, faces, low, pixel, LIFT_M)


def _vertical_runs(points: Field, boxes: Array, slope: Slope) -> Runs:
    """Of those points (n, 3) that lie in one of the boxes (k, 2, 3) at least; heights are those
    above a plane of the slope."""
    low = np.floor(boxes[:, 0, :2].min(axis=0) / COLUMN_M)
    sides = np.floor(boxes[:, 1, :2].max(axis=0) / COLUMN_M) - low + 1.0
    return Runs(*_runs_of_columns(points, boxes, slope, low, (int(sides[0]), int(sides[1]))))


@njit(cache=True, nogil=True)
def _runs_of_columns(
    points: Field, boxes: Array, slope: Slope, first: Array, shape: tuple[int, int]
) -> tuple[Array, Array, Array]:
    """The fields of `Runs`.

    Args:
        first: (2,) the first of the columns in which the boxes lie, of that shape.
    """
    # how many points each column has
    column_of = np.full(len(points), -1, np.int32)
    start = np.zeros(shape[0] * shape[1] + 1, np.int32)
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        # only what lies in one of the boxes
        counts = False
        for b in range(len(boxes)):
            counts = counts or (
                boxes[b, 0, 0] <= x <= boxes[b, 1, 0]
                and boxes[b, 0, 1] <= y <= boxes[b, 1, 1]
                and boxes[b, 0, 2] <= z <= boxes[b, 1, 2]
            )
        if counts:
            i = math.floor(x / COLUMN_M) - int(first[0])
            j = math.floor(y / COLUMN_M) - int(first[1])
            # kept among the columns, whatever rounding does
            i, j = min(max(i, 0), shape[0] - 1), min(max(j, 0), shape[1] - 1)
            column_of[p] = i * shape[1] + j
            start[column_of[p] + 1] += 1
    # where each column begins
    for column in range(len(start) - 1):
        start[column + 1] += start[column]
    # each behind those of its column that are already there
    fill, held = start.copy(), np.empty((start[-1], 3), np.float32)
    for p in range(len(points)):
        if column_of[p] >= 0:
            x, y = float(points[p, 0]), float(points[p, 1])
            row = fill[column_of[p]]
            held[row, 0], held[row, 1] = x, y
            held[row, 2] = float(points[p, 2]) - slope[0] * x - slope[1] * y
            fill[column_of[p]] += 1
    # upwards, a run ends below a gap
    at, bottom, end = np.empty((len(held), 2)), np.empty(len(held)), np.empty(len(held))
    n = 0
    for column in range(len(start) - 1):
        own = held[start[column] : start[column + 1]]
        if len(own) == 0:
            continue
        # from cell to cell they are upwards already
        for k in range(1, len(own)):
            x, y, z = own[k, 0], own[k, 1], own[k, 2]
            m = k
            while m > 0 and own[m - 1, 2] > z:
                for a in range(3):
                    own[m, a] = own[m - 1, a]
                m -= 1
            own[m, 0], own[m, 1], own[m, 2] = x, y, z
        # of each run the mean of x and y, its lowest and its highest point
        begin = 0
        for k in range(1, len(own) + 1):
            if k < len(own) and own[k, 2] - own[k - 1, 2] <= RUN_M:
                continue
            x = y = 0.0
            for m in range(begin, k):
                x += own[m, 0]
                y += own[m, 1]
            at[n, 0], at[n, 1] = x / (k - begin), y / (k - begin)
            bottom[n], end[n] = own[begin, 2], own[k - 1, 2]
            begin = k
            n += 1
    return at[:n].copy(), bottom[:n].copy(), end[:n].copy()


def _slices_of_ends(end: Array, low: float) -> tuple[Array, Index]:
    """Faces of the slices, the lowest first, and the slice that each run ends at.

    Of more than `MOST_HEIGHTS`, those at which few runs end, near to others, are joined with these.
    From `low` on slices are no thicker than `SLICE_M`.
    """
    if len(end) == 0:
        return np.zeros(1), np.zeros(0, np.int64)
    step = np.floor(end / END_STEP_M).astype(np.int64)
    step -= step.min()
    of_run = ((np.bincount(step) > 0).cumsum() - 1)[step]
    weight = np.bincount(of_run).astype(np.float64)
    height = np.bincount(of_run, weights=end) / weight
    height, group = _joined_ends(height, weight, MOST_HEIGHTS)
    below = np.append(min(low, height[0]) - SLICE_M, height)
    parts = np.ceil(np.diff(below) / SLICE_M).astype(np.int64)
    between = [
        np.linspace(a, b, n, endpoint=False)
        for a, b, n in zip(below[:-1], below[1:], parts, strict=True)
    ]
    faces = np.concatenate([*between, height[-1:]])
    return faces, (parts.cumsum() - 1)[group[of_run]]


def _joined_ends(height: Array, weight: Array, most: int) -> tuple[Array, Index]:
    """So many heights at most, and (n,) which of them each of the heights (n,), ascending, is of.

    As by Ward: neighbours are joined at their mean that lose less than either would with another,
    those first that lose least.

    Args:
        weight: (n,) how many runs end at each.
    """
    group = np.arange(len(height))
    while len(height) > most:
        cost = weight[:-1] * weight[1:] / (weight[:-1] + weight[1:]) * np.diff(height) ** 2
        beside = np.pad(cost, 1, constant_values=np.inf)
        pairs = np.flatnonzero((cost < beside[:-2]) & (cost <= beside[2:]))
        # half of what are too many at a time, as joined ones may lose less again
        few = np.argsort(cost[pairs], kind="stable")[: (len(height) - most + 1) // 2]
        begins = np.ones(len(height), np.bool_)
        begins[pairs[few] + 1] = False
        of_height = begins.cumsum() - 1
        moment = np.bincount(of_height, weights=weight * height)
        weight = np.asarray(np.bincount(of_height, weights=weight), np.float64)
        height, group = moment / weight, of_height[group]
    return height, group


@njit(cache=True, nogil=True)
def _telling_runs(
    at: Array, bottom: Array, number: Index, slices: int, shape: tuple[int, int]
) -> Index:
    """(k,) rows of runs, those that end highest first: of those that end in one slice in one pixel
    the nearest to its middle, and that which reaches down furthest, if this is by a voxel.

    Args:
        at: (n, 2) x and y, pixels.
        bottom, number: (n,) where each begins, m, and the slice that it ends at.
        shape: of the raster, which holds all.
    """
    # by slice, the highest first
    start = np.zeros(slices + 1, np.int64)
    for k in number:
        start[slices - 1 - k] += 1
    start = start.cumsum()
    rows = np.empty(len(number), np.int64)
    for k in range(len(number) - 1, -1, -1):
        start[slices - 1 - number[k]] -= 1
        rows[start[slices - 1 - number[k]]] = k
    nearest, deepest = np.full(shape, np.int32(-1)), np.full(shape, np.int32(-1))
    kept, m = np.empty(len(number), np.int64), 0
    for s in range(slices):
        # the nearest of each pixel, and the deepest
        for turn in range(2):
            for n in range(start[s], start[s + 1]):
                k = rows[n]
                i, j = int(at[k, 0] + 0.5), int(at[k, 1] + 0.5)
                i, j = min(max(i, 0), shape[0] - 1), min(max(j, 0), shape[1] - 1)
                near, deep = nearest[i, j], deepest[i, j]
                if turn == 0:
                    away = (at[k, 0] - i) ** 2 + (at[k, 1] - j) ** 2
                    if near < 0 or away < (at[near, 0] - i) ** 2 + (at[near, 1] - j) ** 2:
                        nearest[i, j] = k
                    if deep < 0 or bottom[k] < bottom[deep]:
                        deepest[i, j] = k
                elif near >= 0:  # told once
                    kept[m] = near
                    m += 1
                    if bottom[deep] < bottom[near] - VOXEL_M:
                        kept[m] = deep
                        m += 1
                    nearest[i, j] = deepest[i, j] = -1
    return kept[:m].copy()


@njit(cache=True, nogil=True)
def _fill_slices(
    elements: Array,
    bottom: Array,
    number: Index,
    faces: Array,
    pixel: float,
    shape: tuple[int, int],
    first: Index,
    values: Field,
) -> None:
    """Lower `ClearanceTable.values`, which are at the cap.

    Args:
        elements: (n, 4) the runs as `hand_on_nearest` takes them, those that end highest first.
        bottom: (n,) of them, m.
        number: (n,) the slice that each ends at.
        shape: of the raster, which holds all runs.
        first: (2,) the first of its pixels whose values are kept.
    """
    near, who = np.full(shape, np.float32(CAP / pixel)), np.full(shape, np.int32(-1))
    slices, nx, ny = values.shape[:3]
    entering, ended = np.empty(len(number), np.int64), 0
    for s in range(slices - 1, -1, -1):
        # those that end in or above this slice, with how far they begin above its middle
        known, count, hangs = ended, 0, False
        while ended < len(number) and number[ended] >= s:
            ended += 1
        for k in range(ended):
            above = bottom[k] - 0.5 * (faces[s] + faces[s + 1])
            if above > 0.0:
                elements[k, 2] = (above / pixel) ** 2
                hangs = True
        # where some hang above it, what stands beside this slice comes in again: where a wall meets
        # a ceiling, that was nearer further up
        for k in range(0 if hangs else known, ended):
            # and what ends at its upper face comes in
            if k >= known or bottom[k] < faces[s + 1]:
                entering[count] = k
                count += 1
        hand_on_nearest(elements[:ended], entering[:count], near, who)
        low = faces[s]
        for i in range(nx):
            nearest, away = who[first[0] + i, first[1] :], near[first[0] + i, first[1] :]
            row = values[s, i]
            for j in range(ny):
                k = nearest[j]
                if k < 0:
                    continue
                if bottom[k] <= low:  # none of it is above
                    row[j, 0] = row[j, 1] = min(away[j] * pixel, row[j, 0])
                    continue
                # sideways from the pixel to its run
                dx = (elements[k, 0] - i - first[0]) * pixel
                dy = (elements[k, 1] - j - first[1]) * pixel
                for face in range(2):
                    # and up to where that begins, if it is above
                    up = max(bottom[k] - faces[s + face], 0.0)
                    distance = np.float32(math.sqrt(dx * dx + dy * dy + up * up))
                    row[j, face] = min(distance, row[j, face])
