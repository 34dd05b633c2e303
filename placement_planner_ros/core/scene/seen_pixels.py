"""A cloud as its sensor saw it: which points lie beside which.

Pixels are found again from directions: clouds need not be organised. Directions are laid on a disc
by Lambert's equal-area projection, where the spacing of pixels follows from how many points lie on
an area.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.types import Array

Index = npt.NDArray[np.int64]

SAMPLED = 1500
"""Points looked at for what is estimated of a cloud."""
_TILES = 257
_TILE = 4.0 / 256
"""Tiles of directions on the disc, of radius 2: how many along each axis, and their edge, 0.9°."""
_FEWEST_IN_TILE = 4.0
"""A sensor that sees fewer points than this in a tile is too coarse to tell."""


class Seen(NamedTuple):
    """Points as seen by their sensor, those of one bin of directions next to each other.

    Attributes:
        at: (n, 2) coordinates of their directions on the disc.
        range: (n,) metres.
        cosine: (n,) of the angle to the middle of the view.
        row: (n,) of the cloud.
        start: (nx * ny + 1,) first point of each bin, and n.
        low: (2,) lower corner of the bins.
        edge: of a bin.
        shape: nx, ny.
        pitch: rad between neighbouring pixels.
    """

    at: Array
    range: Array
    cosine: Array
    row: Index
    start: Index
    low: Array
    edge: float
    shape: tuple[int, int]
    pitch: float


def seen_from(points: Array, sensor: Array, window: float) -> Seen | None:
    """None where there is too little in view to tell neighbours.

    Args:
        points: (n, 3) metres; NaN where nothing was measured.
        sensor: (3,) where it was, metres.
        window: pixels around a point that are to be looked at: the edge of a bin.
    """
    some = points[:: max(1, len(points) // SAMPLED)] - sensor
    length = np.linalg.norm(some, axis=1)
    some = some[np.isfinite(length) & (length > 0.0)]
    if not len(some):
        return None
    middle = (some / np.linalg.norm(some, axis=1)[:, None]).mean(axis=0)
    length = np.linalg.norm(middle)
    if length < 1e-3:
        return None
    middle /= length
    right = np.cross(middle, np.eye(3)[np.argmin(np.abs(middle))])
    right /= np.linalg.norm(right)
    frame = np.array([right, np.cross(middle, right), middle])
    flat, tiles, corners = _project(points, sensor, frame)
    occupied = tiles[tiles > 0]
    if not len(occupied) or np.median(occupied) < _FEWEST_IN_TILE:
        return None
    pitch = _TILE / math.sqrt(float(np.median(occupied)))
    edge = window * pitch
    low = corners[0]
    sides = ((corners[1] - low) / edge).astype(np.int64) + 1
    at, ranges, cosine, row, start = _sort(flat, low, edge, int(sides[0]), int(sides[1]))
    return Seen(at, ranges, cosine, row, start, low, edge, (int(sides[0]), int(sides[1])), pitch)


@kernel(nogil=True)
def _project(points: Array, sensor: Array, frame: Array) -> tuple[Array, Index, Array]:
    """Each point on the disc: (x, y) √(2 / (1 + z)) of its direction (x, y, z) in the frame.

    Returns:
        (n, 4) the two coordinates, the range in metres, and z, the cosine to the middle; NaN where
        nothing was measured. (tiles²,) how many lie in each tile. (2, 2) the corners of all.
    """
    n = len(points)
    flat = np.full((n, 4), np.nan)
    low_a = low_b = 2.0
    high_a = high_b = -2.0
    tiles = np.zeros(_TILES * _TILES, np.int64)
    for p in range(n):
        x, y, z = points[p, 0] - sensor[0], points[p, 1] - sensor[1], points[p, 2] - sensor[2]
        r = math.sqrt(x * x + y * y + z * z)
        if not (r > 0.0 and r < np.inf):
            continue
        cosine = (frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z) / r
        if cosine < -0.9:  # close to where the whole rim of the disc is one direction
            continue
        scale = math.sqrt(2.0 / (1.0 + cosine)) / r
        a = (frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z) * scale
        b = (frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z) * scale
        flat[p, 0], flat[p, 1], flat[p, 2], flat[p, 3] = a, b, r, cosine
        low_a, high_a, low_b, high_b = min(low_a, a), max(high_a, a), min(low_b, b), max(high_b, b)
        tiles[int((a + 2.0) / _TILE) * _TILES + int((b + 2.0) / _TILE)] += 1
    return flat, tiles, np.array([[low_a, low_b], [high_a, high_b]])


@kernel(nogil=True)
def _sort(
    flat: Array, low: Array, edge: float, nx: int, ny: int
) -> tuple[Array, Array, Array, Index, Index]:
    """A counting sort: `at`, `range`, `cosine`, `row` and `start` of `Seen`."""
    n = len(flat)
    bin_of = np.full(n, -1, np.int64)
    start = np.zeros(nx * ny + 1, np.int64)
    for p in range(n):
        if flat[p, 2] > 0.0:
            i, j = int((flat[p, 0] - low[0]) / edge), int((flat[p, 1] - low[1]) / edge)
            bin_of[p] = i * ny + j
            start[bin_of[p] + 1] += 1
    for b in range(nx * ny):
        start[b + 1] += start[b]
    fill = start[:-1].copy()
    m = start[nx * ny]
    at, ranges, cosine = np.empty((m, 2)), np.empty(m), np.empty(m)
    row = np.empty(m, np.int64)
    for p in range(n):
        if bin_of[p] >= 0:
            to = fill[bin_of[p]]
            fill[bin_of[p]] += 1
            at[to, 0], at[to, 1], ranges[to], cosine[to] = (
                flat[p, 0],
                flat[p, 1],
                flat[p, 2],
                flat[p, 3],
            )
            row[to] = p
    return at, ranges, cosine, row, start


@kernel(lean=True)
def around(seen: Seen, p: int, pixels: float, near: Index) -> int:
    """Into `near` other points within so many pixels of point p; returns how many."""
    a, b = seen.at[p, 0], seen.at[p, 1]
    reach = pixels * seen.pitch
    count = 0
    ny = seen.shape[1]
    j0 = max(int((b - reach - seen.low[1]) / seen.edge), 0)
    j1 = min(int((b + reach - seen.low[1]) / seen.edge) + 1, ny)
    for i in range(
        max(int((a - reach - seen.low[0]) / seen.edge), 0),
        min(int((a + reach - seen.low[0]) / seen.edge) + 1, seen.shape[0]),
    ):
        # bins of one row lie one after the other
        for q in range(seen.start[i * ny + j0], seen.start[i * ny + j1]):
            u, v = seen.at[q, 0] - a, seen.at[q, 1] - b
            if u * u + v * v <= reach * reach and q != p and count < len(near):
                near[count] = q
                count += 1
    return count
