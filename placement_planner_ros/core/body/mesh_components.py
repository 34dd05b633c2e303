"""The connected components of a mesh, and which of them enclose a solid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from placement_planner_ros.core.types import Array

WELD = 1e-9
"""Metres within which vertices are one."""

Triangles = npt.NDArray[np.int64]
Labels = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

_AT_ONCE = 2_000_000
"""Triangles times points whose solid angles are computed at once."""


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
    def of(cls, vertices: Array, triangles: Triangles) -> Components:
        """Of vertices (n, 3), in metres, and triangles (t, 3)."""
        _, first, welded = np.unique(
            (vertices / WELD).round(), axis=0, return_index=True, return_inverse=True
        )
        faces, points = welded.reshape(-1)[triangles], vertices[first]
        rows = _once(faces)
        faces = faces[rows]
        label = _labels(faces, len(points))
        count = int(label.max()) + 1 if len(label) else 0
        closed = _balanced(faces, label, count)
        if not closed.all():
            faces = _turned(faces, label, ~closed)
            closed = _balanced(faces, label, count)
        return cls(points[faces], rows, label, closed)

    def inside(self, points: Array) -> Mask:
        """(n,) whether points (n, 3) are inside a closed component."""
        solid = self.closed[self.label]
        corners = self.corners[solid]
        _, label = np.unique(self.label[solid], return_inverse=True)
        found = np.zeros(len(points), np.bool_)
        if not len(corners):
            return found
        count = int(label.max()) + 1
        for row in range(0, len(points), max(1, _AT_ONCE // len(corners))):
            chunk = points[row : row + max(1, _AT_ONCE // len(corners))]
            angles = _solid_angles(corners, chunk)
            flat = (np.arange(len(chunk))[:, None] * count + label).ravel()
            turns = np.bincount(flat, angles.ravel(), len(chunk) * count) / (4.0 * np.pi)
            found[row : row + len(chunk)] = (np.abs(turns) > 0.5).reshape(-1, count).any(axis=1)
        return found

    def of_labels(self, labels: Labels) -> Components:
        """These components alone."""
        kept = np.isin(self.label, labels)
        used, label = np.unique(self.label[kept], return_inverse=True)
        return Components(self.corners[kept], self.rows[kept], label, self.closed[used])


def _once(faces: Triangles) -> Labels:
    """Rows of the triangles that do not repeat one before them."""
    # The smallest first, the others in their turn: triangles that face the other way stay.
    turn = (np.argmin(faces, axis=1)[:, None] + np.arange(3)) % 3
    _, first = np.unique(np.take_along_axis(faces, turn, axis=1), axis=0, return_index=True)
    return np.sort(first)


def _labels(faces: Triangles, count: int) -> Labels:
    ends = faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    graph = coo_array((np.ones(len(ends), np.int8), (ends[:, 0], ends[:, 1])), (count, count))
    _, of_vertex = connected_components(graph, directed=False)
    _, label = np.unique(of_vertex[faces[:, 0]], return_inverse=True)
    return np.asarray(label.reshape(-1), np.int64)


def _edges(faces: Triangles) -> tuple[Labels, Labels]:
    """(3 t,) the edge that each side of the triangles is, and whether that way or the other."""
    sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    keys = sides.min(axis=1) * (int(faces.max(initial=0)) + 1) + sides.max(axis=1)
    _, edge = np.unique(keys, return_inverse=True)
    return edge.reshape(-1), np.sign(sides[:, 1] - sides[:, 0])


def _balanced(faces: Triangles, label: Labels, count: int) -> Mask:
    """(k,) components whose edges have as many triangles one way as the other."""
    closed = np.ones(count, np.bool_)
    edge, way = _edges(faces)
    closed[label[np.flatnonzero(np.bincount(edge, way)[edge]) // 3]] = False
    return closed


def _turned(faces: Triangles, label: Labels, wanted: Mask) -> Triangles:
    """Triangles of the wanted components, turned to agree with their neighbours."""
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    rows = np.flatnonzero(wanted[label] & whole)
    edge, way = _edges(faces[rows])
    # Only where every edge has two triangles is there one way to agree.
    unclear = np.unique(label[rows[np.flatnonzero(np.bincount(edge)[edge] != 2) // 3]])
    sides = np.flatnonzero(~np.isin(np.repeat(label[rows], 3), unclear))
    first, second = sides[np.argsort(edge[sides], kind="stable")].reshape(-1, 2).T
    # Each triangle is two nodes, itself and itself turned; those that agree are connected.
    count = len(rows)
    differ = np.where(way[first] == way[second], count, 0)
    ends = np.concatenate([first // 3, first // 3 + count])
    others = np.concatenate([second // 3 + differ, second // 3 + count - differ])
    graph = coo_array((np.ones(len(ends), np.int8), (ends, others)), (2 * count, 2 * count))
    _, side = connected_components(graph, directed=False)
    turned = rows[side[:count] > side[count:]]
    made = faces.copy()
    made[turned] = faces[turned][:, [0, 2, 1]]
    return made


def _solid_angles(corners: Array, points: Array) -> Array:
    """(n, t) solid angles of triangles (t, 3, 3) as seen from points (n, 3)."""
    a, b, c = (corners[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.sqrt(np.einsum("ntk,ntk->nt", v, v)) for v in (a, b, c))
    volume = np.einsum("ntk,ntk->nt", a, np.cross(b, c))
    below = (
        la * lb * lc
        + np.einsum("ntk,ntk->nt", a, b) * lc
        + np.einsum("ntk,ntk->nt", b, c) * la
        + np.einsum("ntk,ntk->nt", c, a) * lb
    )
    return np.asarray(2.0 * np.arctan2(volume, below))
