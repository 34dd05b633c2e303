"""One arm, its hand, the object it holds and the rest of the robot as flat arrays for the kernels.

Bodies are links (and the held object). The moving ones come first; all else is fixed in the world.
Each body belongs to the last arm joint above it, or to none; its geometry is given in that joint's
frame, turned so that the joint's axis is z.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.robot.collision_shapes import ConvexSet, Shape
from placement_planner_ros.core.robot.kinematics import Chain
from placement_planner_ros.core.robot.spheres import SphereTree, bounding_sphere, sphere_tree
from placement_planner_ros.core.types import Array

Indices = npt.NDArray[np.int64]


class ArmArrays(NamedTuple):
    """What the kernels read; b bodies, p parts, k spheres, s sets, n joints."""

    fixed: Array
    """(n + 1, 4, 4) and `prismatic` (n,): of `kinematics.Chain`."""
    prismatic: npt.NDArray[np.bool_]
    moving: int
    """The first bodies, which the arm moves."""
    held: int
    """The held object's body, -1 without one."""
    body_joint: Indices
    """(b,) joint index, -1 for the world."""
    body_center: Array
    """(b, 3) and `body_radius` (b,): bounding sphere in the joint's frame."""
    body_radius: Array
    body_parts: Indices
    """(b + 1,) first part of each body."""
    part_center: Array
    part_radius: Array
    part_solid: npt.NDArray[np.bool_]
    """(p,) one convex set, or a surface of many."""
    part_nodes: Indices
    """(p + 1,) first sphere of each part."""
    part_sets: Indices
    """(p + 1,) first set of each part."""
    node_center: Array
    node_radius: Array
    node_skip: Indices
    node_first: Indices
    node_last: Indices
    set_joint: Indices
    set_vertices: Indices
    """(s + 1,) first vertex of each set."""
    set_planes: Indices
    """(s + 1,) first plane of each set."""
    set_radius: Array
    set_exact: npt.NDArray[np.bool_]
    vertices: Array
    normals: Array
    offsets: Array
    pairs: Indices
    """(c, 2) bodies to keep apart; the first is the nearer to the root."""
    pair_slot: Indices
    """(c,) where the pair's remembered directions start."""


class ArmScratch(NamedTuple):
    """Work space of one checker; not shared between threads."""

    frames: Array
    """(n + 1, 4, 4) T_world_joint with the axis along z, then the tip."""
    vertices: Array
    """(v, 3) world."""
    normals: Array
    offsets: Array
    bounds: Array
    """(s, 6) world box of each set, lower then upper."""
    set_stamp: Indices
    box_stamp: Indices
    counters: Indices
    """Configuration, visit, number of undecided pairs."""
    work: Array
    direction: Array
    """Last separating direction of each pair of solid parts."""
    undecided: Indices
    """(256, 3) kind (0 box, 1 set), set, box or set."""
    hit: Indices
    """(3,) the like for the first certain collision."""
    bound: Array
    """(b, n + 1) motion bounds, and `bound_straight` without the deviation."""
    bound_straight: Array


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A piece of geometry of a body, in the world with all arm joints at zero."""

    shape: Shape
    geometry: coal.CollisionGeometry
    T_world_part: pin.SE3


@dataclass(frozen=True, slots=True, eq=False)
class CollisionBody:
    """A link or the held object.

    Attributes:
        name: of the link.
        joint: index of the last arm joint above it, -1 where none is.
        parts: its geometry.
    """

    name: str
    joint: int
    parts: tuple[Part, ...]


@dataclass(frozen=True, slots=True, eq=False)
class FlatArm:
    """The arrays, and what each of their rows is.

    Attributes:
        arrays: for the kernels.
        bodies: in the order of the arrays.
        set_body, set_part: (s,) body of each set, and its part among the body's.
        joint_frames: T_world_joint with all joints at zero, axis along z.
    """

    arrays: ArmArrays
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
) -> FlatArm:
    """Lay out an arm.

    Args:
        chain: the arm's joints.
        bodies: all, in any order.
        held: name of the held object's body.
        pairs: names of bodies to keep apart; pairs that cannot move to each other are dropped.
        excess: how far the finest covering spheres may stick out, metres.
    """
    joint_frames = [pin.SE3(T) for T in itertools.accumulate(chain.fixed[:-1], np.matmul)]
    ordered = sorted(bodies, key=lambda b: (b.joint < 0, b.name != held, -b.joint))
    number = {body.name: i for i, body in enumerate(ordered)}
    trees: list[SphereTree] = []
    flat = _Rows()
    for i, body in enumerate(ordered):
        T_joint_world = (
            joint_frames[body.joint].inverse() if body.joint >= 0 else pin.SE3.Identity()
        )
        for j, part in enumerate(body.parts):
            tree = sphere_tree(part.shape, excess if body.joint >= 0 else 10 * excess)
            trees.append(tree)
            flat.add(tree, part.shape.solid, T_joint_world * part.T_world_part, body.joint, i, j)
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
    parts = np.diff(flat.body_parts)
    sizes = [int(parts[a] * parts[b]) for a, b in between]
    arrays = ArmArrays(
        fixed=np.array(chain.fixed),
        prismatic=np.array(chain.prismatic),
        moving=sum(body.joint >= 0 for body in ordered),
        held=number[held] if held is not None else -1,
        body_joint=np.array([body.joint for body in ordered], dtype=np.int64),
        pairs=np.array(between, dtype=np.int64).reshape(-1, 2),
        pair_slot=np.cumsum([0, *sizes], dtype=np.int64),
        **flat.arrays(),
    )
    return FlatArm(
        arrays,
        tuple(ordered),
        np.array(flat.set_body, dtype=np.int64),
        np.array(flat.set_part, dtype=np.int64),
        tuple(joint_frames),
    )


def scratch_for(flat: FlatArm, boxes: int) -> ArmScratch:
    """Work space for `flat` against `boxes` obstacles; fixed bodies are placed for good."""
    a = flat.arrays
    sets, joints = len(a.set_radius), len(a.prismatic)
    bounds = np.zeros((sets, 6))
    for s in range(sets):
        corners = a.vertices[a.set_vertices[s] : a.set_vertices[s + 1]]
        bounds[s] = (
            *(corners.min(axis=0) - a.set_radius[s]),
            *(corners.max(axis=0) + a.set_radius[s]),
        )
    fixed = a.set_joint < 0
    return ArmScratch(
        frames=np.zeros((joints + 1, 4, 4)),
        vertices=a.vertices.copy(),
        normals=a.normals.copy(),
        offsets=a.offsets.copy(),
        bounds=bounds,
        set_stamp=np.where(fixed, np.iinfo(np.int64).max, 0),
        box_stamp=np.zeros(boxes, dtype=np.int64),
        counters=np.zeros(3, dtype=np.int64),
        work=np.zeros((6, 4)),
        direction=np.zeros((int(a.pair_slot[-1]), 3)),
        undecided=np.zeros((256, 3), dtype=np.int64),
        hit=np.zeros(3, dtype=np.int64),
        bound=np.zeros((len(flat.bodies), joints + 1)),
        bound_straight=np.zeros((len(flat.bodies), joints + 1)),
    )


class _Rows:
    """Rows of the geometry arrays as they grow."""

    def __init__(self) -> None:
        self.body_parts = [0]
        self.part_nodes = [0]
        self.part_sets = [0]
        self.part_solid: list[bool] = []
        self.part_sphere: list[Array] = []
        self.body_sphere: list[tuple[Array, float]] = []
        self.nodes: list[tuple[Array, Array, Indices, Indices, Indices]] = []
        self.set_vertices = [0]
        self.set_planes = [0]
        self.set_joint: list[int] = []
        self.set_body: list[int] = []
        self.set_part: list[int] = []
        self.set_radius: list[float] = []
        self.set_exact: list[bool] = []
        self.vertices: list[Array] = []
        self.normals: list[Array] = []
        self.offsets: list[Array] = []

    def add(
        self, tree: SphereTree, solid: bool, T: pin.SE3, joint: int, body: int, part: int
    ) -> None:
        node, first_set = self.part_nodes[-1], self.part_sets[-1]
        centers = tree.centers @ T.rotation.T + T.translation
        leaf = tree.first >= 0
        self.nodes.append(
            (
                centers,
                tree.radii,
                tree.skip + node,
                np.where(leaf, tree.first + first_set, -1),
                np.where(leaf, tree.last + first_set, -1),
            )
        )
        self.part_nodes.append(node + len(centers))
        self.part_sets.append(first_set + len(tree.sets))
        self.part_solid.append(solid)
        self.part_sphere.append(np.array([*centers[0], tree.radii[0]]))
        for convex in tree.sets:
            self._add_set(convex, T)
            self.set_joint.append(joint)
            self.set_body.append(body)
            self.set_part.append(part)

    def _add_set(self, convex: ConvexSet, T: pin.SE3) -> None:
        normals = convex.normals @ T.rotation.T
        self.vertices.append(convex.vertices @ T.rotation.T + T.translation)
        self.normals.append(normals)
        self.offsets.append(convex.offsets + normals @ T.translation)
        self.set_vertices.append(self.set_vertices[-1] + len(convex.vertices))
        self.set_planes.append(self.set_planes[-1] + len(convex.offsets))
        self.set_radius.append(convex.radius)
        self.set_exact.append(convex.exact)

    def end_body(self) -> None:
        first, last = self.body_parts[-1], len(self.part_solid)
        self.body_parts.append(last)
        sets = range(self.part_sets[first], self.part_sets[last])
        corners = np.ascontiguousarray(np.vstack([self.vertices[s] for s in sets]))
        center, radius = bounding_sphere(corners)
        radius += max(self.set_radius[s] for s in sets) + 1e-9
        self.body_sphere.append((center, radius))

    def arrays(self) -> dict[str, Any]:
        def stack(rows: list[Array], width: int) -> Array:
            return np.ascontiguousarray(np.vstack([np.zeros((0, width)), *rows]))

        spheres = np.array(self.part_sphere).reshape(-1, 4)
        center, radius, skip, first, last = (
            np.concatenate(column) for column in zip(*self.nodes, strict=True)
        )
        return {
            "body_center": np.array([c for c, _ in self.body_sphere]),
            "body_radius": np.array([r for _, r in self.body_sphere]),
            "body_parts": np.array(self.body_parts, dtype=np.int64),
            "part_center": np.ascontiguousarray(spheres[:, :3]),
            "part_radius": np.ascontiguousarray(spheres[:, 3]),
            "part_solid": np.array(self.part_solid, dtype=np.bool_),
            "part_nodes": np.array(self.part_nodes, dtype=np.int64),
            "part_sets": np.array(self.part_sets, dtype=np.int64),
            "node_center": np.ascontiguousarray(center),
            "node_radius": np.ascontiguousarray(radius),
            "node_skip": skip,
            "node_first": first,
            "node_last": last,
            "set_joint": np.array(self.set_joint, dtype=np.int64),
            "set_vertices": np.array(self.set_vertices, dtype=np.int64),
            "set_planes": np.array(self.set_planes, dtype=np.int64),
            "set_radius": np.array(self.set_radius),
            "set_exact": np.array(self.set_exact, dtype=np.bool_),
            "vertices": stack(self.vertices, 3),
            "normals": stack(self.normals, 3),
            "offsets": np.concatenate(self.offsets),
        }
