"""Boxes that nothing which moves may enter, as part of an obstacle set and taken out of regions.

Of a box, the cells that its surface lies in hold what of them is in the box: nothing gets inside
but through these. What is wholly inside from the beginning is told by `inside`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.types import Array, Index32, Mask


def boxes_of(numbers: npt.ArrayLike) -> Array:
    """(k, 2, 3) lower and upper corners, of six numbers per box, one after the other."""
    return np.array(numbers, dtype=np.float64).reshape(-1, 2, 3)


def inside(points: Array, boxes: Array) -> Mask:
    """(...,) whether points (..., 3) lie in any of the boxes (k, 2, 3)."""
    at = points[..., None, :]
    return np.asarray(((at >= boxes[:, 0]) & (at <= boxes[:, 1])).all(axis=-1).any(axis=-1))


def kept_out(obstacles: ObstacleSet, boxes: Array, lower: Array, upper: Array) -> ObstacleSet:
    """The obstacle set with boxes (k, 2, 3) as obstacles on which nothing stands.

    Args:
        lower, upper: (3,) corners of all space that anything gets to; what of the boxes lies
            outside is left out.
    """
    within = np.stack([np.maximum(boxes[:, 0], lower), np.minimum(boxes[:, 1], upper)], axis=1)
    within = within[(within[:, 1] > within[:, 0]).all(axis=1)]
    if not len(within):
        return obstacles
    larger = obstacles.reaching(within[:, 0].min(axis=0), within[:, 1].max(axis=0))
    shells = [_box_shell(larger, *box) for box in within]
    cells, low, high = (np.concatenate(each) for each in zip(*shells, strict=True))
    return larger.with_boxes(cells, low, high)


def _box_shell(obstacles: ObstacleSet, lower: Array, upper: Array) -> tuple[Index32, Array, Array]:
    """The cells (n, 3) that the surface of a box lies in, and the corners (n, 3) of what of them is
    in the box."""
    size = obstacles.cell_size
    first = np.floor((lower - obstacles.origin) / size).astype(np.int64)
    last = np.maximum(np.ceil((upper - obstacles.origin) / size).astype(np.int64) - 1, first)
    shell = np.ones(last - first + 1, np.bool_)
    shell[1:-1, 1:-1, 1:-1] = False
    cells = np.argwhere(shell) + first
    low = obstacles.origin + cells * size
    return cells.astype(np.int32), np.maximum(low, lower), np.minimum(low + size, upper)


def cut(regions: tuple[Region, ...], boxes: Array) -> tuple[Region, ...]:
    """The regions without what of them lies in boxes (k, 2, 3), larger first."""
    left = []
    for region in regions:
        low, high = region.rectangles[:, :2].min(axis=0), region.rectangles[:, 2:].max(axis=0)
        section = np.array([(low, high)])
        for box in boxes:
            corners = np.array([(x, y) for x in (low[0], high[0]) for y in (low[1], high[1])])
            heights = region.heights(corners)
            if heights.min() >= box[0, 2] and heights.max() <= box[1, 2]:
                section = _without_hole(section, box[:, :2])
        part = region.within(section) if len(section) else None
        if part is not None:
            left.append(region if part.area >= region.area else part)
    return tuple(sorted(left, key=lambda region: -region.area))


def _without_hole(section: Array, hole: Array) -> Array:
    """(m, 2, 2) disjoint rectangles that are left of (k, 2, 2) without one of corners (2, 2)."""
    parts = []
    for low, high in section:
        inner_low, inner_high = np.maximum(low, hole[0]), np.minimum(high, hole[1])
        if (inner_low >= inner_high).any():
            parts.append((low, high))
            continue
        (x0, y0), (x1, y1) = low, high
        (a0, b0), (a1, b1) = inner_low, inner_high
        around = (
            ((x0, y0), (a0, y1)),
            ((a1, y0), (x1, y1)),
            ((a0, y0), (a1, b0)),
            ((a0, b1), (a1, y1)),
        )
        parts += [each for each in around if each[0][0] < each[1][0] and each[0][1] < each[1][1]]
    return np.array(parts, dtype=np.float64).reshape(-1, 2, 2)
