"""The one flat form of solids: convex sets, the spheres around them, and the meshes they cover.

Of a convex set, of a shape, of a body's parts one after the other, and of all bodies of an arm:
`SolidRows` are made once of a set (`spheres`), moved, and joined.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.collision.meshes import MeshTree
from placement_planner_ros.core.collision.separation import BOUND_TOLERANCE_M
from placement_planner_ros.core.collision.shapes import Shape
from placement_planner_ros.core.types import Array, Index

PLACED_JOINT = -2
"""Stands for the joint of a body that stands in the world where it is put, and not for good."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class CollisionBody:
    """A link or the object.

    Attributes:
        name: of the link.
        joint: index of the last arm joint above it, -1 where none is, or `PLACED_JOINT`.
        parts: its geometry, in the world with all arm joints at zero.
        rigid: whether nothing but the arm's joints moves it against that joint (against the
            arm's mount where there is none).
    """

    name: str
    joint: int
    parts: tuple[tuple[Shape, pin.SE3], ...]
    rigid: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class SolidRows:
    """k spheres, s convex sets and g meshes as rows of tables; numbers count from the first row.

    Attributes:
        nodes: (k, 2) next node not below, set of a leaf or -1.
        node_spheres: (k, 5) centre, radius, and radius of a ball around the same centre that lies
            inside, -inf where none is known.
        sets: (s, 3) first node, first vertex, mesh that it covers or -1.
        radius: (s,) that each set is dilated by.
        vertices: (v, 3).
        meshes: trees; `mesh_frames` (g, 4, 4) where each is.
    """

    nodes: Index
    node_spheres: Array
    sets: Index
    radius: Array
    vertices: Array
    meshes: tuple[MeshTree, ...]
    mesh_frames: Array

    @classmethod
    def joined(cls, rows: Sequence[SolidRows]) -> SolidRows:
        """One below the other, their numbers counted on."""
        if len(rows) == 1:
            return rows[0]
        begins = np.cumsum([np.zeros(4, dtype=np.int64), *(each.sizes for each in rows)], axis=0)
        nodes, sets = [], []
        for each, (node, first_set, *others) in zip(rows, begins[:-1].tolist(), strict=True):
            nodes.append(np.where(each.nodes >= 0, each.nodes + np.array([node, first_set]), -1))
            sets.append(np.where(each.sets >= 0, each.sets + np.array([node, *others]), -1))
        return cls(
            np.vstack(nodes),
            np.vstack([each.node_spheres for each in rows]),
            np.vstack(sets),
            np.concatenate([each.radius for each in rows]),
            np.vstack([each.vertices for each in rows]),
            tuple(tree for each in rows for tree in each.meshes),
            np.vstack([each.mesh_frames for each in rows]),
        )

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """How many nodes, sets, vertices and meshes."""
        return len(self.nodes), len(self.radius), len(self.vertices), len(self.meshes)

    def moved(self, T: pin.SE3) -> SolidRows:
        """The same elsewhere."""
        R, p = T.rotation, T.translation
        spheres = self.node_spheres
        return replace(
            self,
            node_spheres=np.column_stack([spheres[:, :3] @ R.T + p, spheres[:, 3:]]),
            vertices=self.vertices @ R.T + p,
            mesh_frames=T.homogeneous @ self.mesh_frames,
        )

    def boxes(self) -> Array:
        """(s, 6) boxes around the sets, lower then upper corner."""
        first, radius = self.sets[:, 1], self.radius[:, None]
        lower = np.minimum.reduceat(self.vertices, first) - radius
        return np.hstack([lower, np.maximum.reduceat(self.vertices, first) + radius])

    def ball(self) -> Array:
        """(4,) centre and radius of a ball around all sets."""
        center, radius = bounding_sphere(self.vertices, 200)
        return np.append(center, radius + self.radius.max() + BOUND_TOLERANCE_M)


def bounding_sphere(points: Array, steps: int = 12) -> tuple[Array, float]:
    """Centre (3,) and radius of a ball around (n, 3) points, on links 5 % larger than
    the smallest at most; with 200 steps 1 %.

    Bădoiu and Clarkson's core-set iteration from the middle of their box: ever smaller steps
    towards the farthest point.
    """
    center = best = 0.5 * (points.min(axis=0) + points.max(axis=0))
    smallest = np.inf
    for step in range(steps):
        squares = np.square(points - center).sum(axis=1)
        farthest = squares.argmax()
        if squares[farthest] < smallest:
            best, smallest = center, squares[farthest]
        center = center + (points[farthest] - center) / (step + 3)
    return best, math.sqrt(smallest)
