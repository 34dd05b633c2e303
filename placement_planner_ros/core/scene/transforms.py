"""Distance transforms on a raster: the nearest point to each pixel, and discs that hold none.

Lengths are in pixels, positions of points too: the centre of pixel (i, j) is at (i, j). A
*weighted* point counts as nearer by its weight, so that points with the radii of discs as weights
give the signed distance to the union of the discs.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.types import Array

Field = npt.NDArray[np.float32]
Index = npt.NDArray[np.int32]
Mask = npt.NDArray[np.bool_]

NEAR_CONTAINED = 0.05
"""Pixels by which a disc may reach beyond a neighbour's and still be left out beside it."""


@kernel(lean=True)
def _hand_on(at: Array, weight: Array, k: int, i: int, j: int, near: Field, who: Index) -> None:
    """Take point k, if there is one, for the nearest of pixel (i, j) where it is."""
    if k >= 0 and k != who[i, j]:
        dx, dy = at[k, 0] - i, at[k, 1] - j
        reach = near[i, j] + weight[k]
        square = dx * dx + dy * dy
        if reach > 0.0 and square < reach * reach:
            near[i, j], who[i, j] = math.sqrt(square) - weight[k], k


@kernel(nogil=True)
def distance_to_points(
    shape: tuple[int, int], at: Array, weight: Array, greatest: float
) -> tuple[Field, Index]:
    """Distance from each pixel to the nearest of weighted points, and which that is.

    Two sweeps over the raster hand the nearest on from pixel to pixel, with the exact distance to
    it; seldom, and by less than a tenth of a pixel, a point that is not quite the nearest is told.

    Args:
        at: (k, 2) the points, each within half a pixel of a pixel of the raster.
        weight: (k,).
        greatest: distance where there is no point.

    Returns:
        (nx, ny) each; the points' numbers are -1 where there is none.
    """
    nx, ny = shape
    near = np.full((nx, ny), np.float32(greatest))
    who = np.full((nx, ny), np.int32(-1))
    # each pixel begins with the nearest of the points in it
    for k in range(len(at)):
        i = min(max(int(at[k, 0] + 0.5), 0), nx - 1)
        j = min(max(int(at[k, 1] + 0.5), 0), ny - 1)
        own = math.hypot(at[k, 0] - i, at[k, 1] - j) - weight[k]
        if own < near[i, j]:
            near[i, j], who[i, j] = own, k
    for sweep in range(2):
        step = 1 - 2 * sweep
        for row in range(nx):
            i = row if step > 0 else nx - 1 - row
            m = i - step
            if 0 <= m < nx:
                for j in range(ny):  # from the three pixels of the row before
                    for n in range(max(j - 1, 0), min(j + 2, ny)):
                        _hand_on(at, weight, who[m, n], i, j, near, who)
            for j in range(1, ny):  # along the row, there and back
                _hand_on(at, weight, who[i, j - 1], i, j, near, who)
            for j in range(ny - 2, -1, -1):
                _hand_on(at, weight, who[i, j + 1], i, j, near, who)
    return near, who


@kernel(nogil=True)
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
            radius = min(radius, most)
            for m in range(max(i - int(radius), 0), min(i + int(radius) + 1, nx)):
                half = int(math.sqrt(radius * radius - (m - i) * (m - i)))
                for n in range(max(j - half, 0), min(j + half + 1, ny)):
                    widest[m, n] = max(widest[m, n], radius)
    return widest
