"""Compiled check of the object swept straight down onto a pose, against the obstacle set.

The sweep of a convex part is the hull of two copies. It is separated from a box by a face plane
of the part (of the upper copy where the normal points up, of the lower where it points down),
by an axis of the box, or by the distance kernel on the vertices of both copies.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.collision.against_boxes import (
    BoxArrays,
    boxes_apart,
    distance_bounds,
    layer_range,
    polytope_meets_box,
)
from placement_planner_ros.core.collision.separation import FREE, TOLERANCE
from placement_planner_ros.core.collision.shapes import ConvexSet
from placement_planner_ros.core.collision.spheres import bounding_sphere
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.types import Array


class ObjectArrays(NamedTuple):
    """p convex parts in the object's frame."""

    part_vertices: npt.NDArray[np.int64]
    """(p + 1,) first vertex of each part."""
    part_planes: npt.NDArray[np.int64]
    """(p + 1,) first plane of each part."""
    spheres: Array
    """(p + 1, 4) bounding ball (centre, radius) of each part, then of the object."""
    vertices: Array
    planes: Array
    """(f, 4) normal and offset."""

    @classmethod
    def of(cls, parts: Sequence[ConvexSet]) -> ObjectArrays:
        """Lay out convex parts."""
        corners = [np.ascontiguousarray(part.vertices, dtype=np.float64) for part in parts]
        every = np.ascontiguousarray(np.vstack(corners))
        balls = [bounding_sphere(c) for c in (*corners, every)]
        return cls(
            part_vertices=np.cumsum([0, *(len(c) for c in corners)], dtype=np.int64),
            part_planes=np.cumsum([0, *(len(p.offsets) for p in parts)], dtype=np.int64),
            spheres=np.array([[*center, radius + 1e-9] for center, radius in balls]),
            vertices=every,
            planes=np.vstack([np.column_stack([p.normals, p.offsets]) for p in parts]),
        )


class ObjectScratch(NamedTuple):
    """Work space; not shared between threads."""

    vertices: Array
    """(2 v, 3) of each part in the world, at rest then raised."""
    planes: Array
    """(f, 4) of the swept parts."""
    bounds: Array
    """(1, 6) box around the swept part."""
    work: Array

    @classmethod
    def of(cls, arrays: ObjectArrays) -> ObjectScratch:
        """Work space for one object."""
        return cls(
            vertices=np.zeros((2 * len(arrays.vertices), 3)),
            planes=np.zeros((len(arrays.planes), 4)),
            bounds=np.zeros((1, 6)),
            work=np.zeros((6, 4)),
        )


@kernel(lean=True)
def _place_part(
    thing: ObjectArrays, scratch: ObjectScratch, part: int, T: Array, raised: float
) -> None:
    """Vertices of both copies, planes and box of a swept part in the world."""
    first = thing.part_vertices[part]
    count = thing.part_vertices[part + 1] - first
    vertices, planes, bounds = scratch.vertices, scratch.planes, scratch.bounds
    for i in range(3):
        up = raised if i == 2 else 0.0
        low = np.inf
        high = -np.inf
        for v in range(count):
            w = T[i, 3]
            for j in range(3):
                w += T[i, j] * thing.vertices[first + v, j]
            vertices[2 * first + v, i] = w
            vertices[2 * first + count + v, i] = w + up
            low = min(low, w)
            high = max(high, w + up)
        bounds[0, i] = low
        bounds[0, i + 3] = high
    for v in range(thing.part_planes[part], thing.part_planes[part + 1]):
        offset = thing.planes[v, 3]
        for i in range(3):
            n = 0.0
            for j in range(3):
                n += T[i, j] * thing.planes[v, j]
            planes[v, i] = n
            offset += n * T[i, 3]
        planes[v, 3] = offset + max(planes[v, 2], 0.0) * raised


@kernel(lean=True)
def check_pose(
    thing: ObjectArrays,
    boxes: BoxArrays,
    scratch: ObjectScratch,
    T: Array,
    contact: float,
    raised: float,
    margin: float,
    tolerance: float,
) -> int:
    """One pose T (4, 4): FREE, or the answer to the first pair of part and box that is not."""
    if boxes.number == 0:
        return FREE
    parts = thing.part_vertices.shape[0] - 1
    columns, layers = boxes.columns, boxes.layers
    corners, grid, bounds = boxes.corners, boxes.grid, scratch.bounds
    size = grid[3]
    reach = margin + TOLERANCE
    for part in range(-1, parts):
        ball = thing.spheres[part]
        x = T[0, 3] + T[0, 0] * ball[0] + T[0, 1] * ball[1] + T[0, 2] * ball[2]
        y = T[1, 3] + T[1, 0] * ball[0] + T[1, 1] * ball[1] + T[1, 2] * ball[2]
        z = T[2, 3] + T[2, 0] * ball[0] + T[2, 1] * ball[1] + T[2, 2] * ball[2]
        bound, _ = distance_bounds(boxes.field_grid, boxes.field, x, y, z + 0.5 * raised)
        clear = bound >= ball[3] + 0.5 * raised + reach
        if part < 0:
            if clear:
                return FREE
            continue
        if clear:
            continue
        _place_part(thing, scratch, part, T, raised)
        i0 = max(int(np.floor((bounds[0, 0] - reach - grid[0]) / size)), 0)
        j0 = max(int(np.floor((bounds[0, 1] - reach - grid[1]) / size)), 0)
        k0 = int(np.floor((bounds[0, 2] - reach - grid[2]) / size))
        i1 = min(int(np.floor((bounds[0, 3] + reach - grid[0]) / size)) + 1, columns.shape[0])
        j1 = min(int(np.floor((bounds[0, 4] + reach - grid[1]) / size)) + 1, columns.shape[1] - 1)
        k1 = int(np.floor((bounds[0, 5] + reach - grid[2]) / size)) + 1
        for i in range(i0, i1):
            for j in range(j0, j1):
                first, last = layer_range(layers, columns[i, j], columns[i, j + 1], k0, k1)
                for box in range(first, last):
                    if abs(corners[box, 5] - contact) <= tolerance or boxes_apart(
                        bounds, 0, corners, box, margin
                    ):
                        continue
                    answer = polytope_meets_box(
                        scratch.vertices,
                        2 * thing.part_vertices[part],
                        2 * thing.part_vertices[part + 1],
                        scratch.planes,
                        thing.part_planes[part],
                        thing.part_planes[part + 1],
                        raised == 0.0,
                        bounds,
                        0,
                        0.0,
                        corners,
                        box,
                        margin,
                        margin,
                        scratch.work,
                    )
                    if answer != FREE:
                        return answer
    return FREE


@kernel(lean=True, nogil=True)
def check_poses(
    thing: ObjectArrays,
    boxes: BoxArrays,
    scratch: ObjectScratch,
    poses: Array,
    contact: Array,
    raised: Array,
    margin: float,
    tolerance: float,
    answers: npt.NDArray[np.int64],
) -> None:
    """Poses (n, 4, 4) with their contact planes and heights (n,); answers (n,)."""
    for i in range(poses.shape[0]):
        answers[i] = check_pose(
            thing, boxes, scratch, poses[i], contact[i], raised[i], margin, tolerance
        )
