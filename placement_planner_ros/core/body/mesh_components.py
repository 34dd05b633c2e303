"""The connected components of a mesh, and which of them enclose a solid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from placement_planner_ros.core.types import SINGLE_ROUNDING, Array, Index, Mask

Triangles = Index


@dataclass(frozen=True, slots=True, eq=False)
class Components:
    """Triangles that share vertices, directly or through others.

    Triangles that repeat another are left out; of a mesh that has a back
    to each front, backs are, too. Triangles of open components are turned
    to agree with their neighbours where they can; closed components face outward.

    Attributes:
        corners: (t, 3, 3) metres.
        label: (t,) the component of each.
        closed: (k,) of each component whether all its edges have as many triangles one way as the
            other; what has a winding number other than 0 is inside.
    """

    corners: Array
    label: Index
    closed: Mask

    @classmethod
    def of(cls, vertices: Array, triangles: Triangles, *, weld: bool = True) -> Components:
        """Of vertices (n, 3), in metres, and triangles (t, 3).

        Args:
            weld: whether equal vertices are one; else solids that only touch stay apart.
        """
        # Equal vertices are one.
        points, faces = vertices, triangles
        if weld:
            first, kind = equal_rows((vertices / SINGLE_ROUNDING).round())
            points, faces = vertices[first], kind[triangles]
        # Repetitions are found by the smallest corner first, backs by all corners sorted.
        turn = (np.argmin(faces, axis=1)[:, None] + np.arange(3)) % 3
        faces = faces[np.sort(equal_rows(np.take_along_axis(faces, turn, axis=1))[0])]
        fronts = equal_rows(np.sort(faces, axis=1))[0]
        if 2 * len(fronts) == len(faces):
            faces = faces[np.sort(fronts)]
        # Components, and which of them are closed, once triangles that can agree do.
        label = connected_labels(faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel(), len(points))
        _, label = np.unique(label[faces[:, 0]], return_inverse=True)
        closed = _closed_components(faces, label)
        if not closed.all():
            turned = _disagreeing_triangles(faces) & ~closed[label]
            faces[turned] = faces[turned][:, [0, 2, 1]]
            closed = _closed_components(faces, label)
        # Closed ones outward.
        corners = points[faces]
        volume = np.bincount(label, volumes_under(corners - corners[:1, :1]), len(closed))
        inward = (closed & (volume < 0.0))[label]
        corners[inward] = corners[inward][:, ::-1]
        return cls(corners, label, closed)

    def pieces(self) -> list[Array]:
        """Corners (t, 3, 3) of each component."""
        order = np.argsort(self.label, kind="stable")
        first = np.searchsorted(self.label[order], np.arange(1, len(self.closed)))
        return np.split(self.corners[order], first)


def equal_rows(rows: Array | Triangles) -> tuple[Index, Index]:
    """Rows of (n, k) numbers that are equal: the first of each kind (m,), kinds in the order of
    their numbers, and the kind of each row (n,)."""
    _, first, kind = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return first, kind.ravel()  # some versions of numpy have it (n, 1)


def connected_labels(ends: Index, others: Index, count: int) -> Index:
    """(count,) the same number for all nodes that edges between ends and others (e,) connect."""
    graph = coo_array((np.ones(len(ends), np.int8), (ends, others)), (count, count))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def volumes_under(corners: Array) -> Array:
    """(t,) m³ of tetrahedra from the origin to triangles (t, 3, 3), negative where they face it."""
    return np.asarray(np.linalg.det(corners) / 6.0)


def _edges_of(faces: Triangles) -> tuple[Index, Index]:
    """(3 t,) the edge that each side of triangles (t, 3) is, and 1 or -1, its way along it."""
    sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    return equal_rows(np.sort(sides, axis=1))[1], np.sign(sides[:, 1] - sides[:, 0])


def _closed_components(faces: Triangles, label: Index) -> Mask:
    """(k,) components whose edges have as many triangles one way as the other."""
    edge, way = _edges_of(faces)
    surplus = np.bincount(edge, way)[edge].reshape(-1, 3)
    closed = np.ones(int(label.max(initial=-1)) + 1, np.bool_)
    closed[label[surplus.any(axis=1)]] = False
    return closed


def _disagreeing_triangles(faces: Triangles) -> Mask:
    """(t,) which triangles to turn over, so that all agree with their neighbours across edges of
    two triangles; none where that cannot be."""
    edge, way = _edges_of(faces)
    sides = np.flatnonzero(np.bincount(edge)[edge] == 2)
    first, second = sides[np.argsort(edge[sides], kind="stable")].reshape(-1, 2).T
    # Each triangle is two nodes, itself and itself turned; those that agree are connected.
    count = len(faces)
    differ = np.where(way[first] == way[second], count, 0)
    ends = np.concatenate([first // 3, first // 3 + count])
    others = np.concatenate([second // 3 + differ, second // 3 + count - differ])
    side = connected_labels(ends, others, 2 * count)
    return np.asarray(side[:count] > side[count:])
