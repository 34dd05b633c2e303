"""Compartments, such as of a shelf, whose ceiling no sensor saw: does V lie in one?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.scene.freespace import CEILING_M, FREE, OCCUPIED, UNSEEN, SeenSpace
from placement_planner_ros.core.scene.regions import Region

SIDE_M, RISE_M = 0.15, 0.1
"""m beside V in which what rises so far above the surface, m, is a side of a compartment."""


def has_unseen_ceiling(space: SeenSpace, regions: Sequence[Region]) -> bool:
    """Whether there is surface below, things stand along two sides of V at least, and going up from
    most of the surface one comes to where no sensor looked before one comes to anything."""
    if not regions:
        return False
    size, volume = space.measured.cell_size, space.volume
    largest = max(regions, key=lambda region: region.area)
    middle = largest.rectangles.reshape(-1, 2, 2).mean(axis=(0, 1))
    floor = float(largest.heights(middle[None])[0])

    def cells(low: npt.ArrayLike, high: npt.ArrayLike) -> npt.NDArray[np.uint8]:
        first, last = (
            ((np.asarray(end) - space.origin) / size).astype(int).clip(0, space.shape)
            for end in (low, high)
        )
        return np.asarray(space.state[tuple(map(slice, first, last))])

    lower, upper = volume.lower, volume.upper
    # two cells up, noise and the margin of what was measured have ended
    up = cells((*lower[:2], floor + 2.0 * size), (*upper[:2], upper[2] + CEILING_M))
    if not up.size:
        return False
    # lone cells between two rays are no ceiling
    ceiling = up == OCCUPIED
    ceiling[:, :, :-1] |= (up[:, :, :-1] == UNSEEN) & (up[:, :, 1:] == UNSEEN)
    begun = up[:, :, 0] == FREE
    first = np.take_along_axis(up, ceiling.argmax(axis=2)[:, :, None], axis=2)[:, :, 0]
    unseen = begun & ceiling.any(axis=2) & (first == UNSEEN)
    if unseen.sum() <= 0.5 * max(int(begun.sum()), 1):
        return False
    sides = 0
    for axis in range(2):
        for face, outwards in ((lower[axis], -1.0), (upper[axis], 1.0)):
            low, high = np.append(lower[:2], floor + RISE_M), np.append(upper[:2], upper[2])
            reach = sorted((face - 0.5 * outwards * SIDE_M, face + outwards * SIDE_M))
            low[axis], high[axis] = reach
            beside = (cells(low, high) == OCCUPIED).any(axis=(axis, 2))
            sides += bool(beside.size and beside.mean() >= 0.5)
    return sides >= 2
