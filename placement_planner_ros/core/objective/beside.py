"""The terms that are told by what the object stands on and beside: edge and aligned.

Both look at a table of places for each height and slope of contact planes, made when it is first
asked for.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.objective.standing import Index, Standing
from placement_planner_ros.core.types import Array, Slope

Mask = npt.NDArray[np.bool_]

_SAME = 1e-3
"""m: contact planes closer together than this share a table."""
_ROOM = 0.003
"""m that a surface may be above or below the contact plane to be what the object stands on."""
_ABOVE = 0.01
"""m above the contact plane, what stands beside the object begins to count for `aligned`."""
_RISE = 0.005
"""m above a surface, what rises higher is a thing that stands there."""
_BESIDE = 0.015
"""m beside such a thing, the end of a surface is taken for one that the thing stands at."""
_LONG = 2.0
"""Times as long as wide is what of a thing lies in a cell, where it shows a direction."""
_AROUND = 0.03
"""m around the end of a surface, of whose other ends it takes its direction."""
_STRAIGHT = 0.25
"""Share of how far these spread along it that they may spread across."""


class _Beside:
    """What both terms know of the pose: the plane that it stands on, and its footprint."""

    def __init__(self, context: ObjectiveContext) -> None:
        self._standing = Standing(context)
        self._environment = context.environment
        self._faces = context.body.faces
        self._size = float(np.linalg.norm(np.ptp(context.body.vertices, axis=0)))
        self._tables: dict[tuple[int, int], tuple[cKDTree | None, Array]] = {}

    def _planes(self, T: Array) -> tuple[Index, Index, Array]:
        """(n,) faces, slopes and heights of the contact planes above x = y = 0 at poses
        (n, 4, 4)."""
        stood = self._standing.at(T)
        middle = self._standing.middles[stood.face]
        place = np.einsum("nij,nj->ni", T[:, :3, :3], middle) + T[:, :3, 3]
        slope = self._standing.slopes[stood.slope]
        return stood.face, stood.slope, place[:, 2] - (place[:, :2] * slope).sum(axis=1)

    def _table(self, slope: int, height: float) -> tuple[cKDTree | None, Array]:
        """Places around a contact plane as a tree, and what is known of each."""
        key = slope, round(height / _SAME)
        if key not in self._tables:
            along = self._standing.slopes[slope]
            places, known = self._places((float(along[0]), float(along[1])), height)
            self._tables[key] = (cKDTree(places) if len(places) else None), known
        return self._tables[key]

    def _places(self, slope: Slope, height: float) -> tuple[Array, Array]:
        raise NotImplementedError

    def _ends(self, slope: Slope, height: float) -> Array:
        """(n, 2) where the surfaces of that height end, but where a thing stands."""
        support = self._environment.support_of(slope)
        of = np.repeat(np.arange(len(support.height)), np.diff(support.first))
        near = np.abs(support.height - height) <= _ROOM
        ends = support.points[support.ends & near[of]].astype(np.float64)
        measured = self._environment.measured
        low, high = measured.lower, measured.upper
        plane = height + 0.5 * (low[:, :2] + high[:, :2]) @ np.array(slope)
        rises = (high[:, 2] > plane + _RISE) & (low[:, 2] < plane + 2.0 * _ABOVE)
        beside = np.zeros(len(ends), np.bool_)
        if rises.any() and len(ends):
            low, high = low[rises, :2], high[rises, :2]
            things = cKDTree(0.5 * (low + high))
            reach = _BESIDE + math.sqrt(0.5) * measured.cell_size
            for n, boxes in enumerate(things.query_ball_point(ends, reach)):
                off = np.maximum(np.maximum(low[boxes] - ends[n], ends[n] - high[boxes]), 0.0)
                beside[n] = bool((np.hypot(off[:, 0], off[:, 1]) <= _BESIDE).any())
        return ends[~beside]


class Edge(_Beside):
    """edge: the least distance of what the object stands on from where its support ends, metres.

    Seen from above, from the hull of v(f) to where the surface drops or was not seen; not to where
    a thing stands on it, nor to what of the end lies within 15 mm of one. At most 0.2.
    """

    unit: ClassVar = "m"
    scale: ClassVar = 0.05
    ends: ClassVar = (0.0, 0.2)
    dear: ClassVar = True

    def values(self, T_world_object: Array) -> Array:
        """(n,) at poses (n, 4, 4)."""
        faces, slopes, heights = self._planes(T_world_object)
        result = np.full(len(faces), self.ends[1])
        for n, T in enumerate(T_world_object):
            tree, _ = self._table(int(slopes[n]), float(heights[n]))
            if tree is None:
                continue
            feet = self._faces[int(faces[n])].vertices @ T[:3, :3].T + T[:3, 3]
            middle = feet[:, :2].mean(axis=0)
            radius = float(np.linalg.norm(feet[:, :2] - middle, axis=1).max())
            nearest, _ = tree.query(middle)
            if nearest >= self.ends[1] + radius:
                continue
            near = tree.data[tree.query_ball_point(middle, nearest + radius)]
            along = self._standing.slopes[slopes[n]]
            trim = self._environment.support_of((float(along[0]), float(along[1]))).trim
            distance = _from_polygon(near, feet[:, :2]) - trim
            result[n] = min(max(distance, 0.0), self.ends[1])
        return result

    def upper(self, T_world_object: Array) -> Array:
        """(n,) the distance of the middle of what it stands on, which is no nearer."""
        faces, slopes, heights = self._planes(T_world_object)
        middle = self._standing.middles[faces]
        place = np.einsum("nij,nj->ni", T_world_object[:, :2, :3], middle)
        place += T_world_object[:, :2, 3]
        result = np.full(len(faces), self.ends[1])
        keys = np.column_stack([slopes, np.round(heights / _SAME)])
        for key in np.unique(keys, axis=0):
            rows = np.flatnonzero((keys == key).all(axis=1))
            tree, _ = self._table(int(key[0]), float(heights[rows[0]]))
            if tree is not None:
                result[rows] = np.minimum(tree.query(place[rows])[0], self.ends[1])
        return result

    def _places(self, slope: Slope, height: float) -> tuple[Array, Array]:
        ends = self._ends(slope, height)
        return ends, np.zeros(len(ends))


class Aligned(_Beside):
    """aligned: minus the angle between the longest edge of what the object stands on, or what is
    square to it, and the nearest wall, end of its support or thing beside it, radians; 0 to -π/4.

    Nearest is what is nearest to the middle of its side, of all whose direction shows: things that
    reach between 1 cm above the contact plane and the object's size above it, by the boxes that
    their points fill, and ends by those within 3 cm around. Where there is nothing, 0.
    """

    unit: ClassVar = "rad"
    scale: ClassVar = 0.2
    ends: ClassVar = (-0.25 * math.pi, 0.0)
    dear: ClassVar = True

    def values(self, T_world_object: Array) -> Array:
        """(n,) at poses (n, 4, 4)."""
        faces, slopes, heights = self._planes(T_world_object)
        result = np.zeros(len(faces))
        for n, T in enumerate(T_world_object):
            tree, directions = self._table(int(slopes[n]), float(heights[n]))
            if tree is None:
                continue
            face = int(faces[n])
            middle = T[:2, :3] @ self._standing.middles[face] + T[:2, 3]
            along = T[:3, :3] @ self._faces[face].T_face_object.rotation[0]
            _, nearest = tree.query(middle)
            off = math.atan2(along[1], along[0]) - float(directions[nearest])
            result[n] = -abs(math.remainder(off, 0.5 * math.pi))
        return result

    def _places(self, slope: Slope, height: float) -> tuple[Array, Array]:
        measured = self._environment.measured
        low, high = measured.lower, measured.upper
        middle = 0.5 * (low + high)
        plane = height + middle[:, :2] @ np.array(slope)
        beside = (high[:, 2] > plane + _ABOVE) & (low[:, 2] < plane + self._size)
        cos, sin, x0, x1, y0, y1 = measured.outline[beside].astype(np.float64).T
        long, wide = np.maximum(x1 - x0, y1 - y0), np.minimum(x1 - x0, y1 - y0)
        shows = (long > _LONG * wide) & (long > 0.3 * measured.cell_size)
        direction = np.arctan2(sin, cos)
        ends = self._ends(slope, height)
        straight, along = _directions(ends)
        places = np.concatenate([middle[beside, :2][shows], ends[straight]])
        return places, np.concatenate([direction[shows], along[straight]])


def _directions(ends: Array) -> tuple[Mask, Array]:
    """(n,) whether points (n, 2) lie in line with those around them, and (n,) along which angle."""
    straight, along = np.zeros(len(ends), np.bool_), np.zeros(len(ends))
    if not len(ends):
        return straight, along
    tree = cKDTree(ends)
    for n, near in enumerate(tree.query_ball_point(ends, _AROUND)):
        off = ends[near] - ends[near].mean(axis=0)
        sizes, axes = np.linalg.eigh(off.T @ off)
        straight[n] = len(near) >= 4 and sizes[0] < _STRAIGHT**2 * sizes[1]
        along[n] = math.atan2(axes[1, 1], axes[0, 1])
    return straight, along


def _from_polygon(points: Array, corners: Array) -> float:
    """The least distance of points (n, 2) from a convex polygon of corners (k, 2) in order."""
    following = np.roll(corners, -1, axis=0)
    edges = following - corners
    lengths = np.maximum((edges * edges).sum(axis=1), 1e-18)
    off = points[:, None] - corners
    share = np.clip((off * edges).sum(axis=2) / lengths, 0.0, 1.0)
    distance = np.linalg.norm(off - share[..., None] * edges, axis=2).min(axis=1)
    across = edges[:, 0] * off[..., 1] - edges[:, 1] * off[..., 0]
    inside = (across >= 0.0).all(axis=1) | (across <= 0.0).all(axis=1)
    return float(np.where(inside, 0.0, distance).min(initial=math.inf))
