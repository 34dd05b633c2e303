"""The connected components of a mesh, and which of them enclose a solid."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

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

_CLEAR = 1e-9
"""Metres that a ray keeps from edges, and a point from surfaces, for their sides to be certain."""

_WIDE = 0.01
"""Share of triangles that are looked at for every ray, so that the others can be looked up."""

_ASKEW = np.array([[2.0, -1.0, 2.0], [2.0, 2.0, -1.0], [-1.0, 2.0, 2.0]]) / 3.0
_ASKEW = _ASKEW @ np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
_ASKEW = _ASKEW @ np.array([[1.0, 0.0, 0.0], [0.0, 0.96, 0.28], [0.0, -0.28, 0.96]])
_ASKEW.setflags(write=False)
"""A rotation: rays then run along no direction that edges of things made by people have."""


@dataclass(frozen=True, eq=False)
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
        first, welded = alike((vertices / WELD).round())
        faces, points = welded[triangles], vertices[first]
        rows = _once(faces)
        faces = faces[rows]
        label = _labels(faces, len(points))
        count = int(label.max()) + 1 if len(label) else 0
        sides = _Sides.of(faces)
        closed = sides.balanced(label, count)
        if not closed.all():
            turned = sides.that_turn(faces, label, ~closed)
            faces[turned] = faces[turned][:, [0, 2, 1]]
            closed = sides.turned(turned).balanced(label, count)
        return cls(points[faces], rows, label, closed)

    def inside(self, points: Array) -> Mask:
        """(n,) whether points (n, 3) are inside a closed component."""
        return self._solids.inside(points)

    @cached_property
    def _solids(self) -> _Solids:
        solid = self.closed[self.label]
        return _Solids.of(self.corners[solid], self.label[solid])

    def coarser(self, cell: float) -> Components:
        """About the same in fewer triangles: vertices in one cube of that side become one; the same
        where it is so small that none would be left."""
        points = self.corners.reshape(-1, 3)
        _, cubes = alike(np.floor(points / cell))
        count = np.bincount(cubes)
        middles = [np.bincount(cubes, along) / count for along in points.T]
        faces = cubes.reshape(-1, 3)
        whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
        return Components.of(np.column_stack(middles), faces[whole]) if whole.any() else self

    def of_labels(self, labels: Labels) -> Components:
        """These components alone."""
        kept = np.isin(self.label, labels)
        used, label = np.unique(self.label[kept], return_inverse=True)
        return Components(self.corners[kept], self.rows[kept], label, self.closed[used])


def _once(faces: Triangles) -> Labels:
    """Rows of the triangles that do not repeat one before them."""
    # The smallest first, the others in their turn: triangles that face the other way stay.
    turn = (np.argmin(faces, axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(faces, turn, axis=1).T
    count = int(faces.max(initial=0)) + 1
    _, both = np.unique(a * count + b, return_inverse=True)  # numbers that their product holds
    _, first = np.unique(both.reshape(-1) * count + c, return_index=True)
    return np.sort(first)


def alike(rows: Array | Triangles) -> tuple[Labels, Labels]:
    """Rows of (n, k) numbers that are equal: the first of each kind (m,), kinds in the order of
    their numbers, and the kind of each row (n,).

    numpy's unique says the same, but compares rows as bytes, which takes five times as long.
    """
    order = np.argsort(rows[:, 0], kind="stable")
    same = rows[order[1:], 0] == rows[order[:-1], 0]
    tied = np.append(same, False) | np.append(False, same)
    if tied.any():
        some = order[tied]
        order[tied] = some[np.lexsort(rows[some].T[::-1])]
    new = np.ones(len(rows), np.bool_)
    new[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    kind = np.empty(len(rows), np.int64)
    kind[order] = np.cumsum(new) - 1
    return order[new], kind


def _labels(faces: Triangles, count: int) -> Labels:
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


@dataclass(frozen=True, slots=True, eq=False)
class _Solids:
    """Closed components, turned so that rays go upward.

    Attributes:
        corners: (t, 3, 3) of their triangles, by where they begin along x; the widest last.
        label: (t,) the component of each.
        count: of components.
        low, high: (3, t) corners of the boxes around the triangles.
        narrow: how many are not among the widest.
        width: metres along x that none of these is wider than.
    """

    corners: Array
    label: Labels
    count: int
    low: Array
    high: Array
    narrow: int
    width: float

    @classmethod
    def of(cls, corners: Array, label: Labels) -> _Solids:
        """Of triangles (t, 3, 3) and the component of each (t,)."""
        used, label = np.unique(label, return_inverse=True)
        turned = corners @ _ASKEW
        starts, widths = turned[:, :, 0].min(axis=1), np.ptp(turned[:, :, 0], axis=1)
        width = float(np.quantile(widths, 1.0 - _WIDE)) if len(widths) else 0.0
        order = np.lexsort([starts, widths > width])
        turned = turned[order]
        a, b, c = np.ascontiguousarray(turned.transpose(1, 2, 0))
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        narrow = int((widths <= width).sum())
        return cls(turned, label[order], len(used), low, high, narrow, width)

    def inside(self, points: Array) -> Mask:
        """(n,) whether points (n, 3) have a winding number other than 0 in any component."""
        found = np.zeros(len(points), np.bool_)
        if self.count:
            for row, point in enumerate(points @ _ASKEW):
                turns = self._crossed(point)
                if turns is None:
                    angles = _solid_angles(self.corners - point)
                    turns = np.bincount(self.label, angles, self.count) / (4.0 * np.pi)
                found[row] = (np.abs(turns) > 0.5).any()
        return found

    def _crossed(self, point: Array) -> Array | None:
        """(count,) the turns of each component around a point (3,): what a ray upward crosses.

        None where the ray passes an edge, or the point a surface, so closely that rounding could
        matter.
        """
        ends = point[0] + np.array([-self.width - 2.0 * _CLEAR, 2.0 * _CLEAR])
        begin, end = np.searchsorted(self.low[0, : self.narrow], ends)
        over = np.concatenate([np.arange(begin, end), np.arange(self.narrow, len(self.label))])
        over = over[self.high[2, over] >= point[2] - _CLEAR]
        for axis in range(2):
            over = over[self.low[axis, over] <= point[axis] + _CLEAR]
            over = over[self.high[axis, over] >= point[axis] - _CLEAR]
        corners = self.corners[over] - point
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        # seen from above, twice the areas of the triangles that the ray makes with each edge
        areas = np.stack([_across(b, c), _across(c, a), _across(a, b)], axis=1)
        lengths = np.linalg.norm(np.stack([c - b, a - c, b - a], axis=1)[..., :2], axis=2)
        met = (areas > 0.0).all(axis=1) | (areas < 0.0).all(axis=1)
        area, height = areas.sum(axis=1), (areas * corners[..., 2]).sum(axis=1)
        if (np.abs(areas) <= _CLEAR * lengths).any():
            return None
        if (met & (np.abs(height) <= _CLEAR * np.abs(area))).any():
            return None
        crossed = met & (height * area > 0.0)
        turns = np.bincount(self.label[over[crossed]], np.sign(area[crossed]), self.count)
        return np.asarray(turns, np.float64)


def _across(a: Array, b: Array) -> Array:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _solid_angles(corners: Array) -> Array:
    """(t,) solid angles of triangles (t, 3, 3) as seen from the origin."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    la, lb, lc = (np.sqrt(np.einsum("tk,tk->t", v, v)) for v in (a, b, c))
    volume = np.einsum("tk,tk->t", a, np.cross(b, c))
    below = (
        la * lb * lc
        + np.einsum("tk,tk->t", a, b) * lc
        + np.einsum("tk,tk->t", b, c) * la
        + np.einsum("tk,tk->t", c, a) * lb
    )
    return np.asarray(2.0 * np.arctan2(volume, below))
