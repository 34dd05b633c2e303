"""How wide gaps between points are by chance: one statistic for spacing, holes and meshes.

Of the area that points lie in, some is closed by discs of a radius: no wider disc without points
covers it. On a surface this share grows with the radius until all chance holes are closed, and then
stays: on a lattice from 0.7 of its spacing on, on points drawn at random from some 1.2. On wires,
rods and perforated plates it stays, too, once the gaps along the material are closed, until the
radius reaches that of the holes. So the radius is taken at which it first stays, and `WIDEST` times
that: what is wider is a gap.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter

from placement_planner_ros.core.scene.transforms import Field
from placement_planner_ros.core.types import Array

TILE_M = 0.03
"""m, side of the tiles whose spacing is judged, each with the eight around it."""
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


def _tile_sums(tiles: npt.NDArray[np.int64]) -> Array:
    """(m, n, k) sums over each tile and the eight around it."""
    return np.asarray(9.0 * uniform_filter(tiles.astype(np.float64), (3, 3, 1), mode="constant"))
