"""A link, or the held object, as rows of the arrays of `arrays.ArmArrays`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.collision.meshes import MeshTree
from placement_planner_ros.core.collision.shapes import Shape
from placement_planner_ros.core.collision.spheres import SphereTree, bounding_sphere, sphere_trees
from placement_planner_ros.core.robot.surface import Solid
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.weak_cache import weak_lru_cache

Indices = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A piece of geometry of a body, in the world with all arm joints at zero."""

    shape: Shape
    geometry: Solid
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
    """Rows of a body's p parts, k spheres, s sets (one a part), g meshes, in its joint's frame.

    As in `arrays.ArmArrays`, but that each number of another row counts from the body's first.

    Attributes:
        sphere: (4,) around all of it.
        parts: (p, 2) first node, set.
        part_spheres: (p, 4).
        nodes: (k, 2) next node not below, set of a leaf or -1.
        node_spheres: (k, 4); `node_inner` (k,).
        sets: (s, 4) first vertex, first plane, exactness, mesh or -1.
        set_part: (s,) the body's part, as `CollisionBody.parts` has it, that each is of.
        radius, excess: (s,); `inner` (s, 4).
        vertices: (v, 3); `planes` (f, 4).
        meshes: trees; `mesh_frames` (g, 4, 4) T_joint_mesh.
        extent: metres along the world's axes with all joints at zero, added up.
    """

    sphere: Array
    parts: Indices
    part_spheres: Array
    nodes: Indices
    node_spheres: Array
    node_inner: Array
    sets: Indices
    set_part: Indices
    radius: Array
    excess: Array
    inner: Array
    vertices: Array
    planes: Array
    meshes: tuple[MeshTree, ...]
    mesh_frames: Array
    extent: float

    @property
    def ends(self) -> tuple[int, int, int, int, int]:
        """How many nodes, parts, vertices, planes and meshes."""
        nodes, parts, meshes = len(self.nodes), len(self.parts), len(self.meshes)
        return nodes, parts, len(self.vertices), len(self.planes), meshes


@weak_lru_cache("body", maxsize=2)
def body_rows(body: CollisionBody, T_joint_world: bytes, excess: float) -> BodyRows:
    """The rows of a body; links are the same for each grasp and object.

    Args:
        T_joint_world: (4, 4) of the body's joint, with all joints at zero.
        excess: how far the finest covering spheres may stick out, metres; ten times that of
            what does not move.
    """
    placed = pin.SE3(np.frombuffer(T_joint_world).reshape(4, 4))
    rows = _GrowingRows()
    for number, part in enumerate(body.parts):
        step(f"covering {body.name} with spheres")
        spheres = sphere_trees(part.shape, excess if body.joint >= 0 else 10 * excess)
        rows.add(part.shape, spheres, placed * part.T_world_part, number)
    return rows.end(_summed_extent(body))


def _summed_extent(body: CollisionBody) -> float:
    """Metres along the three axes of the body's parts, added up."""
    corners = np.vstack(
        [
            convex.vertices @ part.T_world_part.rotation.T + part.T_world_part.translation
            for part in body.parts
            for convex in part.shape.sets
        ]
    )
    return float(np.ptp(corners, axis=0).sum())


class _GrowingRows:
    """Rows of a body as they grow."""

    def __init__(self) -> None:
        self.parts: list[tuple[int, int]] = []
        self.nodes: list[Indices] = []
        self.node_spheres: list[Array] = []
        self.node_inner: list[Array] = []
        self.sets: list[tuple[int, int, int, int]] = []
        self.set_part: list[int] = []
        self.radius: list[float] = []
        self.excess: list[float] = []
        self.inner: list[tuple[float, float, float, float]] = []
        self.vertices: list[Array] = []
        self.planes: list[Array] = []
        self.meshes: list[MeshTree] = []
        self.mesh_frames: list[Array] = []
        self.counts = [0, 0, 0]
        """Nodes, vertices, planes so far."""

    def add(self, shape: Shape, trees: tuple[SphereTree, ...], T: pin.SE3, part: int) -> None:
        """Add a shape with the spheres around each of its sets, at T in the body's joint."""
        mesh = -1
        if shape.mesh is not None:
            mesh = len(self.meshes)
            self.meshes.append(shape.mesh)
            self.mesh_frames.append(T.homogeneous)
        for convex, tree in zip(shape.sets, trees, strict=True):
            nodes, vertices, planes = self.counts
            number = len(self.sets)
            self.parts.append((nodes, number))
            self.nodes.append(np.column_stack([tree.skip + nodes, np.where(tree.leaf, number, -1)]))
            self.node_spheres.append(
                np.column_stack([tree.centers @ T.rotation.T + T.translation, tree.radii])
            )
            self.node_inner.append(tree.inner)
            exact = int(convex.inner_scale == 1.0) - int(convex.inner_scale == 0.0)
            self.sets.append((vertices, planes, exact, mesh))
            self.set_part.append(part)
            center = T.act(np.array(convex.inner_center))
            self.inner.append((*center.tolist(), convex.inner_scale))
            normals = convex.normals @ T.rotation.T
            self.vertices.append(convex.vertices @ T.rotation.T + T.translation)
            self.planes.append(np.column_stack([normals, convex.offsets + normals @ T.translation]))
            self.radius.append(convex.radius)
            self.excess.append(shape.excess)
            more = len(tree.radii), len(convex.vertices), len(convex.offsets)
            self.counts = [a + b for a, b in zip(self.counts, more, strict=True)]

    def end(self, extent: float) -> BodyRows:
        vertices = np.vstack(self.vertices)
        center, radius = bounding_sphere(vertices)
        return BodyRows(
            sphere=np.append(center, radius + (max(self.radius) + 1e-9)),
            parts=np.array(self.parts, dtype=np.int64),
            part_spheres=np.array([spheres[0] for spheres in self.node_spheres]),
            nodes=np.vstack(self.nodes),
            node_spheres=np.vstack(self.node_spheres),
            node_inner=np.concatenate(self.node_inner),
            sets=np.array(self.sets, dtype=np.int64),
            set_part=np.array(self.set_part, dtype=np.int64),
            radius=np.array(self.radius),
            excess=np.array(self.excess),
            inner=np.array(self.inner),
            vertices=vertices,
            planes=np.vstack(self.planes),
            meshes=tuple(self.meshes),
            mesh_frames=np.array(self.mesh_frames).reshape(-1, 4, 4),
            extent=extent,
        )
