"""The one flat form of solids: convex sets, the spheres around them, and the meshes they cover.

Of a shape, of a body's parts one after the other, and of all bodies of an arm: `SolidRows` are
made once of a shape, moved, and joined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.collision.meshes import MeshTree
from placement_planner_ros.core.collision.separation import BOUND_TOLERANCE_M
from placement_planner_ros.core.collision.shapes import Shape
from placement_planner_ros.core.collision.spheres import sphere_trees
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.weak_cache import weak_lru_cache

Indices = npt.NDArray[np.int64]

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
        node_spheres: (k, 4) centre and radius.
        node_inner: (k,) radius of a ball around the same centre that lies inside, -inf without.
        sets: (s, 3) first node, first vertex, mesh that it covers or -1.
        radius: (s,) that each set is dilated by.
        vertices: (v, 3).
        meshes: trees; `mesh_frames` (g, 4, 4) where each is.
    """

    nodes: Indices
    node_spheres: Array
    node_inner: Array
    sets: Indices
    radius: Array
    vertices: Array
    meshes: tuple[MeshTree, ...]
    mesh_frames: Array

    @classmethod
    def of(cls, shape: Shape, excess: float) -> SolidRows:
        """Of a shape in its own frame.

        Args:
            excess: how far the finest covering spheres may stick out, metres; infinite for one
                sphere around each set.
        """
        mesh = -1 if shape.mesh is None else 0
        rows = [
            cls(
                np.column_stack([tree.skip, np.where(tree.leaf, 0, -1)]),
                np.column_stack([tree.centers, tree.radii]),
                tree.inner,
                np.array([[0, 0, mesh]]),
                np.array([convex.radius]),
                convex.vertices,
                (),
                np.zeros((0, 4, 4)),
            )
            for convex, tree in zip(shape.sets, sphere_trees(shape, excess), strict=True)
        ]
        joined = rows[0] if len(rows) == 1 else cls.joined(rows)
        if shape.mesh is None:
            return joined
        return replace(joined, meshes=(shape.mesh,), mesh_frames=np.eye(4)[None])

    @classmethod
    def joined(cls, rows: Sequence[SolidRows]) -> SolidRows:
        """One below the other, their numbers counted on."""
        begins = np.cumsum([np.zeros(4, dtype=np.int64), *(each.sizes for each in rows)], axis=0)
        nodes, sets = [], []
        for each, (node, first_set, *others) in zip(rows, begins[:-1].tolist(), strict=True):
            nodes.append(np.where(each.nodes >= 0, each.nodes + np.array([node, first_set]), -1))
            sets.append(np.where(each.sets >= 0, each.sets + np.array([node, *others]), -1))
        return cls(
            np.vstack(nodes),
            np.vstack([each.node_spheres for each in rows]),
            np.concatenate([each.node_inner for each in rows]),
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
            node_spheres=np.column_stack([spheres[:, :3] @ R.T + p, spheres[:, 3]]),
            vertices=self.vertices @ R.T + p,
            mesh_frames=T.homogeneous @ self.mesh_frames,
        )

    def ball(self) -> Array:
        """(4,) centre and radius of a ball around all sets, about the middle of their box."""
        center = 0.5 * (self.vertices.min(axis=0) + self.vertices.max(axis=0))
        radius = np.linalg.norm(self.vertices - center, axis=1).max()
        return np.append(center, radius + self.radius.max() + BOUND_TOLERANCE_M)


@weak_lru_cache("body", maxsize=2)
def body_rows(body: CollisionBody, T_joint_world: bytes, excess: float) -> tuple[SolidRows, Array]:
    """The rows of a body, and a ball (4,) around it; links are the same for each grasp and object.

    Args:
        T_joint_world: (4, 4) of the body's joint, with all joints at zero.
        excess: how far the finest covering spheres may stick out, metres; ten times that of
            what does not move.
    """
    step(f"covering {body.name} with spheres")
    T = pin.SE3(np.frombuffer(T_joint_world).reshape(4, 4))
    excess = excess if body.joint >= 0 else 10 * excess
    rows = SolidRows.joined(
        [SolidRows.of(shape, excess).moved(T * T_part) for shape, T_part in body.parts]
    )
    return rows, rows.ball()
