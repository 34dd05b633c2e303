"""The connected components of a mesh, and which of them enclose a solid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from placement_planner_ros.core.types import Array

WELD_M = 1e-9
"""m within which vertices are one: rounding."""

Triangles = npt.NDArray[np.int64]
Labels = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Components:
    """Triangles that share vertices, directly or through others.

    Repetitions are left out. Triangles of a component in which every edge has two are turned to
    agree, where they do not and can.

    Attributes:
        corners: (t, 3, 3) metres.
        rows: (t,) which of the mesh's triangles they are.
        label: (t,) the component of each.
        closed: (k,) of each component whether all its edges have as many triangles one way as the
            other; what has a winding number other than 0 is inside.
    """

    corners: Array
    rows: Labels
    label: Labels
    closed: Mask

    @classmethod
    def of(cls, vertices: Array, triangles: Triangles, *, weld: bool = True) -> Components:
        """Of vertices (n, 3), in metres, and triangles (t, 3).

        Args:
            weld: whether equal vertices are one.
        """
        # Vertices welded, repetitions left out, components told apart.
        faces, points = triangles, vertices
        if weld:
            first, welded = equal_rows((vertices / WELD_M).round())
            faces, points = welded[triangles], vertices[first]
        rows = _rows_without_repetitions(faces)
        faces = faces[rows]
        label = _component_labels(faces, len(points))
        count = int(label.max()) + 1 if len(label) else 0
        # Where edges do not agree, some triangles may be wound the other way.
        sides = _Sides.of(faces)
        closed = sides.balanced(label, count)
        if not closed.all():
            turned = sides.that_turn(faces, label, ~closed)
            faces[turned] = faces[turned][:, [0, 2, 1]]
            closed = sides.turned(turned).balanced(label, count)
        return cls(points[faces], rows, label, closed)


def _rows_without_repetitions(faces: Triangles) -> Labels:
    """Rows of the triangles that do not repeat one before them."""
    # The smallest first, the others in their turn: triangles that face the other way stay.
    turn = (np.argmin(faces, axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(faces, turn, axis=1).T
    count = int(faces.max(initial=0)) + 1
    _, both = np.unique(a * count + b, return_inverse=True)  # numbers that their product holds
    _, first = np.unique(both.reshape(-1) * count + c, return_index=True)
    return np.sort(first)


def equal_rows(rows: Array | Triangles) -> tuple[Labels, Labels]:
    """Rows of (n, k) numbers that are equal: the first of each kind (m,), kinds in the order of
    their numbers, and the kind of each row (n,).

    numpy's unique says the same, but compares rows as bytes, which takes five times as long.
    """
    # By the first column; only rows that are equal there by the others.
    order = np.argsort(rows[:, 0], kind="stable")
    same = rows[order[1:], 0] == rows[order[:-1], 0]
    tied = np.append(same, False) | np.append(False, same)
    if tied.any():
        some = order[tied]
        order[tied] = some[np.lexsort(rows[some].T[::-1])]
    # Where a row differs from the one before a kind begins.
    new = np.ones(len(rows), np.bool_)
    new[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    kind = np.empty(len(rows), np.int64)
    kind[order] = np.cumsum(new) - 1
    return order[new], kind


def _component_labels(faces: Triangles, count: int) -> Labels:
    # A graph of vertices, with two sides of each triangle.
    ends = faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    graph = coo_array((np.ones(len(ends), np.int8), (ends[:, 0], ends[:, 1])), (count, count))
    _, of_vertex = connected_components(graph, directed=False)
    _, label = np.unique(of_vertex[faces[:, 0]], return_inverse=True)
    return np.asarray(label.reshape(-1), np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class _Sides:
    """The sides of triangles.

    Attributes:
        edge: (t, 3) the edge that each is.
        way: (t, 3) 1 or -1, whether it runs that way or the other.
    """

    edge: Labels
    way: Labels

    @classmethod
    def of(cls, faces: Triangles) -> _Sides:
        sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        keys = sides.min(axis=1) * (int(faces.max(initial=0)) + 1) + sides.max(axis=1)
        _, edge = np.unique(keys, return_inverse=True)
        way = np.sign(sides[:, 1] - sides[:, 0])
        return cls(edge.reshape(-1, 3), way.reshape(-1, 3))

    def turned(self, rows: Labels) -> _Sides:
        """Of the same triangles, of which some are turned over."""
        edge, way = self.edge.copy(), self.way.copy()
        edge[rows], way[rows] = edge[rows][:, ::-1], -way[rows][:, ::-1]
        return _Sides(edge, way)

    def balanced(self, label: Labels, count: int) -> Mask:
        """(k,) components whose edges have as many triangles one way as the other."""
        closed = np.ones(count, np.bool_)
        # How many more triangles run along each edge one way.
        surplus = np.bincount(self.edge.ravel(), self.way.ravel())
        closed[label[(surplus[self.edge] != 0).any(axis=1)]] = False
        return closed

    def that_turn(self, faces: Triangles, label: Labels, wanted: Mask) -> Labels:
        """Rows of the triangles of the wanted components to turn over, so that all agree with their
        neighbours."""
        whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
        rows = np.flatnonzero(wanted[label] & whole)
        edge, way = self.edge[rows].ravel(), self.way[rows].ravel()
        # Only where every edge has two triangles is there one way to agree.
        unclear = np.zeros(len(wanted), np.bool_)
        unclear[label[rows[np.flatnonzero(np.bincount(edge)[edge] != 2) // 3]]] = True
        sides = np.flatnonzero(np.repeat(~unclear[label[rows]], 3))
        first, second = sides[np.argsort(edge[sides], kind="stable")].reshape(-1, 2).T
        # Each triangle is two nodes, itself and itself turned; those that agree are connected.
        count = len(rows)
        differ = np.where(way[first] == way[second], count, 0)
        ends = np.concatenate([first // 3, first // 3 + count])
        others = np.concatenate([second // 3 + differ, second // 3 + count - differ])
        graph = coo_array((np.ones(len(ends), np.int8), (ends, others)), (2 * count, 2 * count))
        _, side = connected_components(graph, directed=False)
        return np.asarray(rows[side[:count] > side[count:]])
