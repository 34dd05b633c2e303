"""How far points are from a surface of triangles, and whether it encloses them: exact, for many
points at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted

TRIANGLES_IN_LEAF = 4
"""Triangles of a leaf."""
BITS_OF_PLACE = 10
"""Of a triangle's place along each axis, by which the leaves are ordered."""
MAX_WAITING = 64
"""Nodes that wait at most: a tree of 2^30 leaves has as many levels as half of that."""
_WAYS = np.array([[0.5477, 0.2739, 0.7906], [-0.3244, 0.8111, -0.4867]])
"""(2, 3) directions of the lines that tell inside from outside; along no axis, as edges are."""


Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class TriangleTree:
    """Triangles in a binary tree of boxes: node i holds what nodes 2 i and 2 i + 1 do; 1 is all.

    Attributes:
        corners: (t, 3, 3) metres, in the order of the leaves; a triangle may be a line or a point.
        boxes: (2 k, 6) lower and upper corner of each node, metres; leaf j is node k + j.
        radius: metres that the solid reaches beyond the triangles everywhere.
        closed: whether the triangles enclose a solid.
    """

    corners: Array
    boxes: Array
    radius: float
    closed: bool

    @classmethod
    def of(cls, corners: Array, closed: bool, radius: float = 0.0) -> TriangleTree:
        """Of triangles (t, 3, 3), at least one; where they are closed, those of each component
        wound alike."""
        middles = corners.mean(axis=1)
        low = middles.min(axis=0)
        size = np.maximum(np.ptp(middles, axis=0), np.finfo(float).tiny)
        places = ((middles - low) / size * ((1 << BITS_OF_PLACE) - 1)).astype(np.int64)
        order = np.argsort(_interleaved_bits(places), kind="stable")
        leaves = 1 << int(np.ceil(np.log2(-(-len(corners) // TRIANGLES_IN_LEAF))))
        sorted_ = np.ascontiguousarray(corners[order], dtype=np.float64)
        boxes = np.empty((2 * leaves, 6))
        boxes[:, :3], boxes[:, 3:] = np.inf, -np.inf
        first = np.arange(0, len(sorted_), TRIANGLES_IN_LEAF)
        rows = slice(leaves, leaves + len(first))
        boxes[rows, :3] = np.minimum.reduceat(sorted_.min(axis=1), first)
        boxes[rows, 3:] = np.maximum.reduceat(sorted_.max(axis=1), first)
        while leaves > 1:
            leaves //= 2
            pairs = boxes[2 * leaves : 4 * leaves].reshape(-1, 2, 6)
            boxes[leaves : 2 * leaves, :3] = pairs[:, :, :3].min(axis=1)
            boxes[leaves : 2 * leaves, 3:] = pairs[:, :, 3:].max(axis=1)
        return cls(sorted_, boxes, radius, closed)

    def distances(self, points: Array, cap: float) -> tuple[Array, Array]:
        """How far points (n, 3) are from the solid's surface, negative inside, and where it is.

        Returns:
            (n,) metres, infinite from `cap` on, -infinite as deep inside; (n, 3) the nearest point
            of the triangles, NaN where that is so.
        """
        found, nearest = np.empty(len(points)), np.full((len(points), 3), np.nan)
        _signed_distances(
            np.ascontiguousarray(points, dtype=np.float64),
            self.corners,
            self.boxes,
            cap + self.radius,
            self.closed,
            _WAYS,
            found,
            nearest,
        )
        return found - self.radius, nearest


def _interleaved_bits(places: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """(n,) the bits of (n, 3) numbers in turn: what is near each other has numbers alike."""
    mixed = np.zeros(len(places), np.int64)
    for bit in range(BITS_OF_PLACE):
        for axis in range(3):
            mixed |= ((places[:, axis] >> bit) & 1) << (3 * bit + axis)
    return mixed


@njit(cache=True, nogil=True)
def _signed_distances(
    points: Array,
    corners: Array,
    boxes: Array,
    cap: float,
    closed: bool,
    ways: Array,
    found: Array,
    nearest: Array,
) -> None:
    """Fill `found` (n,) and `nearest` (n, 3), see `TriangleTree.distances`."""
    leaves = boxes.shape[0] // 2
    waiting = np.empty(MAX_WAITING, np.int64)
    spot = np.empty(3)
    for i in range(points.shape[0]):
        point = points[i]
        best = cap * cap
        waiting[0], count = 1, 1
        while count > 0:
            # the nearest triangle is in no box that is farther away than one already found
            count -= 1
            node = waiting[count]
            if _squared_from_box(boxes[node], point) >= best:
                continue
            if node < leaves:
                near, far = 2 * node, 2 * node + 1
                if _squared_from_box(boxes[far], point) < _squared_from_box(boxes[near], point):
                    near, far = far, near
                waiting[count], waiting[count + 1] = far, near
                count += 2
                continue
            first = (node - leaves) * TRIANGLES_IN_LEAF
            for t in range(first, min(first + TRIANGLES_IN_LEAF, corners.shape[0])):
                away = _from_triangle(corners[t], point, spot)
                if away < best:
                    best = away
                    for k in range(3):
                        nearest[i, k] = spot[k]
        found[i] = np.sqrt(best) if best < cap * cap else np.inf
        if closed and _squared_from_box(boxes[1], point) == 0.0:
            # inside is where a line to infinity leaves the surface more often than it enters
            inside = True
            for w in range(ways.shape[0]):
                if inside and _signed_crossings(corners, boxes, point, ways[w], waiting) == 0:
                    inside = False
            if inside:
                found[i] = -found[i]


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _squared_from_box(box: Array, point: Array) -> float:
    """Squared distance of a point (3,) from a box (6,)."""
    total = 0.0
    for k in range(3):
        away = max(box[k] - point[k], point[k] - box[k + 3], 0.0)
        total += away * away
    return total


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _vector_from(point: Array, corner: Array) -> Vector:
    """The way from a point (3,) to a corner (3,)."""
    return corner[0] - point[0], corner[1] - point[1], corner[2] - point[2]


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _dot_product(u: Vector, v: Vector) -> float:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _cross_product(u: Vector, v: Vector) -> Vector:
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _from_triangle(corners: Array, point: Array, spot: Array) -> float:
    """Squared distance of a point (3,) from a triangle (3, 3), written with its nearest point."""
    normal = _cross_product(
        _vector_from(corners[0], corners[1]), _vector_from(corners[0], corners[2])
    )
    area = _dot_product(normal, normal)
    inside = area > 0.0
    best = np.inf
    for k in range(3):
        # the nearest point of each edge, and whether the triangle is on the point's side of it
        edge, away = _vector_from(corners[k], corners[(k + 1) % 3]), _vector_from(corners[k], point)
        inside = inside and _dot_product(_cross_product(edge, away), normal) >= 0.0
        length = _dot_product(edge, edge)
        share = min(max(_dot_product(edge, away) / length, 0.0), 1.0) if length > 0.0 else 0.0
        apart = 0.0
        for m in range(3):
            apart += (away[m] - share * edge[m]) ** 2
        if apart < best:
            best = apart
            for m in range(3):
                spot[m] = corners[k, m] + share * edge[m]
    if inside:
        # straight above the triangle, so that its plane is nearer than its edges
        height = _dot_product(_vector_from(corners[0], point), normal) / area
        for m in range(3):
            spot[m] = point[m] - height * normal[m]
        best = height * height * area
    return best


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _signed_crossings(
    corners: Array, boxes: Array, point: Array, way: Array, waiting: npt.NDArray[np.int64]
) -> int:
    """How often a line from a point (3,) along `way` leaves a surface, less how often it enters."""
    leaves = boxes.shape[0] // 2
    line = (way[0], way[1], way[2])
    total = 0
    waiting[0], count = 1, 1
    while count > 0:
        count -= 1
        node = waiting[count]
        # the piece of the line that is within the box along each axis
        enters, ends = 0.0, np.inf
        for k in range(3):
            low = (boxes[node, k] - point[k]) / way[k]
            high = (boxes[node, k + 3] - point[k]) / way[k]
            enters, ends = max(enters, min(low, high)), min(ends, max(low, high))
        if enters > ends:
            continue
        if node < leaves:
            waiting[count], waiting[count + 1] = 2 * node, 2 * node + 1
            count += 2
            continue
        first = (node - leaves) * TRIANGLES_IN_LEAF
        for t in range(first, min(first + TRIANGLES_IN_LEAF, corners.shape[0])):
            # the line passes all three edges on the same side, and the plane ahead of the point
            a, b, c = (
                _vector_from(point, corners[t, 0]),
                _vector_from(point, corners[t, 1]),
                _vector_from(point, corners[t, 2]),
            )
            ab, bc, ca = (
                _dot_product(line, _cross_product(a, b)),
                _dot_product(line, _cross_product(b, c)),
                _dot_product(line, _cross_product(c, a)),
            )
            same = (ab >= 0.0 and bc >= 0.0 and ca >= 0.0) or (ab < 0.0 and bc < 0.0 and ca < 0.0)
            volume = ab + bc + ca
            if same and volume != 0.0 and _dot_product(a, _cross_product(b, c)) / volume > 0.0:
                total += 1 if volume > 0.0 else -1
    return total


@njit(cache=True, nogil=True)
def rows_in_boxes(points: Array, boxes: Array) -> npt.NDArray[np.int64]:
    """Rows of points (n, 3) in any of (k, 2, 3) boxes, of which middle and half sides are given."""
    rows = np.empty(len(points), np.int64)
    count = 0
    # a box around all of them first
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for b in range(len(boxes)):
        for a in range(3):
            low[a] = min(low[a], boxes[b, 0, a] - boxes[b, 1, a])
            high[a] = max(high[a], boxes[b, 0, a] + boxes[b, 1, a])
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        within = low[0] <= x <= high[0] and low[1] <= y <= high[1] and low[2] <= z <= high[2]
        if not within:  # also where a coordinate is NaN
            continue
        for b in range(len(boxes)):
            if (
                abs(x - boxes[b, 0, 0]) <= boxes[b, 1, 0]
                and abs(y - boxes[b, 0, 1]) <= boxes[b, 1, 1]
                and abs(z - boxes[b, 0, 2]) <= boxes[b, 1, 2]
            ):
                rows[count] = p
                count += 1
                break
    return rows[:count]
