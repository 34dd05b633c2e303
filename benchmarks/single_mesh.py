"""Closed surfaces made in one piece, as a scan or a CAD file has them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.types import Array
from placement_planner_ros.scenes.primitives import circle

Triangles = npt.NDArray[np.int64]


def turned(rings: Sequence[tuple[float, float]], sides: int) -> tuple[Array, Triangles]:
    """What a profile encloses that is turned about z: (n, 3), (t, 3), facing outward.

    Args:
        rings: heights and radii, from below to above; both ends are closed by a disk.
        sides: of the polygons that stand for circles.
    """
    circles = [circle(radius, height, sides) for height, radius in rings]
    ends = [[0.0, 0.0, rings[0][0]], [0.0, 0.0, rings[-1][0]]]
    return np.vstack([*circles, ends]), ring_triangles(len(rings), sides)


def joined_boxes(boxes: Sequence[tuple[Array, Array]]) -> tuple[Array, Triangles]:
    """The surface of the union of axis-aligned boxes (lower (3,), upper (3,)): (n, 3), (t, 3).

    No two of them may touch along an edge or in a corner alone.
    """
    ticks = [
        np.unique(np.round([corner[axis] for box in boxes for corner in box], 9))
        for axis in range(3)
    ]
    middles = np.stack(
        np.meshgrid(*[0.5 * (tick[1:] + tick[:-1]) for tick in ticks], indexing="ij"), axis=-1
    )
    filled = np.zeros(middles.shape[:3], np.bool_)
    for lower, upper in boxes:
        filled |= ((middles > lower) & (middles < upper)).all(axis=-1)
    filled = np.pad(filled, 1)
    corners: list[Array] = []
    for axis in range(3):
        # Around the axis, so that what faces along it is counter-clockwise.
        u, v = (axis + 1) % 3, (axis + 2) % 3
        step = np.diff(filled.astype(int), axis=axis)
        for cell in np.argwhere(step != 0):
            outward = step[tuple(cell)] < 0
            at = np.array(cell) - 1
            at[axis] += 1
            square = np.repeat(at[None], 4, axis=0)
            square[[1, 2], u] += 1
            square[[2, 3], v] += 1
            points = np.column_stack([ticks[k][square[:, k]] for k in range(3)])
            corners.append(points if outward else points[::-1])
    squares = np.array(corners)
    vertices, index = np.unique(squares.reshape(-1, 3), axis=0, return_inverse=True)
    rows = index.reshape(-1, 4)
    return vertices, np.vstack([rows[:, [0, 1, 2]], rows[:, [0, 2, 3]]]).astype(np.int64)


def tube(path: Array, radii: Array, sides: int) -> tuple[Array, Triangles]:
    """What rings about points of the plane y = 0 enclose: (n, 3), (t, 3), facing outward.

    Args:
        path: (k, 3) the rings' middles.
        radii: (k,) metres.
        sides: of the polygons that stand for rings, which lie across the path. Ring i has the
            vertices i·sides and on; both ends are closed by a disk.
    """
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    y = np.array([0.0, 1.0, 0.0])
    across = np.cross(y, along)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    spokes = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * y
    rings = path[:, None] + radii[:, None, None] * spokes
    return np.vstack([rings.reshape(-1, 3), path[:1], path[-1:]]), ring_triangles(len(path), sides)


def ring_triangles(rings: int, sides: int) -> Triangles:
    """(t, 3) outward triangles of rings of so many vertices each, one after the other, closed by
    fans around the first ring's middle and the last one's, which follow them."""
    i = np.arange(sides)
    j = (i + 1) % sides
    faces = []
    for ring in range(rings - 1):
        low, high = ring * sides, (ring + 1) * sides
        faces.append(np.column_stack([low + i, low + j, high + j]))
        faces.append(np.column_stack([low + i, high + j, high + i]))
    middle, last = rings * sides, (rings - 1) * sides
    faces.append(np.column_stack([np.full(sides, middle), j, i]))
    faces.append(np.column_stack([np.full(sides, middle + 1), last + i, last + j]))
    return np.vstack(faces)
