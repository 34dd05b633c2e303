"""A link, or the held object, as rows of the arrays of `arrays.ArmArrays`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.collision.meshes import MeshTree
from placement_planner_ros.core.collision.shapes import ConvexSet, Shape
from placement_planner_ros.core.collision.spheres import SphereTree, bounding_sphere, sphere_trees
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.weak_cache import weak_lru_cache

Indices = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A piece of geometry of a body, in the world with all arm joints at zero."""

    shape: Shape
    T_world_part: pin.SE3


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class CollisionBody:
    """A link or the held object.

    Attributes:
        name: of the link.
        joint: index of the last arm joint above it, -1 where none is.
        parts: its geometry.
        rigid: whether nothing but the arm's joints moves it against that joint (against the
            arm's mount where there is none).
    """

    name: str
    joint: int
    parts: tuple[Part, ...]
    rigid: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class BodyRows:
    """Rows of a body's k spheres, s sets, g meshes, in its joint's frame.

    As in `arrays.ArmArrays`, but that each number of another row counts from the body's first.

    Attributes:
        sphere: (4,) around all of it.
        nodes: (k, 2) next node not below, set of a leaf or -1.
        node_spheres: (k, 4); `node_inner` (k,).
        sets: (s, 4) first node, first vertex, first plane, mesh or -1.
        radius, excess: (s,).
        vertices: (v, 3); `planes` (f, 4).
        meshes: trees; `mesh_frames` (g, 4, 4) T_joint_mesh.
        extent: metres along the world's axes with all joints at zero, added up.
    """

    sphere: Array
    nodes: Indices
    node_spheres: Array
    node_inner: Array
    sets: Indices
    radius: Array
    excess: Array
    vertices: Array
    planes: Array
    meshes: tuple[MeshTree, ...]
    mesh_frames: Array
    extent: float

    @property
    def ends(self) -> tuple[int, int, int, int, int]:
        """How many sets, nodes, vertices, planes and meshes."""
        sets, nodes, meshes = len(self.sets), len(self.nodes), len(self.meshes)
        return sets, nodes, len(self.vertices), len(self.planes), meshes


@dataclass(frozen=True, slots=True, eq=False)
class _PlacedSet:
    """A convex set of a body's part with the spheres around it, at T in the body's joint."""

    mesh: int
    excess: float
    convex: ConvexSet
    tree: SphereTree
    T: pin.SE3

    def moved(self, points: Array) -> Array:
        """(n, 3) points of the set's frame in the joint's."""
        return np.asarray(points @ self.T.rotation.T + self.T.translation)

    @property
    def planes(self) -> Array:
        """(f, 4) in the joint's frame."""
        normals = self.convex.normals @ self.T.rotation.T
        return np.column_stack([normals, self.convex.offsets + normals @ self.T.translation])


@weak_lru_cache("body", maxsize=2)
def body_rows(body: CollisionBody, T_joint_world: bytes, excess: float) -> BodyRows:
    """The rows of a body; links are the same for each grasp and object.

    Args:
        T_joint_world: (4, 4) of the body's joint, with all joints at zero.
        excess: how far the finest covering spheres may stick out, metres; ten times that of
            what does not move.
    """
    # Every convex set of every part, and the meshes that they cover.
    placed = pin.SE3(np.frombuffer(T_joint_world).reshape(4, 4))
    meshes: list[tuple[MeshTree, Array]] = []
    sets: list[_PlacedSet] = []
    for part in body.parts:
        step(f"covering {body.name} with spheres")
        T, shape = placed * part.T_world_part, part.shape
        if shape.mesh is not None:
            meshes.append((shape.mesh, T.homogeneous))
        mesh = len(meshes) - 1 if shape.mesh is not None else -1
        trees = sphere_trees(shape, excess if body.joint >= 0 else 10 * excess)
        for convex, tree in zip(shape.sets, trees, strict=True):
            sets.append(_PlacedSet(mesh, shape.excess, convex, tree, T))
    # Where the rows of each set begin.
    sizes = [(len(s.tree.radii), len(s.convex.vertices), len(s.convex.offsets)) for s in sets]
    first = np.vstack([np.zeros((1, 3), dtype=np.int64), np.cumsum(sizes, axis=0)[:-1]])
    vertices = np.vstack([s.moved(s.convex.vertices) for s in sets])
    radius = np.array([s.convex.radius for s in sets])
    center, around = bounding_sphere(vertices)
    return BodyRows(
        sphere=np.append(center, around + (radius.max() + 1e-9)),
        nodes=np.vstack(
            [
                np.column_stack([s.tree.skip + node, np.where(s.tree.leaf, row, -1)])
                for row, (s, node) in enumerate(zip(sets, first[:, 0], strict=True))
            ]
        ),
        node_spheres=np.vstack(
            [np.column_stack([s.moved(s.tree.centers), s.tree.radii]) for s in sets]
        ),
        node_inner=np.concatenate([s.tree.inner for s in sets]),
        sets=np.column_stack([first, [s.mesh for s in sets]]),
        radius=radius,
        excess=np.array([s.excess for s in sets]),
        vertices=vertices,
        planes=np.vstack([s.planes for s in sets]),
        meshes=tuple(tree for tree, _ in meshes),
        mesh_frames=np.array([frame for _, frame in meshes]).reshape(-1, 4, 4),
        extent=float(np.ptp((vertices - placed.translation) @ placed.rotation, axis=0).sum()),
    )
