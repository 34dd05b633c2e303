"""Unions of axis-aligned boxes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_SAME_FACE_M = 1e-9
"""m: faces as near as this to each other are taken for one, as decimal numbers do not meet."""


def joined_boxes(boxes: Array) -> Array:
    """The same union by no more boxes: any two that make one box together are one.

    Boxes inside of others are left out, and boxes that fill the one around them all are that one:
    a box cut into several, in whatever way, is one box again.

    Args:
        boxes: (k, 2, 3) lower and upper corners.

    Returns:
        (m, 2, 3), m ≤ k, in lexicographic order.
    """
    kept = _with_common_faces(boxes)
    kept = kept[np.lexsort(kept.reshape(len(kept), -1).T[::-1])]
    first = 0
    while first < len(kept):
        others = np.delete(kept, first, axis=0)
        at = _makes_a_box(kept[first], others)
        if at < 0:
            first += 1
            continue
        others[at, 0] = np.minimum(others[at, 0], kept[first, 0])
        others[at, 1] = np.maximum(others[at, 1], kept[first, 1])
        kept = others[np.lexsort(others.reshape(len(others), -1).T[::-1])]
        first = 0
    around = np.stack([kept[:, 0].min(axis=0), kept[:, 1].max(axis=0)])[None]
    return around if len(kept) > 1 and _fill_one_box(kept) else kept


def _fill_one_box(boxes: Array) -> bool:
    """Whether the union of the boxes (k, 2, 3) is the box around them."""
    planes = [np.unique(boxes[:, :, axis]) for axis in range(3)]
    filled = np.zeros([len(at) - 1 for at in planes], np.bool_)
    for box in boxes:
        ends = [np.searchsorted(at, box[:, axis]) for axis, at in enumerate(planes)]
        filled[tuple(slice(*end) for end in ends)] = True
    return bool(filled.all())


def _makes_a_box(box: Array, others: Array) -> int:
    """The first of the (n, 2, 3) boxes that makes one together with `box`; -1 where none does."""
    lower, upper = others[:, 0], others[:, 1]
    meets = ((lower <= box[1]) & (upper >= box[0])).all(axis=1)
    beside = meets & (((lower == box[0]) & (upper == box[1])).sum(axis=1) >= 2)
    around = ((lower <= box[0]) & (upper >= box[1])).all(axis=1)
    inside = ((lower >= box[0]) & (upper <= box[1])).all(axis=1)
    rows = np.flatnonzero(beside | around | inside)
    return int(rows[0]) if len(rows) else -1


def _with_common_faces(boxes: Array) -> Array:
    """The boxes (k, 2, 3), faces that all but meet moved to the lowest of them."""
    moved = boxes.copy()
    if len(boxes) < 2:
        return moved
    for axis in range(boxes.shape[2]):
        values = np.unique(boxes[:, :, axis])
        group = np.cumsum(np.append(True, np.diff(values) > _SAME_FACE_M)) - 1
        lowest = values[np.searchsorted(group, group)]
        moved[:, :, axis] = lowest[np.searchsorted(values, boxes[:, :, axis])]
    return moved


def disjoint_rectangles(rectangles: Array) -> Array:
    """The union of rectangles by such as share no area, which depend on nothing but the union.

    Strips along y, as wide in x as they stay the same.

    Args:
        rectangles: (k, 2, 2) lower and upper corners.

    Returns:
        (m, 2, 2), in lexicographic order.
    """
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
