"""Terms that look at what the object stands on and beside; of these, edge.

They look at a table of places for each height and slope of contact planes, made when it is first
asked for.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.objective.supporting_faces import SupportingFaces, padded_rows
from placement_planner_ros.core.scene.layers import LAYER_STEP_M
from placement_planner_ros.core.types import Array, Index, Slope

ABOVE_CONTACT_M = 0.01
"""m above the contact plane, what stands beside the object begins to count."""


class Group(NamedTuple):
    """Those of some poses that stand on one contact plane with something around them.

    Attributes:
        rows: (n,) which.
        face: (n,) indices of what they stand on, and (n, 2) `middle`, its middle seen from above.
        slope: of the plane.
        tree: places (m, 2) around, and (m,) `known`, what is known of each.
    """

    rows: Index
    face: Index
    middle: Array
    slope: Slope
    tree: cKDTree
    known: Array


class Beside(ABC):
    """What such terms know of poses: the planes that they stand on, and what is around."""

    def __init__(self, context: ObjectiveContext) -> None:
        self._standing = SupportingFaces(context)
        self._environment = context.environment
        self._tolerance = context.contact_tolerance
        self._size = float(np.linalg.norm(np.ptp(context.body.vertices, axis=0)))
        self._tables: dict[tuple[int, int], tuple[cKDTree | None, Array]] = {}

    def _groups(self, T: Array) -> Iterator[Group]:
        """Of poses (n, 4, 4); what has nothing around is left out."""
        # What each pose stands on, and where the middle of that side is.
        stood = self._standing.at(T)
        at = np.einsum("nij,nj->ni", T[:, :3, :3], self._standing.middles[stood.face]) + T[:, :3, 3]
        slopes = np.array(self._standing.slopes)[stood.slope]
        # Contact planes, by slope and by height in steps.
        level = np.round((at[:, 2] - (at[:, :2] * slopes).sum(axis=1)) / LAYER_STEP_M)
        planes = np.column_stack([stood.slope, level]).astype(np.int64)
        for slope, height in sorted(set(map(tuple, planes.tolist()))):
            tree, known = self._table(slope, height)
            if tree is None:
                continue
            # The poses on that plane.
            of = np.flatnonzero((planes == (slope, height)).all(axis=1))
            along = self._standing.slopes[slope]
            yield Group(of, stood.face[of], at[of, :2], along, tree, known)

    def _table(self, slope: int, level: int) -> tuple[cKDTree | None, Array]:
        """Places around a contact plane as a tree, and what is known of each.

        Args:
            level: its height above x = y = 0, in units of `LAYER_STEP_M`.
        """
        key = slope, level
        if key not in self._tables:
            places, known = self._places(self._standing.slopes[slope], level * LAYER_STEP_M)
            self._tables[key] = (cKDTree(places) if len(places) else None), known
        return self._tables[key]

    @abstractmethod
    def _places(self, slope: Slope, height: float) -> tuple[Array, Array]:
        """Places (m, 2) around that contact plane, and (m,) what is known of each."""

    def _ends(self, slope: Slope, height: float) -> Array:
        """(n, 2) where the surfaces of that height end, but where a thing stands."""
        return self._environment.support_of(slope).ends(height, self._tolerance)


class Edge(Beside):
    """edge: the least distance of what the object stands on from where its support ends, metres.

    Seen from above, from the hull of v(f) to where the surface drops or was not seen; not to where
    a thing stands on it. At most 0.2.
    """

    scale: ClassVar = 0.05
    ends: ClassVar = (0.0, 0.2)
    expensive: ClassVar = True

    def __init__(self, context: ObjectiveContext) -> None:
        super().__init__(context)
        self._corners = padded_rows([face.vertices for face in context.body.faces])  # (|F|, k, 3)

    def values(self, T_world_object: Array) -> Array:
        """(n,) at poses (n, 4, 4)."""
        result = np.full(len(T_world_object), self.ends[1])
        for group in self._groups(T_world_object):
            # The corners of what they stand on, seen from above.
            T = T_world_object[group.rows]
            feet = self._corners[group.face] @ T[:, :2, :3].transpose(0, 2, 1) + T[:, None, :2, 3]
            # Ends that may be nearest to the side: those within its radius of the middle's nearest.
            radius = np.linalg.norm(feet - group.middle[:, None], axis=2).max(axis=1)
            nearest, _ = group.tree.query(group.middle)
            near = group.tree.query_ball_point(group.middle, nearest + radius)
            numbers = np.array([len(points) for points in near])
            points = group.tree.data[np.concatenate(near).astype(np.int64)]
            away = _from_polygons(points, np.repeat(feet, numbers, axis=0))
            # The least distance of each pose.
            least = np.minimum.reduceat(away, np.cumsum(numbers) - numbers)
            trim = self._environment.support_of(group.slope).trim
            result[group.rows] = np.clip(least - trim, *self.ends)
        return result

    def _places(self, slope: Slope, height: float) -> tuple[Array, Array]:
        ends = self._ends(slope, height)
        return ends, np.zeros(len(ends))


def _from_polygons(points: Array, corners: Array) -> Array:
    """(n,) distance of each of the points (n, 2) from its own convex polygon, of corners (n, k, 2)
    in order; 0 inside."""
    # The nearest point of each edge.
    edges = np.roll(corners, -1, axis=1) - corners
    lengths = np.maximum((edges * edges).sum(axis=2), 1e-18)
    off = points[:, None] - corners
    share = np.clip((off * edges).sum(axis=2) / lengths, 0.0, 1.0)
    away = off - share[..., None] * edges
    distance = np.sqrt((away * away).sum(axis=2).min(axis=1))
    # Inside, where the point lies on the same side of all edges.
    across = edges[..., 0] * off[..., 1] - edges[..., 1] * off[..., 0]
    inside = (across >= 0.0).all(axis=1) | (across <= 0.0).all(axis=1)
    return np.where(inside, 0.0, distance)
