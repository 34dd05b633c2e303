"""Axis-aligned boxes, and unions of rectangles."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def within(
    points: npt.NDArray[np.number], lower: npt.ArrayLike, upper: npt.ArrayLike
) -> npt.NDArray[np.bool_]:
    """(n,) which points (n, k) lie between two corners (k,), on the faces too."""
    result = np.ones(len(points), np.bool_)
    corners = np.asarray(lower).tolist(), np.asarray(upper).tolist()
    # axis by axis, which is many times as fast as for all of a point at once
    for along, low, high in zip(points.T, *corners, strict=True):
        result &= (along >= low) & (along <= high)
    return result


def disjoint_rectangles(rectangles: Array) -> Array:
    """The union of rectangles by such as share no area, which depend on nothing but the union.

    Strips along y, as wide in x as they stay the same.

    Args:
        rectangles: (k, 2, 2) lower and upper corners.

    Returns:
        (m, 2, 2), in lexicographic order.
    """
    if len(rectangles) == 1 and (rectangles[0, 1] > rectangles[0, 0]).all():
        return rectangles.copy()
    x, y = (np.unique(rectangles[:, :, axis]) for axis in range(2))
    if len(x) < 2 or len(y) < 2:
        return np.zeros((0, 2, 2))
    inside = np.zeros((len(x) - 1, len(y) - 1), np.bool_)
    for (x0, y0), (x1, y1) in rectangles:
        i, j, m, n = np.searchsorted(x, (x0, x1)).tolist() + np.searchsorted(y, (y0, y1)).tolist()
        inside[i:j, m:n] = True
    strips = np.flatnonzero(np.append(True, (inside[1:] != inside[:-1]).any(axis=1)))
    ends = np.append(strips[1:], len(inside))
    found = []
    for first, last in zip(strips, ends, strict=True):
        steps = np.diff(np.concatenate([[0], inside[first].astype(np.int8), [0]]))
        for low, high in zip(np.flatnonzero(steps > 0), np.flatnonzero(steps < 0), strict=True):
            found.append(((x[first], y[low]), (x[last], y[high])))
    return np.array(found, dtype=np.float64).reshape(-1, 2, 2)
