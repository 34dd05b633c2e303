"""Rasters: distances to points and discs, and how wide gaps between points are by chance.

Lengths are in pixels, positions of points too: the centre of pixel (i, j) is at (i, j). The nearest
element is handed on from pixel to pixel, with the exact distance to it. A *weighted* element counts
as nearer by its weight, so that those with the radii of discs as weights give the signed distance
to the union of the discs.

Granulometry: of the area that points lie in, some is closed by discs of a radius: no wider disc
without points covers it. On a surface this share grows with the radius until all chance holes are
closed, and then stays: on a lattice from 0.7 of its spacing on, on points drawn at random from some
1.2. On wires, rods and perforated plates it stays, too, once the gaps along the material are
closed, until the radius reaches that of the holes. So the radius is taken at which it first stays,
and `WIDEST` times that: what is wider is a gap.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.ndimage import uniform_filter

from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted

Field = npt.NDArray[np.float32]
Index = npt.NDArray[np.int32]
Mask = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.int64]

NEAR_CONTAINED = 0.05
"""Pixels by which a disc may reach beyond a neighbour's and still be left out beside it."""
TILE_M = 0.03
"""m, side of the tiles whose spacing is judged, each with the eight around it, and of the squares
over which heights of noisy points are averaged."""
GROWTH = 1.25
"""By this factor the radius grows from one look to the next that the closed area is compared at."""
WIDEST = 1.6
"""Times the radius at which the area stays, that the widest disc by chance has."""
STAYS = 1.2
"""Times that the closed area may grow in between, to have stayed."""
AREA_PER_POINT = 0.15
"""Times the radius' square that the closed area of each point is, at least: else they are apart."""
FEWEST_POINTS = 12
"""Points in a tile that show their spacing."""


class Raster:
    """A grid of pixels around points, which are in metres until `at` has them in pixels.

    Args:
        points: (n, 2) m.
        pixel: side of a pixel, metres.
        rim: m around the points.
    """

    def __init__(self, points: Array, pixel: float, rim: float) -> None:
        self.pixel = pixel
        self.origin = points.min(axis=0) - rim
        shape = np.ceil((points.max(axis=0) + rim - self.origin) / pixel).astype(int) + 1
        self.shape = (int(shape[0]), int(shape[1]))

    def at(self, points: Array) -> Array:
        """(n, 2) in pixels, of those points (k, 2) that are on the raster."""
        at = (points - self.origin) / self.pixel
        return at[points_within(at, np.full(2, -0.5), np.array(self.shape) - 0.5)]

    def cells(self, at: Array) -> Rows:
        """(n,) pixels of points, in one row."""
        i, j = (at + 0.5).astype(np.int64).T
        return np.asarray(i * self.shape[1] + j)

    def middles(self, at: Array) -> Array:
        """(m, 2) the mean of the points (n, 2) in each pixel that has any."""
        cell = self.cells(at)
        many = np.bincount(cell)
        held = np.flatnonzero(many)
        sums = [np.bincount(cell, weights=at[:, axis])[held] for axis in range(2)]
        return np.column_stack(sums) / many[held, None]

    def sums(self, cell: Rows, values: Array, side: float) -> Array:
        """(nx, ny) sums over the square of that side, metres, around each pixel, of values (n,)."""
        width = 2 * int(0.5 * side / self.pixel) + 1
        image = np.bincount(cell, weights=values, minlength=self.shape[0] * self.shape[1])
        around = uniform_filter(image.reshape(self.shape), width, mode="constant")
        return np.asarray(width**2 * around)

    def distance(self, at: Array, weight: Array | None = None) -> Field:
        """(nx, ny) pixels to the nearest of points (n, 2), less their weights (n,)."""
        return self.nearest(at, weight)[0]

    def nearest(self, at: Array, weight: Array | None = None) -> tuple[Field, Index]:
        """`distance`, and (nx, ny) which point that is, or -1."""
        near = np.full(self.shape, np.float32(sum(self.shape)))
        who = np.full(self.shape, np.int32(-1))
        elements = np.zeros((len(at), 4))
        elements[:, :2] = at
        if weight is not None:
            elements[:, 3] = weight
        hand_on_nearest(elements, np.arange(len(at)), near, who)
        return near, who


def points_within(points: npt.NDArray[np.floating], low: Array, high: Array) -> Mask:
    """(n,) which points (n, 2) lie between two corners, the upper one left out."""
    x, y = points[:, 0], points[:, 1]
    return np.asarray((x >= low[0]) & (x < high[0]) & (y >= low[1]) & (y < high[1]))


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _take_nearer(elements: Array, k: int, i: int, j: int, near: Field, who: Index) -> None:
    """Take element k, if there is one, for the nearest of pixel (i, j) where it is."""
    if k >= 0 and k != who[i, j]:
        dx, dy = elements[k, 0] - i, elements[k, 1] - j
        reach = near[i, j] + elements[k, 3]
        square = dx * dx + dy * dy + elements[k, 2]
        if reach > 0.0 and square < reach * reach:
            near[i, j], who[i, j] = math.sqrt(square) - elements[k, 3], k


@njit(cache=True, nogil=True)
def hand_on_nearest(elements: Array, entering: Rows, near: Field, who: Index) -> None:
    """Find the nearest element to each pixel, from those that are known and others that enter.

    Two sweeps over the raster hand the nearest on from pixel to pixel; seldom, and by less than a
    tenth of a pixel, an element that is not quite the nearest is told.

    Args:
        elements: (n, 4) x and y, each within half a pixel of a pixel of the raster; the square of
            its height above the raster; its weight.
        entering: (k,) of them.
        near, who: (nx, ny) distance to the nearest and its number, or -1: updated.
    """
    nx, ny = near.shape
    # distances to those that are known, whose heights may have changed
    for i in range(nx):
        for j in range(ny):
            if who[i, j] >= 0:
                k = who[i, j]
                dx, dy = elements[k, 0] - i, elements[k, 1] - j
                near[i, j] = math.sqrt(dx * dx + dy * dy + elements[k, 2]) - elements[k, 3]
    # each pixel begins with the nearest of those in it
    for k in entering:
        i = min(max(int(elements[k, 0] + 0.5), 0), nx - 1)
        j = min(max(int(elements[k, 1] + 0.5), 0), ny - 1)
        _take_nearer(elements, k, i, j, near, who)
    # those of other pixels are half a pixel away at least, but for their weights
    sure = 0.5
    for k in range(len(elements)):
        sure = min(sure, 0.5 - elements[k, 3])
    for sweep in range(2):
        step = 1 - 2 * sweep
        for row in range(nx):
            i = row if step > 0 else nx - 1 - row
            m = i - step
            if 0 <= m < nx:
                for j in range(ny):  # from the three pixels of the row before
                    if near[i, j] > sure:
                        for n in range(max(j - 1, 0), min(j + 2, ny)):
                            _take_nearer(elements, who[m, n], i, j, near, who)
            for j in range(1, ny):  # along the row, there and back
                if near[i, j] > sure:
                    _take_nearer(elements, who[i, j - 1], i, j, near, who)
            for j in range(ny - 2, -1, -1):
                if near[i, j] > sure:
                    _take_nearer(elements, who[i, j + 1], i, j, near, who)


@njit(cache=True, nogil=True)
def widest_empty_disc(distance: Field, greatest: float) -> Field:
    """Radius of the widest disc without points that covers each pixel.

    Args:
        distance: (nx, ny) from each pixel to the nearest point.
        greatest: radius that no disc is told beyond.
    """
    nx, ny = distance.shape
    most = np.float32(greatest)
    widest = np.minimum(distance, most)
    for i in range(nx):
        for j in range(ny):
            radius = distance[i, j]
            # what lies in a neighbour's disc is covered by that one; far out only the rim counts
            needed = radius > 0.5
            rim = radius < most
            if not needed:
                continue
            for m in range(max(i - 1, 0), min(i + 2, nx)):
                for n in range(max(j - 1, 0), min(j + 2, ny)):
                    apart = math.sqrt(float((m - i) * (m - i) + (n - j) * (n - j)))
                    rim = rim or distance[m, n] < most
                    needed = needed and (
                        apart == 0.0
                        or distance[m, n] < radius + apart - NEAR_CONTAINED
                        or radius >= most
                    )
            if not (needed and rim):
                continue
            # all pixels that this disc covers
            radius = min(radius, most)
            for m in range(max(i - int(radius), 0), min(i + int(radius) + 1, nx)):
                half = int(math.sqrt(radius * radius - (m - i) * (m - i)))
                for n in range(max(j - half, 0), min(j + half + 1, ny)):
                    widest[m, n] = max(widest[m, n], radius)
    return widest


def chance_radius(widest: Field, points: Array, pixel: float, least: float, most: float) -> Field:
    """(nx, ny) m, the widest disc without points that is no gap, for each pixel of a raster.

    Args:
        widest: (nx, ny) m, the widest disc without points that covers each pixel.
        points: (k, 2) in pixels.
        pixel: side of a pixel, metres.
        least, most: bounds of what is returned, metres.
    """
    side = max(1, round(TILE_M / pixel))
    tiles = -(-widest.shape[0] // side), -(-widest.shape[1] // side)
    apart = 3  # radii that are tried from one look to the next
    steps = int(np.ceil(apart * np.log(most / least) / np.log(GROWTH))) + 1
    # a pixel is as wide as what holds one point by itself
    radii = max(least / WIDEST, pixel) * GROWTH ** (np.arange(steps + apart) / apart)
    # closed area of each tile and those around it, up to each radius
    tile = np.add.outer(
        np.arange(widest.shape[0]) // side * tiles[1], np.arange(widest.shape[1]) // side
    )
    step = np.searchsorted(radii, widest.ravel())
    known = step < len(radii)
    key = tile.ravel()[known] * len(radii) + step[known]
    count = np.bincount(key, minlength=tiles[0] * tiles[1] * len(radii))
    closed = _tile_sums(count.reshape(*tiles, len(radii))).cumsum(axis=2) * pixel**2
    # and how many points there are
    i, j = np.clip(points / side, 0, np.array(tiles) - 1).astype(np.int64).T
    count = np.bincount(i * tiles[1] + j, minlength=tiles[0] * tiles[1])
    number = _tile_sums(count.reshape(*tiles, 1))
    now, later = closed[..., :-apart], closed[..., apart:]
    stays = (later <= STAYS * now) & (now >= AREA_PER_POINT * number * radii[: now.shape[2]] ** 2)
    first = np.where(stays.any(axis=2), stays.argmax(axis=2), now.shape[2] - 1)
    found = np.where(number[..., 0] >= FEWEST_POINTS, radii[first] * WIDEST, least)
    found = np.clip(found, least, most)
    found = np.repeat(np.repeat(found, side, axis=0), side, axis=1)
    return found[: widest.shape[0], : widest.shape[1]].astype(np.float32)


def _tile_sums(tiles: Rows) -> Array:
    """(m, n, k) sums over each tile and the eight around it."""
    return np.asarray(9.0 * uniform_filter(tiles.astype(np.float64), (3, 3, 1), mode="constant"))
