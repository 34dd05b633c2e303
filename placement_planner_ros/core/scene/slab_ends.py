"""In which slab of a clearance field each box ends, and how far up in it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.types import Array

Numbers = npt.NDArray[np.int64]


def ends_in_slabs(
    x: Numbers, y: Numbers, bottoms: Array, ends: Array, rise: float
) -> tuple[Numbers, Array]:
    """Slabs of k boxes, of a height `rise` from 0 on, and how far up in them they end.

    Of what ends in one slab only the nearest counts in the end. So that this is not by chance a
    flat thing on top of a wall instead of the wall, what a flat box lies on ends with the slab
    below. And the middle of a dome reaches higher than its rim in the same slab, which is nearer:
    where nothing goes on above, boxes end as high as any in the cells around.

    Args:
        x, y: (k,) of their cells, from 0 on.
        bottoms, ends: (k,) from where and up to where they go, metres; ends are not negative.

    Returns:
        (k,) numbers of slabs, and (k,) metres above the lower side of these.
    """
    slab = np.floor(ends / rise).astype(np.int64)
    covered = _covered(*_by_slab(slab), ends - bottoms <= rise, x, y)
    slab -= covered
    end = np.where(covered, rise, ends - slab * rise)
    return slab, _highest_around(*_by_slab(slab), end, x, y)


@kernel(nogil=True)
def _by_slab(slab: Numbers) -> tuple[Numbers, Numbers]:
    """(k,) boxes in order of their slabs, and (s + 1,) where each of all slabs begins there."""
    high = np.int64(0)
    for e in range(len(slab)):
        high = max(high, slab[e] + 1)
    start = np.zeros(high + 1, np.int64)
    for e in range(len(slab)):
        start[slab[e] + 1] += 1
    for s in range(high):
        start[s + 1] += start[s]
    order, place = np.empty(len(slab), np.int64), start.copy()
    for e in range(len(slab)):
        order[place[slab[e]]] = e
        place[slab[e]] += 1
    return order, start


@kernel()
def _columns(x: Numbers, y: Numbers) -> Numbers:
    """A number for each column of cells, and for those around them: none of any slab yet."""
    width, depth = np.int64(0), np.int64(0)
    for e in range(len(x)):
        width, depth = max(width, x[e] + 1), max(depth, y[e] + 1)
    return np.full((width + 2, depth + 2), -2, np.int64)


@kernel(nogil=True)
def _covered(
    order: Numbers, start: Numbers, flat: npt.NDArray[np.bool_], x: Numbers, y: Numbers
) -> npt.NDArray[np.bool_]:
    """(k,) of the boxes that are not flat, those with a flat one that ends in their slab in their
    cell or the eight around; none in slab 0."""
    of_slab = _columns(x, y)
    covered = np.zeros(len(x), np.bool_)
    for s in range(1, len(start) - 1):
        for e in order[start[s] : start[s + 1]]:
            if flat[e]:
                of_slab[x[e] + 1, y[e] + 1] = s
        for e in order[start[s] : start[s + 1]]:
            for i in range(x[e], x[e] + 3):
                for j in range(y[e], y[e] + 3):
                    covered[e] = covered[e] or (not flat[e] and of_slab[i, j] == s)
    return covered


@kernel(nogil=True)
def _highest_around(order: Numbers, start: Numbers, end: Array, x: Numbers, y: Numbers) -> Array:
    """(k,) the greatest end in the cell of each box, and the eight around, among those of its slab;
    its own where something there ends in the next slab."""
    of_slab = _columns(x, y)
    greatest = np.empty(of_slab.shape)
    goes_on = np.zeros(len(end), np.bool_)
    highest = end.copy()
    for s in range(len(start) - 2, -1, -1):
        for e in order[start[s] : start[s + 1]]:
            for i in range(x[e], x[e] + 3):
                for j in range(y[e], y[e] + 3):
                    goes_on[e] = goes_on[e] or of_slab[i, j] == s + 1
        for e in order[start[s] : start[s + 1]]:
            i, j = x[e] + 1, y[e] + 1
            if of_slab[i, j] != s or greatest[i, j] < end[e]:
                of_slab[i, j], greatest[i, j] = s, end[e]
        for e in order[start[s] : start[s + 1]]:
            if goes_on[e]:
                continue
            for i in range(x[e], x[e] + 3):
                for j in range(y[e], y[e] + 3):
                    if of_slab[i, j] == s:
                        highest[e] = max(highest[e], greatest[i, j])
    return highest
