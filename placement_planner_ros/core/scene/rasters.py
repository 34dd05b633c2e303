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
GROWTH = 1.265
"""By this factor the radius grows from one look to the next; where the closed area grows by no more
in between, it stays."""
WIDEST = GROWTH * GROWTH
"""Times the radius at which the area stays, that the widest disc by chance has."""
AREA_PER_POINT = 0.15
"""Times the radius' square that the closed area of each point is, at least: else they are apart."""
SURE_COUNT = 12
"""Points in a tile that show their spacing; and rays that ended about a place on the surface for
each that passed it, to tell that it is whole: if a quarter of it were open, three in a hundred
times that many would by chance."""
MOST_HEIGHTS = 48
"""Heights that are told apart, at most."""
MOST_PIXELS = 60_000
"""Pixels of a raster up to which they are as fine as is asked for."""


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
            moved = changed[i]
            if 0 <= m < nx and (changed[m] or moved):
                for j in range(ny):  # from the three pixels of the row before
                    if near[i, j] > sure:
                        last = -1  # of those tried
                        for n in range(max(j - 1, 0), min(j + 2, ny)):
                            k = who[m, n]
                            if k != last:
                                moved |= _take_nearer(elements, k, i, j, near, who)
                                last = k
            if moved:
                for j in range(1, ny):  # along the row, there and back
                    if near[i, j] > sure:
                        moved |= _take_nearer(elements, who[i, j - 1], i, j, near, who)
                for j in range(ny - 2, -1, -1):
                    if near[i, j] > sure:
                        moved |= _take_nearer(elements, who[i, j + 1], i, j, near, who)
            changed[i] = moved


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


@njit(cache=True, nogil=True)
def pixel_sums(
    points: Array, origin: Array, pixel: float, shape: tuple[int, int]
) -> tuple[Array, Rows]:
    """Of those points (n, 2 or more), m, that lie on a raster: how many each pixel has, the sums of
    their columns, and the greatest of the last of these, -inf where there is none.

    Args:
        origin, pixel: (2,) of the first pixel's centre and m between two.

    Returns:
        (k + 2, nx, ny), and (n,) the number of the pixel that each point is in, or -1.
    """
    n, k = points.shape
    sums, of_point = np.zeros((k + 2, shape[0], shape[1])), np.full(n, -1)
    sums[k + 1] = -np.inf
    for p in range(n):
        # the pixel whose centre is nearest
        u = (points[p, 0] - origin[0]) / pixel + 0.5
        v = (points[p, 1] - origin[1]) / pixel + 0.5
        if not (0.0 <= u < shape[0] and 0.0 <= v < shape[1]):
            continue
        i, j = int(u), int(v)
        of_point[p] = i * shape[1] + j
        sums[0, i, j] += 1.0
        for a in range(k):
            sums[a + 1, i, j] += points[p, a]
        sums[k + 1, i, j] = max(sums[k + 1, i, j], points[p, k - 1])
    return sums, of_point


@njit(cache=True, nogil=True)
def window_sums(images: Array, width: int) -> Array:
    """(k, nx, ny) sums over the square of so many pixels, an odd number, around each pixel."""
    sums = np.empty(images.shape)
    nx, ny = images.shape[1:]
    half = width // 2
    for a in range(len(images)):
        rows = np.zeros(ny)  # sum of the rows around this one
        for i in range(-half, nx):
            if i + half < nx:
                rows += images[a, i + half]
            if i > half:
                rows -= images[a, i - half - 1]
            if i < 0:
                continue
            # and of these the columns around each pixel
            total = rows[:half].sum()
            for j in range(ny):
                if j + half < ny:
                    total += rows[j + half]
                if j > half:
                    total -= rows[j - half - 1]
                sums[a, i, j] = total
    return sums
