"""Exact distances of points from the triangles of a mesh, and whether these enclose them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from placement_planner_ros.core.collision.against_mesh import winding_number
from placement_planner_ros.core.collision.meshes import MeshArrays, MeshTree, mesh_arrays
from placement_planner_ros.core.types import Array, Index
from placement_planner_ros.core.uncounted import Uncounted


@dataclass(frozen=True, slots=True, eq=False)
class SolidSurface:
    """The triangles of one mesh, and what lies within a radius of them.

    Attributes:
        mesh: its arrays; a triangle may be a line or a point.
        radius: metres that the solid reaches beyond the triangles everywhere.
    """

    mesh: MeshArrays
    radius: float = 0.0

    @classmethod
    def of(cls, corners: Array, radius: float = 0.0) -> SolidSurface:
        """Of triangles (t, 3, 3), at least one; components that are closed have an inside."""
        rows = np.arange(3 * len(corners)).reshape(-1, 3)
        return cls(mesh_arrays([MeshTree.of(corners.reshape(-1, 3), rows)]), radius)

    @property
    def box(self) -> tuple[Array, Array]:
        """Lower and upper corner (3,) of the box around it, metres."""
        return self.mesh.boxes[0, :3] - self.radius, self.mesh.boxes[0, 3:] + self.radius

    def distances(self, points: Array, cap: float) -> tuple[Array, Array]:
        """How far points (n, 3) are from the solid's surface, negative inside, and where it is.

        Returns:
            (n,) metres, infinite from `cap` on, -infinite as deep inside; (n, 3) the nearest point
            of it, NaN where that is so, and what lies on a triangle itself.
        """
        found, nearest = np.empty(len(points)), np.full((len(points), 3), np.nan)
        given = np.ascontiguousarray(points, dtype=np.float64)
        _signed_distances(given, self.mesh, cap + self.radius, found, nearest)
        # from the triangles on, by the radius outwards
        nearest += (given - nearest) * (self.radius / np.where(found == 0.0, 1.0, found))[:, None]
        return found - self.radius, nearest


@njit(cache=True, nogil=True)
def _signed_distances(
    points: Array, mesh: MeshArrays, cap: float, found: Array, nearest: Array
) -> None:
    """Fill `found` (n,) and `nearest` (n, 3), see `SolidSurface.distances`."""
    inner = len(mesh.boxes) // 2
    waiting = np.empty(2 + int(np.log2(len(mesh.boxes))), np.int64)  # one of each level, and one
    spot = np.empty(3)
    for i in range(len(points)):
        point = points[i]
        best = cap * cap
        waiting[0], count = 0, 1
        while count > 0:
            # The nearest triangle is in no box that is farther away than one already found.
            count -= 1
            node = waiting[count]
            if _squared_from_box(mesh.boxes[node], point) >= best:
                continue
            if node < inner:
                # Of the two nodes below, the nearer one comes first.
                near, far = 2 * node + 1, 2 * node + 2
                if _squared_from_box(mesh.boxes[far], point) < _squared_from_box(
                    mesh.boxes[near], point
                ):
                    near, far = far, near
                waiting[count], waiting[count + 1] = far, near
                count += 2
                continue
            # The triangles of a leaf, one by one.
            for t in range(mesh.leaves[node - inner], mesh.leaves[node - inner + 1]):
                away = _squared_from_triangle(mesh.corners[3 * t : 3 * t + 3], point, spot)
                if away < best:
                    best = away
                    for m in range(3):
                        nearest[i, m] = spot[m]
        found[i] = np.sqrt(best) if best < cap * cap else np.inf
        if winding_number(mesh, 0, point[0], point[1], point[2]) > 0:
            found[i] = -found[i]


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _squared_from_box(box: Array, point: Array) -> float:
    """Squared distance of a point (3,) from a box (6,)."""
    # How far outside along each axis.
    total = 0.0
    for k in range(3):
        away = max(box[k] - point[k], point[k] - box[k + 3], 0.0)
        total += away * away
    return total


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _squared_from_triangle(corners: Array, point: Array, spot: Array) -> float:
    """Squared distance of a point (3,) from a triangle (3, 3), written with its nearest point."""
    # The point in the triangle's plane: a + (s u + t v) / area, with u and v the sides from a.
    uu = uv = vv = wu = wv = 0.0
    for m in range(3):
        u, v = corners[1, m] - corners[0, m], corners[2, m] - corners[0, m]
        w = point[m] - corners[0, m]
        uu, uv, vv, wu, wv = uu + u * u, uv + u * v, vv + v * v, wu + w * u, wv + w * v
    area, s, t = uu * vv - uv * uv, wu * vv - wv * uv, wv * uu - wu * uv
    if s > 0.0 and t > 0.0 and s + t < area and area > 1e-12 * uu * vv:
        # Straight above the triangle, which is no needle: nothing of it is nearer.
        best = 0.0
        for m in range(3):
            u, v = corners[1, m] - corners[0, m], corners[2, m] - corners[0, m]
            spot[m] = corners[0, m] + (s * u + t * v) / area
            best += (point[m] - spot[m]) ** 2
        return best
    best = np.inf
    for k in range(3):
        # The nearest point of each edge.
        length = along = apart = 0.0
        for m in range(3):
            edge = corners[(k + 1) % 3, m] - corners[k, m]
            length += edge * edge
            along += (point[m] - corners[k, m]) * edge
        share = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
        for m in range(3):
            edge = corners[(k + 1) % 3, m] - corners[k, m]
            apart += (point[m] - corners[k, m] - share * edge) ** 2
        if apart < best:
            best = apart
            for m in range(3):
                spot[m] = corners[k, m] + share * (corners[(k + 1) % 3, m] - corners[k, m])
    return best


@njit(cache=True, nogil=True)
def rows_in_boxes(points: Array, boxes: Array) -> Index:
    """Rows of points (n, 3) in any of (k, 2, 3) boxes, of which middle and half sides are given."""
    rows = np.empty(len(points), np.int64)
    count = 0
    # A box around all of them first.
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
        # The first box that holds it.
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
