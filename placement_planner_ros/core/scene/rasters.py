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
        low, high: (2,) corners of them, m.
        pixel: side of a pixel, metres.
        rim: m around the points.
    """

    def __init__(self, low: Array, high: Array, pixel: float, rim: float) -> None:
        self.pixel = pixel
        self.origin = low - rim
        shape = np.ceil((high + rim - self.origin) / pixel).astype(int) + 1
        self.shape = (int(shape[0]), int(shape[1]))

    def counts(self, points: Array) -> Array:
        """`pixel_sums`, without heights, of those points (k, 2), m, that are on the raster."""
        at = (points - self.origin) / self.pixel
        at = at[points_within(at, np.full(2, -0.5), np.array(self.shape) - 0.5)]
        return pixel_sums(at, np.zeros(0), self.shape)

    def width(self, side: float) -> int:
        """Pixels, an odd number, along a square of that side, metres, or a little less."""
        return 2 * int(0.5 * side / self.pixel) + 1

    def nearest(self, discs: Array, most: float = math.inf) -> tuple[Field, Index]:
        """(nx, ny) pixels, no more than `most`, to the nearest of points (n, 2), or of discs (n, 3)
        of those middles and radii, negative within; and which that is, or -1."""
        near = np.full(self.shape, np.float32(min(most, sum(self.shape))))
        who = np.full(self.shape, np.int32(-1))
        elements = np.zeros((len(discs), 4))
        elements[:, :2] = discs[:, :2]
        if discs.shape[1] > 2:
            elements[:, 3] = discs[:, 2]
        hand_on_nearest(elements, np.arange(len(discs)), near, who)
        return near, who


def points_within(points: npt.NDArray[np.floating], low: Array, high: Array) -> Mask:
    """(n,) which points (n, 2) lie between two corners, the upper one left out."""
    x, y = points[:, 0], points[:, 1]
    return np.asarray((x >= low[0]) & (x < high[0]) & (y >= low[1]) & (y < high[1]))


@njit(cache=True, nogil=True)
def pixel_sums(at: Array, heights: Array, shape: tuple[int, int]) -> Array:
    """(5, nx, ny) of the points (n, 2), in pixels, and heights (n,) of each pixel.

    How many there are; the sums of their positions along x and y, and of their heights; and the
    greatest height, -inf where there is none. The first three without heights.
    """
    sums = np.zeros((5 if len(heights) else 3, *shape))
    sums[4:] = -np.inf
    for p in range(len(at)):
        # the pixel whose centre is nearest
        i, j = int(at[p, 0] + 0.5), int(at[p, 1] + 0.5)
        sums[0, i, j] += 1.0
        sums[1, i, j] += at[p, 0]
        sums[2, i, j] += at[p, 1]
        if len(heights):
            sums[3, i, j] += heights[p]
            sums[4, i, j] = max(sums[4, i, j], heights[p])
    return sums


def pixel_means(sums: Array) -> Array:
    """(m, 2) mean position of the points of each pixel that has any, in order, of `pixel_sums`."""
    held = sums[0] > 0.0
    return np.column_stack([sums[1][held], sums[2][held]]) / sums[0][held][:, None]


@njit(cache=True, nogil=True)
def window_sums(images: Array, width: int) -> Array:
    """(k, nx, ny) sums over the square of so many pixels, an odd number, around each pixel."""
    number, nx, ny = images.shape
    half = width // 2
    result, along = np.empty_like(images), np.empty((nx, ny))
    for n in range(number):
        # along each row, what comes in and what goes
        for i in range(nx):
            total = 0.0
            for j in range(-half, ny):
                if j + half < ny:
                    total += images[n, i, j + half]
                if j - half - 1 >= 0:
                    total -= images[n, i, j - half - 1]
                if j >= 0:
                    along[i, j] = total
        # and so for whole rows
        column = np.zeros(ny)
        for i in range(-half, nx):
            if i + half < nx:
                column += along[i + half]
            if i - half - 1 >= 0:
                column -= along[i - half - 1]
            if i >= 0:
                result[n, i] = column
    return result


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _take_nearer(elements: Array, k: int, i: int, j: int, near: Field, who: Index) -> bool:
    """Take element k, if there is one, for the nearest of pixel (i, j) where it is; whether so."""
    if k >= 0 and k != who[i, j]:
        dx, dy = elements[k, 0] - i, elements[k, 1] - j
        reach = near[i, j] + elements[k, 3]
        square = dx * dx + dy * dy + elements[k, 2]
        if reach > 0.0 and square < reach * reach:
            near[i, j], who[i, j] = math.sqrt(square) - elements[k, 3], k
            return True
    return False


@njit(cache=True, nogil=True)
def hand_on_nearest(elements: Array, entering: Rows, near: Field, who: Index) -> None:
    """Find the nearest element to each pixel, from those that are known and others that enter.

    Two sweeps over the raster hand the nearest on from pixel to pixel; seldom, and by less than a
    tenth of a pixel, an element that is not quite the nearest is told.

    Args:
        elements: (n, 4) x and y, each within half a pixel of a pixel of the raster; the square of
            its height above the raster, which grows from one call to the next; its weight.
        entering: (k,) of them.
        near, who: (nx, ny) distance to the nearest and its number, or -1: updated.
    """
    nx, ny = near.shape
    changed = np.zeros(nx, np.bool_)  # rows in which something did
    # distances to those that are known, where they are higher now
    for i in range(nx):
        for j in range(ny):
            k = who[i, j]
            if k >= 0 and elements[k, 2] > 0.0:
                dx, dy = elements[k, 0] - i, elements[k, 1] - j
                near[i, j] = math.sqrt(dx * dx + dy * dy + elements[k, 2]) - elements[k, 3]
                changed[i] = True
    # each pixel begins with the nearest of those in it
    for k in entering:
        i = min(max(int(elements[k, 0] + 0.5), 0), nx - 1)
        j = min(max(int(elements[k, 1] + 0.5), 0), ny - 1)
        changed[i] |= _take_nearer(elements, k, i, j, near, who)
    # those of other pixels are half a pixel away at least, but for their weights
    sure = 0.5
    for k in range(len(elements)):
        sure = min(sure, 0.5 - elements[k, 3])
    # over all rows there, and back
    for sweep in range(2):
        step = 1 - 2 * sweep
        for row in range(nx):
            i = row if step > 0 else nx - 1 - row
            m = i - step
            if 0 <= m < nx and (changed[m] or changed[i]):
                for j in range(ny):  # from the three pixels of the row before
                    if near[i, j] > sure:
                        for n in range(max(j - 1, 0), min(j + 2, ny)):
                            changed[i] |= _take_nearer(elements, who[m, n], i, j, near, who)
            if not changed[i]:
                continue
            for j in range(1, ny):  # along the row, there and back
                if near[i, j] > sure:
                    changed[i] |= _take_nearer(elements, who[i, j - 1], i, j, near, who)
            for j in range(ny - 2, -1, -1):
                if near[i, j] > sure:
                    changed[i] |= _take_nearer(elements, who[i, j + 1], i, j, near, who)


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


def chance_radius(widest: Field, count: Array, pixel: float, least: float, most: float) -> Field:
    """(nx, ny) m, the widest disc without points that is no gap, for each pixel of a raster.

    Args:
        widest: (nx, ny) m, the widest disc without points that covers each pixel.
        count: (nx, ny) points in each pixel.
        pixel: side of a pixel, metres.
        least, most: bounds of what is returned, metres.
    """
    side = max(1, round(TILE_M / pixel))
    (nx, ny), tiles = widest.shape, tuple(-(-n // side) for n in widest.shape)
    apart = 3  # radii that are tried from one look to the next
    steps = math.ceil(apart * math.log(most / least) / math.log(GROWTH)) + 1
    # a pixel is as wide as what holds one point by itself
    radii = max(least / WIDEST, pixel) * GROWTH ** (np.arange(steps + apart) / apart)
    # closed area of each tile and those around it, up to each radius
    closed = _tile_sums(_discs_of_tiles(widest, side, radii)).cumsum(axis=2) * pixel**2
    # and how many points there are
    padded = np.zeros((tiles[0] * side, tiles[1] * side))
    padded[:nx, :ny] = count
    number = _tile_sums(padded.reshape(tiles[0], side, tiles[1], side).sum(axis=(1, 3))[..., None])
    now, later = closed[..., :-apart], closed[..., apart:]
    stays = (later <= STAYS * now) & (now >= AREA_PER_POINT * number * radii[: now.shape[2]] ** 2)
    first = np.where(stays.any(axis=2), stays.argmax(axis=2), now.shape[2] - 1)
    found = np.where(number[..., 0] >= FEWEST_POINTS, radii[first] * WIDEST, least)
    found = np.clip(found, least, most)
    found = np.repeat(np.repeat(found, side, axis=0), side, axis=1)
    return found[:nx, :ny].astype(np.float32)


@njit(cache=True, nogil=True)
def _discs_of_tiles(widest: Field, side: int, radii: Array) -> Array:
    """(m, n, k) how many pixels of each tile have each radius as that of their widest disc.

    Args:
        widest: (nx, ny) m; tiles are of `side` pixels.
        radii: (k,) m, ascending.
    """
    nx, ny = widest.shape
    counts = np.zeros(((nx + side - 1) // side, (ny + side - 1) // side, len(radii)))
    for i in range(nx):
        for j in range(ny):
            if widest[i, j] > radii[-1]:
                continue
            step = 0
            while radii[step] < widest[i, j]:
                step += 1
            counts[i // side, j // side, step] += 1.0
    return counts


def _tile_sums(tiles: Array) -> Array:
    """(m, n, k) sums over each tile and the eight around it."""
    return np.moveaxis(window_sums(np.ascontiguousarray(np.moveaxis(tiles, 2, 0)), 3), 0, 2)
