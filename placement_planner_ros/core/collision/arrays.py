"""One arm, its hand, the object it holds and the rest of the robot as flat arrays for the kernels.

Bodies are links (and the held object). The moving ones come first; all else is fixed in the world.
Each body belongs to the last arm joint above it, or to none; its geometry is given in that joint's
frame, turned so that the joint's axis is z.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.collision.meshes import MeshArrays, MeshTree, shared_arrays
from placement_planner_ros.core.collision.pair_tables import (
    CELL,
    PairTables,
    TablePair,
    TableShape,
    pair_tables,
)
from placement_planner_ros.core.collision.shapes import Shape
from placement_planner_ros.core.collision.spheres import SphereTree, bounding_sphere, sphere_trees
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.robot.surface import Solid
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array

Indices = npt.NDArray[np.int64]


BODY_JOINT, BODY_FIRST_PART = 0, 1
PART_FIRST_NODE, PART_SET = 0, 1
NODE_SKIP, NODE_SET = 0, 1
SET_FIRST_VERTEX, SET_FIRST_PLANE, SET_JOINT, SET_EXACT, SET_MESH = 0, 1, 2, 3, 4
MESH_TREE, MESH_JOINT = 0, 1
PAIR_INNER, PAIR_OUTER, PAIR_SLOT, PAIR_OUTWARD, PAIR_TABLE = 0, 1, 2, 3, 4
"""Columns of the tables of `ArmArrays`."""


class ArmArrays(NamedTuple):
    """What the kernels read: n joints, b bodies, p parts, k spheres, s sets, g meshes, c pairs.

    A part is one convex set: a solid link, or one of the sets that cover a mesh.

    A range belonging to row i of a table runs from its `FIRST` column to that of row i + 1. Spheres
    are centre and radius. Joint n + 1 stands for the world.
    """

    fixed: Array
    """(n + 1, 4, 4) and `prismatic` (n,): of `kinematics.Chain`."""
    prismatic: npt.NDArray[np.bool_]
    moving: int
    """How many of the bodies, the first, the arm moves."""
    held: int
    """The held object's body, -1 without one."""
    bodies: Indices
    """(b + 1, 2) joint, first part."""
    body_spheres: Array
    """(b, 4) bounding spheres in the joint's frame."""
    parts: Indices
    """(p + 1, 2) first node, set."""
    part_spheres: Array
    """(p, 4)."""
    nodes: Indices
    """(k, 2) next node not below, set of a leaf (-1 above leaves)."""
    node_spheres: Array
    """(k, 4)."""
    node_inner: Array
    """(k,) radius of a ball around the sphere's centre that the part holds, -inf without one."""
    sets: Indices
    """(s + 1, 5) first vertex, first plane, joint, whether it is exact (1), contains its shape and
    is contained by it when scaled (0), or only contains it (-1), mesh that it covers, or -1."""
    radius: Array
    """(s,) that each set is dilated by."""
    excess: Array
    """(s,) no point of a set is further than this from its mesh, or what that encloses."""
    vertices: Array
    planes: Array
    """(f, 4) normal and offset."""
    inner: Array
    """(s, 4) of sets that are not exact: what they are scaled about, and by."""
    meshes: Indices
    """(g, 2) tree in `trees`, joint."""
    mesh_frames: Array
    """(g, 4, 4) T_joint_mesh."""
    trees: MeshArrays
    pairs: Indices
    """(c, 5) inner body, outer body, first remembered direction, first joint between them, and
    table, -1 without one."""
    tables: PairTables


class ArmScratch(NamedTuple):
    """Work space of one checker; not shared between threads."""

    frames: Array
    """(n + 2, 4, 4) T_world_joint with the axis along z, the tip, the world."""
    body_spheres: Array
    """(b, 4) in the world, as all that follow."""
    part_spheres: Array
    vertices: Array
    planes: Array
    bounds: Array
    """(s, 6) box around each set, lower then upper."""
    set_stamp: Indices
    """(s,) configuration at which a set was last placed in the world; `plane_stamp`: its planes."""
    plane_stamp: Indices
    plane: Indices
    """(s,) the plane of each set that last kept a box away, or -1."""
    box_stamp: Indices
    """(m,) visit in which an obstacle was last looked at."""
    counters: Indices
    """Configuration, visit, number of undecided pairs."""
    leaves: Indices
    """(k,) leaf spheres that the field leaves open; `leaf_bound` (k,): their distance at least."""
    leaf_bound: Array
    work: Array
    inner: Array
    """(2 v, 3) scaled copies of two sets."""
    mesh_points: Array
    """(v, 3) of what is held against a mesh, in its frame; `mesh_frame` (4, 4), and `stack` (., 2),
    pairs of nodes that wait."""
    mesh_frame: Array
    stack: Indices
    direction: Array
    """(., 6) direction that last kept a pair of parts apart, in the frames of both."""
    undecided: Indices
    """(., 3) kind (0 box, 1 set), set, box or set."""
    hit: Indices
    """(3,) the like of the collision found, or kind 2 and a sphere whose inner ball meets a box."""
    bound: Array
    """(b, n + 1) motion bounds, and `bound_straight` without the deviation."""
    bound_straight: Array
    edge: Array
    """(3, n) q at an interval's middle; how far joints move, without the deviation and with it."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A piece of geometry of a body, in the world with all arm joints at zero."""

    shape: Shape
    geometry: Solid
    T_world_part: pin.SE3


@dataclass(frozen=True, slots=True, eq=False)
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
class FlatArm:
    """The arrays, and what each of their rows is.

    Attributes:
        arrays: for the kernels.
        directions: how many to remember.
        bodies: in the order of the arrays.
        set_body, set_part: (s,) body of each set, and its part among the body's.
        joint_frames: T_world_joint with all joints at zero, axis along z.
    """

    arrays: ArmArrays
    directions: int
    bodies: tuple[CollisionBody, ...]
    set_body: Indices
    set_part: Indices
    joint_frames: tuple[pin.SE3, ...]


def flatten(
    chain: Chain,
    bodies: Iterable[CollisionBody],
    held: str | None,
    pairs: Iterable[tuple[str, str]],
    excess: float,
    clear: float,
) -> FlatArm:
    """Lay out an arm.

    Args:
        chain: the arm's joints.
        bodies: all, in any order.
        held: name of the held object's body.
        pairs: names of bodies to keep apart; pairs that cannot move to each other are dropped.
        excess: how far the finest covering spheres may stick out, metres.
        clear: what tables of pairs certify, metres.
    """
    joint_frames = [pin.SE3(T) for T in itertools.accumulate(chain.fixed[:-1], np.matmul)]
    # The outer and the larger collide most often.
    ordered = sorted(
        bodies, key=lambda b: (b.joint < 0, b.name != held, -b.joint, -_extent(b), b.name)
    )
    number = {body.name: i for i, body in enumerate(ordered)}
    flat = _Rows()
    for i, body in enumerate(ordered):
        T_joint_world = (
            joint_frames[body.joint].inverse() if body.joint >= 0 else pin.SE3.Identity()
        )
        for j, part in enumerate(body.parts):
            step(f"covering {body.name} with spheres")
            spheres = sphere_trees(part.shape, excess if body.joint >= 0 else 10 * excess)
            flat.add(part.shape, spheres, T_joint_world * part.T_world_part, i, j)
        flat.end_body()
    between = []
    for a, b in pairs:
        first, second = number[a], number[b]
        if ordered[first].joint > ordered[second].joint:
            first, second = second, first
        if ordered[first].joint != ordered[second].joint:
            between.append((first, second))
    # Outer links first: they collide most often.
    between.sort(key=lambda p: (-ordered[p[1]].joint, ordered[p[0]].joint))
    parts = np.diff(flat.first_part)
    sizes = [int(parts[a] * parts[b]) for a, b in between]
    world = chain.dof + 1
    rows, tables = _tables(chain, ordered, joint_frames, between, clear)
    arrays = ArmArrays(
        fixed=chain.fixed,
        prismatic=chain.prismatic,
        moving=sum(body.joint >= 0 for body in ordered),
        held=number[held] if held is not None else -1,
        pairs=np.array(
            [
                (a, b, slot, ordered[a].joint + 1, row)
                for (a, b), slot, row in zip(
                    between, itertools.accumulate(sizes, initial=0), rows, strict=False
                )
            ],
            dtype=np.int64,
        ).reshape(-1, 5),
        tables=tables,
        **flat.arrays([body.joint if body.joint >= 0 else world for body in ordered]),
    )
    return FlatArm(
        arrays,
        sum(sizes),
        tuple(ordered),
        np.array(flat.set_body, dtype=np.int64),
        np.array(flat.set_part, dtype=np.int64),
        tuple(joint_frames),
    )


def _extent(body: CollisionBody) -> float:
    """Metres along the three axes of the body's parts, added up."""
    corners = np.vstack(
        [
            convex.vertices @ part.T_world_part.rotation.T + part.T_world_part.translation
            for part in body.parts
            for convex in part.shape.sets
        ]
    )
    return float(np.ptp(corners, axis=0).sum())


def _tables(
    chain: Chain,
    bodies: list[CollisionBody],
    joint_frames: list[pin.SE3],
    pairs: list[tuple[int, int]],
    clear: float,
) -> tuple[list[int], PairTables]:
    """Table of each pair, -1 where it has none, and the tables."""
    tabled: list[TablePair] = []
    rows = []
    for a, b in pairs:
        inner, outer = bodies[a], bodies[b]
        joints = slice(inner.joint + 1, outer.joint + 1)
        lower, upper = chain.lower[joints], chain.upper[joints]
        fixed = chain.fixed[joints]
        if len(lower) == 1:
            # A second joint at the same place, which stays where it is.
            lower, upper = np.append(lower, -0.5 * CELL), np.append(upper, -0.5 * CELL)
            fixed = np.concatenate([fixed, np.eye(4)[None]])
        if (
            len(lower) == 2
            and inner.rigid
            and outer.rigid
            and not chain.prismatic[joints].any()
            and np.isfinite([*lower, *upper]).all()
        ):
            tabled.append(
                TablePair(
                    _table_shapes(inner, joint_frames),
                    _table_shapes(outer, joint_frames),
                    fixed.tobytes(),
                    tuple(lower.tolist()),
                    tuple(upper.tolist()),
                )
            )
            rows.append(len(tabled) - 1)
        else:
            rows.append(-1)
    return rows, pair_tables(tuple(tabled), clear)


def _table_shapes(body: CollisionBody, joint_frames: list[pin.SE3]) -> tuple[TableShape, ...]:
    zero = joint_frames[body.joint].inverse() if body.joint >= 0 else pin.SE3.Identity()
    return tuple(TableShape.of(part.shape, zero * part.T_world_part) for part in body.parts)


def with_own_object(flat: FlatArm, name: str, T_world_object: pin.SE3) -> FlatArm:
    """The same arm with that body at T_world_object, in arrays that may be written to.

    Only its `T_world_part` is set: `placed_object.PlacedObject` moves the rows.
    """
    arrays = flat.arrays
    own = arrays._replace(
        vertices=arrays.vertices.copy(),
        planes=arrays.planes.copy(),
        node_spheres=arrays.node_spheres.copy(),
        part_spheres=arrays.part_spheres.copy(),
        body_spheres=arrays.body_spheres.copy(),
        mesh_frames=arrays.mesh_frames.copy(),
    )
    bodies = tuple(
        replace(body, parts=tuple(replace(p, T_world_part=T_world_object) for p in body.parts))
        if body.name == name
        else body
        for body in flat.bodies
    )
    return replace(flat, arrays=own, bodies=bodies)


def scratch_for(flat: FlatArm, boxes: int) -> ArmScratch:
    """Work space for `flat` against `boxes` obstacles; fixed bodies are placed for good."""
    a = flat.arrays
    joints, sets = len(a.prismatic), len(a.radius)
    frames = np.zeros((joints + 2, 4, 4))
    frames[-1] = np.eye(4)
    bounds = np.zeros((sets, 6))
    first = a.sets[:-1, SET_FIRST_VERTEX]
    bounds[:, :3] = np.minimum.reduceat(a.vertices, first) - a.radius[:, None]
    bounds[:, 3:] = np.maximum.reduceat(a.vertices, first) + a.radius[:, None]
    fixed = a.sets[:-1, SET_JOINT] == joints + 1
    return ArmScratch(
        frames=frames,
        body_spheres=a.body_spheres.copy(),
        part_spheres=a.part_spheres.copy(),
        vertices=a.vertices.copy(),
        planes=a.planes.copy(),
        bounds=bounds,
        set_stamp=np.where(fixed, np.iinfo(np.int64).max, 0),
        plane_stamp=np.where(fixed, np.iinfo(np.int64).max, 0),
        plane=np.full(sets, -1, dtype=np.int64),
        box_stamp=np.zeros(boxes, dtype=np.int64),
        counters=np.zeros(3, dtype=np.int64),
        leaves=np.zeros(len(a.nodes), dtype=np.int64),
        leaf_bound=np.zeros(len(a.nodes)),
        work=np.zeros((6, 4)),
        inner=np.zeros((2 * int(np.diff(a.sets[:, SET_FIRST_VERTEX]).max(initial=0)), 3)),
        mesh_points=np.zeros((8 + int(np.diff(a.sets[:, SET_FIRST_VERTEX]).max(initial=0)), 3)),
        mesh_frame=np.zeros((4, 4)),
        stack=np.zeros((256, 2), dtype=np.int64),
        direction=np.zeros((flat.directions, 6)),
        undecided=np.zeros((256, 3), dtype=np.int64),
        hit=np.zeros(3, dtype=np.int64),
        bound=np.zeros((a.moving, joints + 1)),
        bound_straight=np.zeros((a.moving, joints + 1)),
        edge=np.zeros((3, joints)),
    )


class _Rows:
    """Rows of the tables as they grow."""

    def __init__(self) -> None:
        self.first_part = [0]
        self.parts: list[tuple[int, int]] = []
        self.part_spheres: list[Array] = []
        self.body_spheres: list[tuple[float, float, float, float]] = []
        self.nodes: list[Indices] = []
        self.node_spheres: list[Array] = []
        self.node_inner: list[Array] = []
        self.sets: list[tuple[int, int, int, int, int]] = []
        self.excess: list[float] = []
        self.inner: list[tuple[float, float, float, float]] = []
        self.meshes: list[tuple[MeshTree, int]] = []
        self.mesh_frames: list[Array] = []
        self.set_body: list[int] = []
        self.set_part: list[int] = []
        self.radius: list[float] = []
        self.vertices: list[Array] = []
        self.planes: list[Array] = []
        self.ends = np.zeros(4, dtype=np.int64)
        """Nodes, sets, vertices, planes so far."""

    def add(
        self, shape: Shape, trees: Sequence[SphereTree], T: pin.SE3, body: int, part: int
    ) -> None:
        """Add a shape with the spheres around each of its sets, at T in the body's joint."""
        mesh = -1
        if shape.mesh is not None:
            mesh = len(self.meshes)
            self.meshes.append((shape.mesh, body))
            self.mesh_frames.append(T.homogeneous)
        for convex, tree in zip(shape.sets, trees, strict=True):
            nodes, sets, _, _ = self.ends.tolist()
            spheres = np.column_stack([tree.centers @ T.rotation.T + T.translation, tree.radii])
            self.parts.append((nodes, sets))
            self.part_spheres.append(spheres[0])
            self.nodes.append(np.column_stack([tree.skip + nodes, np.where(tree.leaf, sets, -1)]))
            self.node_spheres.append(spheres)
            self.node_inner.append(tree.inner)
            exact = int(convex.inner_scale == 1.0) - int(convex.inner_scale == 0.0)
            self.sets.append((int(self.ends[2]), int(self.ends[3]), body, exact, mesh))
            center = T.act(np.array(convex.inner_center))
            self.inner.append((*center.tolist(), convex.inner_scale))
            normals = convex.normals @ T.rotation.T
            self.vertices.append(convex.vertices @ T.rotation.T + T.translation)
            self.planes.append(np.column_stack([normals, convex.offsets + normals @ T.translation]))
            self.radius.append(convex.radius)
            self.excess.append(shape.excess)
            self.set_body.append(body)
            self.set_part.append(part)
            self.ends += (len(spheres), 1, len(convex.vertices), len(convex.offsets))

    def end_body(self) -> None:
        first = self.parts[self.first_part[-1]][1]
        self.first_part.append(len(self.parts))
        corners = np.ascontiguousarray(np.vstack(self.vertices[first:]))
        center, radius = bounding_sphere(corners)
        radius += max(self.radius[first:]) + 1e-9
        self.body_spheres.append((*center.tolist(), radius))

    def arrays(self, joints: list[int]) -> dict[str, Any]:
        """The tables, given the joint of each body."""
        nodes, sets, vertices, planes = self.ends.tolist()
        rows = [(*ends, joints[body], exact, mesh) for *ends, body, exact, mesh in self.sets]
        # In the same order for each arm of a robot, so that they share the arrays.
        trees = list(dict.fromkeys(tree for tree, _ in sorted(self.meshes, key=_content)))
        number = {tree: i for i, tree in enumerate(trees)}
        meshes = [(number[tree], joints[body]) for tree, body in self.meshes]
        return {
            "bodies": np.column_stack([[*joints, 0], self.first_part]).astype(np.int64),
            "body_spheres": np.array(self.body_spheres),
            "parts": np.array([*self.parts, (nodes, sets)], dtype=np.int64),
            "part_spheres": np.array(self.part_spheres),
            "nodes": np.vstack(self.nodes),
            "node_spheres": np.vstack(self.node_spheres),
            "node_inner": np.concatenate(self.node_inner),
            "sets": np.array([*rows, (vertices, planes, 0, 0, -1)], dtype=np.int64),
            "radius": np.array(self.radius),
            "excess": np.array(self.excess),
            "inner": np.array(self.inner),
            "meshes": np.array(meshes, dtype=np.int64).reshape(-1, 2),
            "mesh_frames": np.array(self.mesh_frames).reshape(-1, 4, 4),
            "trees": shared_arrays(tuple(trees)),
            "vertices": np.vstack(self.vertices),
            "planes": np.vstack(self.planes),
        }


def _content(mesh: tuple[MeshTree, int]) -> tuple[int, float]:
    """What orders the meshes of a robot."""
    tree, _ = mesh
    return len(tree.corners), float(tree.corners.sum())
