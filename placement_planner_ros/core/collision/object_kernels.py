"""Compiled check of the object swept straight down onto a pose, against the obstacle set.

The sweep of a convex part is the hull of two copies. It is separated from a box by a face plane
of the part (of the upper copy where the normal points up, of the lower where it points down),
by an axis of the box, or by the distance kernel on the vertices of both copies. Parts that cover a
mesh only say what is free; for the rest, what a mesh sweeps upward meets a box where the mesh
itself meets what the box sweeps downward, which is a box again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.collision.against_boxes import (
    BoxArrays,
    SetRows,
    SetsInWorld,
    boxes_apart,
    distance_bounds,
    layer_range,
    polytope_meets_box,
)
from placement_planner_ros.core.collision.against_mesh import box_corner, mesh_meets_hull
from placement_planner_ros.core.collision.meshes import MeshArrays, mesh_arrays
from placement_planner_ros.core.collision.separation import BOUND_TOLERANCE_M, FREE
from placement_planner_ros.core.collision.shapes import ConvexSet, Shape
from placement_planner_ros.core.collision.spheres import bounding_sphere
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted


class ObjectArrays(NamedTuple):
    """p convex parts in the object's frame, the last of which cover the mesh."""

    part_vertices: npt.NDArray[np.int64]
    """(p + 1,) first vertex of each part."""
    part_planes: npt.NDArray[np.int64]
    """(p + 1,) first plane of each part."""
    spheres: Array
    """(p + 1, 4) bounding ball (centre, radius) of each part, then of the object."""
    vertices: Array
    planes: Array
    """(f, 4) normal and offset."""
    solids: int
    """How many of the parts, the first, are what they are."""
    mesh: MeshArrays
    """The mesh that the others cover, or none."""

    @classmethod
    def of(cls, parts: Sequence[ConvexSet], covered: Shape | None = None) -> ObjectArrays:
        """Lay out convex parts, and a mesh with its cover."""
        solids, trees = len(parts), []
        if covered is not None and covered.mesh is not None:
            parts, trees = [*parts, *covered.sets], [covered.mesh]
        corners = [np.ascontiguousarray(part.vertices, dtype=np.float64) for part in parts]
        every = np.ascontiguousarray(np.vstack(corners))
        balls = [bounding_sphere(c) for c in (*corners, every)]
        return cls(
            part_vertices=np.cumsum([0, *(len(c) for c in corners)], dtype=np.int64),
            part_planes=np.cumsum([0, *(len(p.offsets) for p in parts)], dtype=np.int64),
            spheres=np.array([[*center, radius + 1e-9] for center, radius in balls]),
            vertices=every,
            planes=np.vstack([np.column_stack([p.normals, p.offsets]) for p in parts]),
            solids=solids,
            mesh=mesh_arrays(trees),
        )


class PoseMargins(NamedTuple):
    """What is to be kept at a pose, metres."""

    margin: float
    """From what stands beside or above."""
    beneath: float
    """From what lies beneath it; infinite where that is as from all else."""
    under: float
    """The same from a level contact plane; infinite where it slopes."""
    tolerance: float
    """Boxes whose top is as near as that to the height of the contact plane are support."""


class SweptPoses(NamedTuple):
    """Poses that the object is swept straight down onto, over contact planes of one slope."""

    T: Array
    """(n, 4, 4) T_world_object at rest."""
    contact: Array
    """(n,) heights of the contact planes at x = y = 0, metres."""
    raised: Array
    """(n,) how far above the pose the sweep begins, metres."""
    tops: Array
    """(m,) heights of the boxes above the plane through the origin that is parallel to these."""


class ObjectScratch(NamedTuple):
    """Work space; not shared between threads."""

    vertices: Array
    """(2 v, 3) of each part in the world, at rest then raised."""
    planes: Array
    """(f, 4) of the swept parts."""
    bounds: Array
    """(p, 6) box around each swept part, lower then upper corner."""
    work: Array
    box: Array
    """(8, 3) corners of a swept box in the object's frame."""
    seen: npt.NDArray[np.int64]
    """(m,) pose at which an obstacle was last found free of the mesh, and the number of poses."""

    @classmethod
    def of(cls, arrays: ObjectArrays, boxes: int) -> ObjectScratch:
        """Work space for one object among so many boxes."""
        return cls(
            vertices=np.zeros((2 * len(arrays.vertices), 3)),
            planes=np.zeros((len(arrays.planes), 4)),
            bounds=np.zeros((len(arrays.part_planes) - 1, 6)),
            work=np.zeros((6, 4)),
            box=np.zeros((8, 3)),
            seen=np.zeros(boxes + 1, dtype=np.int64),
        )


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _place_part(
    thing: ObjectArrays, scratch: ObjectScratch, part: int, T: Array, raised: float
) -> None:
    """Vertices of both copies, planes and box of a swept part in the world."""
    # Where the rows of this part begin.
    first = thing.part_vertices[part]
    count = thing.part_vertices[part + 1] - first
    vertices, planes, bounds = scratch.vertices, scratch.planes, scratch.bounds
    # One coordinate of all vertices, at rest and raised, and the span of both.
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
        bounds[part, i] = low
        bounds[part, i + 3] = high
    # Face planes: the normal turned, the offset moved; those that face up belong to the raised
    # copy.
    for v in range(thing.part_planes[part], thing.part_planes[part + 1]):
        offset = thing.planes[v, 3]
        for i in range(3):
            n = 0.0
            for j in range(3):
                n += T[i, j] * thing.planes[v, j]
            planes[v, i] = n
            offset += n * T[i, 3]
        planes[v, 3] = offset + max(planes[v, 2], 0.0) * raised


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _mesh_meets_box(
    thing: ObjectArrays,
    scratch: ObjectScratch,
    pose: tuple[Array, float],
    corners: Array,
    b: int,
    margin: float,
) -> int:
    """The swept mesh against box b of `corners` (m, 6)."""
    # Corners of the box, swept downward instead of the mesh upward, in the object's frame.
    T, raised = pose
    box = scratch.box
    for row in range(8):
        x, y, z = box_corner(corners, b, row)
        dx, dy, dz = x - T[0, 3], y - T[1, 3], z - T[2, 3]
        if row & 4 == 0:
            dz -= raised
        for i in range(3):
            box[row, i] = T[0, i] * dx + T[1, i] * dy + T[2, i] * dz
    # The mesh as it is against the hull of these corners.
    return mesh_meets_hull(thing.mesh, 0, box, 8, margin, margin, scratch.work)


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _part_meets_boxes(
    thing: ObjectArrays,
    boxes: BoxArrays,
    scratch: ObjectScratch,
    part: int,
    poses: SweptPoses,
    row: int,
    margins: PoseMargins,
) -> int:
    """A swept part, placed, against the boxes of all cells that the box around it touches.

    FREE, or the answer to the first box that is not.
    """
    # Columns and layers of the cells that the box around the part touches, the margin added.
    corners, columns, tops = boxes.corners, boxes.columns, poses.tops
    T, contact, raised = poses.T[row], poses.contact[row], poses.raised[row]
    ox, oy, oz, size = boxes.grid[0], boxes.grid[1], boxes.grid[2], boxes.grid[3]
    margin = margins.margin
    reach = margin + BOUND_TOLERANCE_M
    box = scratch.bounds[part]
    i0 = max(int(np.floor((box[0] - reach - ox) / size)), 0)
    j0 = max(int(np.floor((box[1] - reach - oy) / size)), 0)
    k0 = int(np.floor((box[2] - reach - oz) / size))
    i1 = min(int(np.floor((box[3] + reach - ox) / size)) + 1, columns.shape[0])
    j1 = min(int(np.floor((box[4] + reach - oy) / size)) + 1, columns.shape[1] - 1)
    k1 = int(np.floor((box[5] + reach - oz) / size)) + 1
    # The part as a convex set: both copies' vertices, and the planes placed, which enclose what it
    # sweeps and more, but for a part that stays.
    world = SetsInWorld(scratch.vertices, scratch.planes, scratch.bounds, scratch.work)
    rows = SetRows(
        2 * thing.part_vertices[part],
        2 * thing.part_vertices[part + 1],
        thing.part_planes[part],
        thing.part_planes[part + 1],
        part,
        0.0,
        raised == 0.0,
    )
    for i in range(i0, i1):
        for j in range(j0, j1):
            first, last = layer_range(boxes.layers, columns[i, j], columns[i, j + 1], k0, k1)
            for b in range(first, last):
                # Boxes that end at the contact plane are support.
                if abs(tops[b] - contact) <= margins.tolerance or boxes_apart(
                    scratch.bounds, part, corners, b, margin
                ):
                    continue
                # parts of a cover may reach below the contact plane, the object does not
                if box[2] - corners[b, 5] >= margins.beneath or contact - tops[b] >= margins.under:
                    continue
                # This box has been found free of the mesh at this pose.
                if part >= thing.solids and scratch.seen[b] == scratch.seen[-1]:
                    continue
                # The swept convex part, then the mesh where a cover leaves the box open.
                answer = polytope_meets_box(world, rows, corners, b, margin, margin)
                if answer != FREE and part >= thing.solids:
                    answer = _mesh_meets_box(thing, scratch, (T, raised), corners, b, margin)
                    scratch.seen[b] = scratch.seen[-1]
                if answer != FREE:
                    return answer
    return FREE


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _ball_clear(boxes: BoxArrays, ball: Array, T: Array, raised: float, margin: float) -> bool:
    """Whether a ball (4,) in the object's frame, swept, surely keeps the margin from all boxes.

    What it sweeps lies in the ball around the sweep's middle that is larger by half its height.
    """
    # The ball's centre in the world.
    x = T[0, 3] + T[0, 0] * ball[0] + T[0, 1] * ball[1] + T[0, 2] * ball[2]
    y = T[1, 3] + T[1, 0] * ball[0] + T[1, 1] * ball[1] + T[1, 2] * ball[2]
    z = T[2, 3] + T[2, 0] * ball[0] + T[2, 1] * ball[1] + T[2, 2] * ball[2]
    # The distance of the sweep's middle, against the ball grown by half the sweep.
    bound, _ = distance_bounds(boxes.field_grid, boxes.field, x, y, z + 0.5 * raised)
    return bound >= ball[3] + 0.5 * raised + (margin + BOUND_TOLERANCE_M)


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _check_pose(
    thing: ObjectArrays,
    boxes: BoxArrays,
    scratch: ObjectScratch,
    poses: SweptPoses,
    row: int,
    margins: PoseMargins,
) -> int:
    """Whether the object keeps the margin on its way straight down onto one of the poses.

    Balls around the object and around each part against the field of distances, then the swept
    parts against boxes. The answer is that of the first pair of part and box that is not FREE.
    """
    # The ball around all of the object.
    T, raised = poses.T[row], poses.raised[row]
    parts = thing.part_vertices.shape[0] - 1
    if boxes.number == 0 or _ball_clear(boxes, thing.spheres[parts], T, raised, margins.margin):
        return FREE
    # Another pose: no box has been seen free of the mesh at it.
    scratch.seen[-1] += 1
    # Part by part: the ball around it, then its planes and vertices.
    for part in range(parts):
        if _ball_clear(boxes, thing.spheres[part], T, raised, margins.margin):
            continue
        _place_part(thing, scratch, part, T, raised)
        answer = _part_meets_boxes(thing, boxes, scratch, part, poses, row, margins)
        if answer != FREE:
            return answer
    return FREE


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def check_poses(
    thing: ObjectArrays,
    boxes: BoxArrays,
    scratch: ObjectScratch,
    poses: SweptPoses,
    margins: PoseMargins,
    answers: npt.NDArray[np.int64],
) -> None:
    """The answers (n,) to poses, each with its own contact height and its own sweep."""
    for row in range(len(answers)):
        answers[row] = _check_pose(thing, boxes, scratch, poses, row, margins)
