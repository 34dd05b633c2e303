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

from placement_planner_ros.core.types import Array, Index, Index32, Mask

Field = npt.NDArray[np.float32]

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


@njit(cache=True, nogil=True)
def _hand_to_rows(
    fields: Field, axis: int, near: Field, who: Index32, rows: Mask, columns: Mask
) -> None:
    """Hand the nearest on from each row to the next, there and back: to all pixels that lie more
    along the first axis than across it.

    Args:
        fields: (n + 1, 4) as `hand_on_nearest` has elements; the last stands for none.
        axis: which of their fields is along the first axis, 0 or 1.
        near, who: (nx, ny) updated.
        rows, columns: (nx,) and (ny,) in which something has changed, updated: a row is looked at
            if it is one of these, or the row before is.
    """
    nx, ny = who.shape
    # fields of the nearest of the row before, with none at either end
    line = np.full((4, ny + 2), np.float32(np.inf))
    line[2:] = 0.0
    along, across, above, weights = line[0, 1:-1], line[1, 1:-1], line[2, 1:-1], line[3, 1:-1]
    away, chosen = np.empty((3, ny), np.float32), np.empty(ny, np.int32)
    place = np.arange(ny).astype(np.float32)
    for sweep in range(2):
        for row in range(1, nx):
            i, m = (row, row - 1) if sweep == 0 else (nx - 1 - row, nx - row)
            if not (rows[i] or rows[m]):
                continue
            before, mine, own = who[m], who[i], near[i]
            for j in range(ny):
                k = before[j]
                along[j], across[j] = fields[k, axis], fields[k, 1 - axis]
                above[j], weights[j] = fields[k, 2], fields[k, 3]
            # how far away the three beside in the row before are: many at once, as what follows
            for beside in range(3):
                x, y = line[0, beside : beside + ny], line[1, beside : beside + ny]
                up, weight = line[2, beside : beside + ny], line[3, beside : beside + ny]
                to, at = away[beside], np.float32(i)
                for j in range(ny):
                    dx, dy = x[j] - at, y[j] - place[j]
                    to[j] = math.sqrt(dx * dx + dy * dy + up[j]) - weight[j]
            # which of them, or else its own, is the nearest
            left, ahead, right = away[0], away[1], away[2]
            fewest = np.int32(3)
            for j in range(ny):
                least, best = own[j], np.int32(3)
                best = np.int32(1) if ahead[j] < least else best
                least = ahead[j] if ahead[j] < least else least
                best = np.int32(0) if left[j] < least else best
                least = left[j] if left[j] < least else least
                chosen[j] = np.int32(2) if right[j] < least else best
                own[j] = right[j] if right[j] < least else least
                fewest = min(fewest, chosen[j])
            if fewest < 3:
                rows[i] = True
                for j in range(ny):
                    if chosen[j] < 3:
                        columns[j], mine[j] = True, before[j + chosen[j] - 1]


@njit(cache=True, nogil=True)
def hand_on_nearest(elements: Array, entering: Index, near: Field, who: Index32) -> None:
    """Find the nearest element to each pixel, from those that are known and others that enter.

    From row to row, and then from column to column, there and back, it is handed on from pixel to
    pixel; seldom, and by less than a tenth of a pixel, one that is not quite the nearest is told.

    Args:
        elements: (n, 4) x and y, each within half a pixel of a pixel of the raster; the square of
            its height above the raster, which grows from one call to the next; its weight.
        entering: (k,) of them.
        near, who: (nx, ny) distance to the nearest and its number, or -1: updated.
    """
    nx, ny = near.shape
    rows, columns = np.zeros(nx, np.bool_), np.zeros(ny, np.bool_)  # in which something changed
    fields, hangs = np.full((len(elements) + 1, 4), np.inf, np.float32), False
    fields[-1, 2:] = 0.0
    for k in range(len(elements)):
        for a in range(4):
            fields[k, a] = elements[k, a]
        hangs = hangs or elements[k, 2] > 0.0
    # those that are known may be further away now
    for i in range(nx if hangs else 0):
        for j in range(ny):
            k = who[i, j]
            if k >= 0 and fields[k, 2] > 0.0:
                dx, dy = fields[k, 0] - np.float32(i), fields[k, 1] - np.float32(j)
                near[i, j] = math.sqrt(dx * dx + dy * dy + fields[k, 2]) - fields[k, 3]
                rows[i] = columns[j] = True
    # each pixel begins with the nearest of those in it
    for k in entering:
        i = min(max(int(elements[k, 0] + 0.5), 0), nx - 1)
        j = min(max(int(elements[k, 1] + 0.5), 0), ny - 1)
        dx, dy = fields[k, 0] - np.float32(i), fields[k, 1] - np.float32(j)
        away = math.sqrt(dx * dx + dy * dy + fields[k, 2]) - fields[k, 3]
        if away < near[i, j]:
            near[i, j], who[i, j] = away, k
            rows[i] = columns[j] = True
    if not rows.any():
        return
    _hand_to_rows(fields, int(np.int64(0)), near, who, rows, columns)
    # the same with the axes exchanged
    near_across, who_across = near.T.copy(), who.T.copy()
    _hand_to_rows(fields, int(np.int64(1)), near_across, who_across, columns, rows)
    for i in range(nx):
        for j in range(ny):
            near[i, j], who[i, j] = near_across[j, i], who_across[j, i]


@njit(cache=True, nogil=True)
def widest_empty_disc(distance: Field, greatest: float) -> Field:
    """Radius of the widest disc without points that covers each pixel.

    Args:
        distance: (nx, ny) from each pixel to the nearest point.
        greatest: radius that no disc is told beyond.
    """
    nx, ny = distance.shape
    most, aslant = np.float32(greatest), math.sqrt(2.0)
    widest = np.minimum(distance, most)
    for i in range(nx):
        for j in range(ny):
            radius = distance[i, j]
            if radius < 1.0 or radius > most + 2.0:
                continue  # it covers no other, or nothing near it is nearer to a point
            # what lies in a neighbour's disc is covered by that one; far out only the rim counts
            needed = radius < most
            for m in range(max(i - 1, 0), min(i + 2, nx)):
                for n in range(max(j - 1, 0), min(j + 2, ny)):
                    if radius < most:
                        apart = (np.inf, 1.0, aslant)[abs(m - i) + abs(n - j)]
                        needed = needed and radius + apart - NEAR_CONTAINED > distance[m, n]
                    else:
                        needed = needed or distance[m, n] < most
                if not needed and radius < most:
                    break
            if not needed:
                continue
            # all pixels that this disc covers
            radius = min(radius, most)
            for m in range(max(i - int(radius), 0), min(i + int(radius) + 1, nx)):
                half = int(math.sqrt(radius * radius - (m - i) * (m - i)))
                covered = widest[m, max(j - half, 0) : j + half + 1]
                for n in range(len(covered)):  # many at once
                    covered[n] = max(covered[n], radius)
    return widest


@njit(cache=True, nogil=True)
def pixel_sums(
    points: Array, origin: Array, pixel: float, shape: tuple[int, int]
) -> tuple[Index, Array, Index]:
    """Those points (n, 2 or more), m, that lie on a raster by the pixels that they are in.

    Args:
        origin, pixel: (2,) of the first pixel's centre and m between two.

    Returns:
        (m,) pixels, numbered row by row; (m, k + 2) how many points each has, the sums of their
        columns, and the greatest of the last of these; (n,) which of the pixels each point is in,
        or -1.
    """
    n, k = points.shape
    number = np.full(shape[0] * shape[1], np.int32(-1))
    pixels, sums, of_point = np.empty(n, np.int64), np.empty((n, k + 2)), np.full(n, -1)
    m = 0
    for p in range(n):
        # the pixel whose centre is nearest
        u = (points[p, 0] - origin[0]) / pixel + 0.5
        v = (points[p, 1] - origin[1]) / pixel + 0.5
        if not (0.0 <= u < shape[0] and 0.0 <= v < shape[1]):
            continue
        at = int(u) * shape[1] + int(v)
        if number[at] < 0:
            number[at] = m
            pixels[m] = at
            sums[m] = 0.0
            sums[m, k + 1] = -np.inf
            m += 1
        row = of_point[p] = number[at]
        sums[row, 0] += 1.0
        for a in range(k):
            sums[row, a + 1] += points[p, a]
        sums[row, k + 1] = max(sums[row, k + 1], points[p, k - 1])
    return pixels[:m].copy(), sums[:m].copy(), of_point


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
