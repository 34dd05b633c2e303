"""Compiled check of the object swept straight down onto a pose, against the obstacle set.

The sweep of a convex part is the hull of two copies. It is separated from a box by a face plane
of the part (of the upper copy where the normal points up, of the lower where it points down),
by an axis of the box, or by the distance kernel on the vertices of both copies.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.robot.collision_kernels import BoxArrays, distance_bound
from placement_planner_ros.core.robot.separation import (
    COLLIDING,
    FREE,
    TOLERANCE,
    UNDECIDED,
    separate_box,
)
from placement_planner_ros.core.robot.spheres import bounding_sphere
from placement_planner_ros.core.types import Array

if TYPE_CHECKING:
    from placement_planner_ros.core.body import ConvexPart


class ObjectArrays(NamedTuple):
    """p convex parts in the object's frame."""

    part_vertices: npt.NDArray[np.int64]
    """(p + 1,) first vertex of each part."""
    part_planes: npt.NDArray[np.int64]
    """(p + 1,) first plane of each part."""
    spheres: Array
    """(p + 1, 4) bounding ball (centre, radius) of each part, then of the object."""
    vertices: Array
    normals: Array
    offsets: Array

    @classmethod
    def of(cls, parts: Sequence[ConvexPart]) -> ObjectArrays:
        """Lay out convex parts."""
        corners = [np.ascontiguousarray(part.vertices, dtype=np.float64) for part in parts]
        every = np.ascontiguousarray(np.vstack(corners))
        balls = [bounding_sphere(c) for c in (*corners, every)]
        return cls(
            part_vertices=np.cumsum([0, *(len(c) for c in corners)], dtype=np.int64),
            part_planes=np.cumsum([0, *(len(p.offsets) for p in parts)], dtype=np.int64),
            spheres=np.array([[*center, radius + 1e-9] for center, radius in balls]),
            vertices=every,
            normals=np.ascontiguousarray(np.vstack([p.normals for p in parts]), dtype=np.float64),
            offsets=np.concatenate([p.offsets for p in parts]).astype(np.float64),
        )


class ObjectScratch(NamedTuple):
    """Work space; not shared between threads."""

    vertices: Array
    """(2 v, 3) of each part in the world, at rest then raised."""
    normals: Array
    offsets: Array
    """(planes,) of the swept part."""
    counters: npt.NDArray[np.int64]
    """(1,) number of undecided pairs."""
    work: Array
    undecided: npt.NDArray[np.int64]
    """(k, 2) part, box."""

    @classmethod
    def of(cls, arrays: ObjectArrays, rows: int) -> ObjectScratch:
        """Work space with room for `rows` undecided pairs."""
        return cls(
            vertices=np.zeros((2 * len(arrays.vertices), 3)),
            normals=np.zeros((len(arrays.normals), 3)),
            offsets=np.zeros(len(arrays.offsets)),
            counters=np.zeros(1, dtype=np.int64),
            work=np.zeros((6, 4)),
            undecided=np.zeros((rows, 2), dtype=np.int64),
        )


@njit(cache=True)
def _place_part(
    thing: ObjectArrays, scratch: ObjectScratch, part: int, T: Array, raised: float, bounds: Array
) -> None:
    """Vertices of both copies, planes and box (6,) of a swept part in the world."""
    first = thing.part_vertices[part]
    count = thing.part_vertices[part + 1] - first
    for i in range(3):
        bounds[i] = np.inf
        bounds[i + 3] = -np.inf
    for v in range(count):
        x, y, z = thing.vertices[first + v]
        for i in range(3):
            w = T[i, 3] + T[i, 0] * x + T[i, 1] * y + T[i, 2] * z
            scratch.vertices[2 * first + v, i] = w
            scratch.vertices[2 * first + count + v, i] = w + (raised if i == 2 else 0.0)
            bounds[i] = min(bounds[i], w)
            bounds[i + 3] = max(bounds[i + 3], w)
    bounds[5] += raised
    for v in range(thing.part_planes[part], thing.part_planes[part + 1]):
        x, y, z = thing.normals[v]
        offset = thing.offsets[v]
        for i in range(3):
            n = T[i, 0] * x + T[i, 1] * y + T[i, 2] * z
            scratch.normals[v, i] = n
            offset += n * T[i, 3]
        scratch.offsets[v] = offset + max(scratch.normals[v, 2], 0.0) * raised


@njit(cache=True)
def _swept_meets_box(
    thing: ObjectArrays,
    scratch: ObjectScratch,
    part: int,
    bounds: Array,
    lower: Array,
    upper: Array,
    margin: float,
) -> int:
    for i in range(3):
        if lower[i] - bounds[i + 3] >= margin + TOLERANCE or (
            bounds[i] - upper[i] >= margin + TOLERANCE
        ):
            return FREE
    cx = 0.5 * (lower[0] + upper[0])
    cy = 0.5 * (lower[1] + upper[1])
    cz = 0.5 * (lower[2] + upper[2])
    hx = upper[0] - cx
    hy = upper[1] - cy
    hz = upper[2] - cz
    best = -np.inf
    axis = -1
    for v in range(thing.part_planes[part], thing.part_planes[part + 1]):
        nx, ny, nz = scratch.normals[v, 0], scratch.normals[v, 1], scratch.normals[v, 2]
        gap = nx * cx + ny * cy + nz * cz - scratch.offsets[v]
        gap -= abs(nx) * hx + abs(ny) * hy + abs(nz) * hz
        if gap >= margin + TOLERANCE:
            return FREE
        if gap > best:
            best = gap
            axis = v
    direction = scratch.work[5]
    for i in range(3):
        direction[i] = -scratch.normals[axis, i]
    first = 2 * thing.part_vertices[part]
    return separate_box(
        scratch.vertices,
        first,
        2 * thing.part_vertices[part + 1],
        lower,
        upper,
        margin,
        margin,
        direction,
        scratch.work,
    )


@njit(cache=True)
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
    """One pose T (4, 4); pairs left UNDECIDED are noted in the scratch."""
    scratch.counters[0] = 0
    if boxes.number == 0:
        return FREE
    parts = thing.part_vertices.shape[0] - 1
    result = FREE
    bounds = np.empty(6)
    size = boxes.cell_size
    reach = margin + TOLERANCE
    for part in range(-1, parts):
        ball = thing.spheres[part]
        x = T[0, 3] + T[0, 0] * ball[0] + T[0, 1] * ball[1] + T[0, 2] * ball[2]
        y = T[1, 3] + T[1, 0] * ball[0] + T[1, 1] * ball[1] + T[1, 2] * ball[2]
        z = T[2, 3] + T[2, 0] * ball[0] + T[2, 1] * ball[1] + T[2, 2] * ball[2]
        clear = distance_bound(boxes, x, y, z + 0.5 * raised) >= ball[3] + 0.5 * raised + reach
        if part < 0:
            if clear:
                return FREE
            continue
        if clear:
            continue
        _place_part(thing, scratch, part, T, raised, bounds)
        i0 = max(int(np.floor((bounds[0] - reach - boxes.origin[0]) / size)), 0)
        j0 = max(int(np.floor((bounds[1] - reach - boxes.origin[1]) / size)), 0)
        k0 = max(int(np.floor((bounds[2] - reach - boxes.origin[2]) / size)), 0)
        i1 = min(
            int(np.floor((bounds[3] + reach - boxes.origin[0]) / size)) + 1, boxes.rows.shape[0]
        )
        j1 = min(
            int(np.floor((bounds[4] + reach - boxes.origin[1]) / size)) + 1, boxes.rows.shape[1]
        )
        k1 = min(
            int(np.floor((bounds[5] + reach - boxes.origin[2]) / size)) + 1, boxes.rows.shape[2]
        )
        for i in range(i0, i1):
            for j in range(j0, j1):
                for k in range(k0, k1):
                    box = boxes.rows[i, j, k]
                    while box >= 0:
                        if abs(boxes.upper[box, 2] - contact) > tolerance:
                            answer = _swept_meets_box(
                                thing,
                                scratch,
                                part,
                                bounds,
                                boxes.lower[box],
                                boxes.upper[box],
                                margin,
                            )
                            if answer == COLLIDING:
                                return COLLIDING
                            if answer == UNDECIDED:
                                result = UNDECIDED
                                n = scratch.counters[0]
                                if n < scratch.undecided.shape[0]:
                                    scratch.undecided[n, 0] = part
                                    scratch.undecided[n, 1] = box
                                scratch.counters[0] = n + 1
                        box = boxes.next[box]
    return result


@njit(cache=True)
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
