"""One arm, its hand, the object it holds and the rest of the robot as flat arrays for the kernels.

Bodies are links (and the held object). The moving ones come first; all else is fixed in the world.
Each body belongs to the last arm joint above it, or to none; its geometry is given in that joint's
frame, turned so that the joint's axis is z.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.collision.meshes import MeshArrays, shared_arrays
from placement_planner_ros.core.collision.solids import CollisionBody, SolidRows
from placement_planner_ros.core.collision.spheres import body_rows
from placement_planner_ros.core.disk_cache import digest_of
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.types import Array, Index, Mask, frozen_array

BODY_JOINT, BODY_FIRST_SET = 0, 1
NODE_SKIP, NODE_SET = 0, 1
SET_FIRST_NODE, SET_FIRST_VERTEX, SET_JOINT, SET_MESH = 0, 1, 2, 3
MESH_TREE, MESH_JOINT = 0, 1
PAIR_INNER, PAIR_OUTER, PAIR_SLOT, PAIR_OUTWARD = 0, 1, 2, 3
PAIR_ROWS, PAIR_COLUMNS, PAIR_CELL = 4, 5, 6
"""Columns of the tables of `ArmArrays`."""

CELL_RAD = 2.0 * math.pi / 720.0
"""Side of the cells of `ArmArrays.tables`."""

NO_TABLES = np.zeros(0, dtype=np.uint8)
NO_TABLES.setflags(write=False)


class ArmArrays(NamedTuple):
    """What the kernels read: n joints, b bodies, s convex sets, k spheres, g meshes, c pairs.

    A set is a solid link, or one of those that cover a mesh.

    A range belonging to row i of a table runs from its `FIRST` column to that of row i + 1. Spheres
    are centre and radius. Joint n + 1 stands for the world, n + 2 for the object placed in it.
    """

    fixed: Array
    """(n + 1, 4, 4) and `prismatic` (n,): of `kinematics.Chain`."""
    prismatic: Mask
    moving: int
    """How many of the bodies, the first, the arm moves."""
    held: int
    """The held object's body, -1 without one."""
    bodies: Index
    """(b + 1, 2) joint, first set."""
    body_spheres: Array
    """(b, 4) bounding spheres in the joint's frame."""
    nodes: Index
    """(k, 2) next node not below, set of a leaf (-1 above leaves)."""
    node_spheres: Array
    """(k, 5), behind centre and radius that of a ball around the same centre which the shape holds,
    -inf without one."""
    sets: Index
    """(s + 1, 4) first node, first vertex, joint, mesh that it covers, or -1."""
    radius: Array
    """(s,) that each set is dilated by."""
    vertices: Array
    meshes: Index
    """(g, 2) tree in `trees`, joint."""
    mesh_frames: Array
    """(g, 4, 4) T_joint_mesh."""
    trees: MeshArrays
    pairs: Index
    """(c, 7) inner body, outer body, first remembered direction, first joint between them; of their
    table of angles the cells along that joint, none without a table, along the second, one without,
    and the first in `tables`."""
    movers: Index
    """(. + c, 2) per item, the moving bodies and then the pairs, the body that moves and the first
    joint that moves it: in a pair those inward of both move both alike."""
    pair_lower: Array
    """(c, 2) angles at which the first cells begin, rad."""
    tables: npt.NDArray[np.uint8]
    """Of each cell how many cells away the nearest is where the pair may be nearer than `clear`."""
    clear: float
    """Metres."""


class ArmScratch(NamedTuple):
    """Work space of one checker; not shared between threads."""

    frames: Array
    """(n + 3, 4, 4) T_world_joint with the axis along z, the tip, the world, the placed object."""
    body_spheres: Array
    """(b, 4) in the world, as all that follow."""
    set_spheres: Array
    vertices: Array
    bounds: Array
    """(s, 6) box around each set, lower then upper."""
    body_stamp: Index
    """(b,) configuration at which the spheres of a body's sets were last placed in the world."""
    set_stamp: Index
    """(s,) configuration at which a set was last placed in the world."""
    sides: Array
    """(s, 4) unit direction that last kept a box away from each set, in its joint's frame, and how
    far its vertices reach along it; 0 and infinite without."""
    side: Array
    """(4,) that of the set that is looked at, in the world, and from where along it boxes are far
    enough away."""
    leaves: Index
    """(k,) leaf spheres that the field leaves open; `leaf_bounds`: how far they are from boxes, at
    least; `leaf_ends` (b + 1,), how many of each body."""
    leaf_bounds: Array
    leaf_ends: Index
    asked: Index
    """(. + c,) the items that are asked for, ascending."""
    motion: Array
    """(. + c,) how far each moving body moves, then those of each pair to each other, metres; then
    0 where that is not kept."""
    stamp: Index
    """(1,) that of the configuration."""
    sweep: Array
    """(1,) how far all bodies are swept straight up, metres: vertices are made so."""
    work: Array
    mesh_points: Array
    """(v, 3) of what is held against a mesh, in its frame; `mesh_frames` (3, 4, 4), of one mesh, of
    another, and of that one in the first."""
    mesh_frames: Array
    mesh_pairs: Index
    """(64, 2) nodes of two meshes that wait."""
    direction: Array
    """(., 6) direction that last kept a pair of parts apart, in the frames of both."""
    hit: Index
    """(3,) what was last not kept apart: kind (0 set and box, 1 two sets, 2 a sphere whose inner
    ball meets a box), set or sphere, box or set."""
    bound: Array
    """(b, n + 1) motion bounds, and `bound_straight` of the whole edge from its middle on, without
    the deviation."""
    bound_straight: Array
    edge: Array
    """(3, n) q at an interval's middle; how far joints move along the whole edge, and within the
    interval with the deviation."""


@dataclass(frozen=True, slots=True, eq=False)
class FlatArm:
    """The arrays, and what each of their rows is.

    Attributes:
        arrays: for the kernels.
        directions: how many to remember.
        bodies: in the order of the arrays.
        set_body: (s,) body of each set.
        rows: of each body, in its joint's frame.
    """

    arrays: ArmArrays
    directions: int
    bodies: tuple[CollisionBody, ...]
    set_body: Index
    rows: tuple[SolidRows, ...]

    def digest(self, body: int) -> str:
        """Of the shape of a body, in its joint's frame."""
        rows = self.rows[body]
        meshes = [tree.digest for tree in rows.meshes]
        return digest_of(rows.vertices, rows.radius, rows.mesh_frames, *meshes)


def lay_out_arm(
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
    # The bodies' rows, each in the frame of its joint with all joints at zero.
    joint_frames = itertools.accumulate(chain.fixed[:-1], np.matmul)
    at_zero = [*map(np.linalg.inv, joint_frames), np.eye(4)]  # the last of what no joint moves
    laid_out = [
        (body, *body_rows(body, at_zero[max(body.joint, -1)].tobytes(), excess)) for body in bodies
    ]
    # The outer and the larger collide most often.
    laid_out.sort(
        key=lambda b: (b[0].joint < 0, b[0].name != held, -b[0].joint, -b[2][3], b[0].name)
    )
    ordered, rows, balls = zip(*laid_out, strict=True)
    number = {body.name: i for i, body in enumerate(ordered)}
    joints = [body.joint if body.joint >= 0 else chain.dof - body.joint for body in ordered]
    # Pairs of bodies, the inner one first; those on one joint do not move against each other,
    # nor do those that no joint moves.
    between = []
    for a, b in pairs:
        first, second = number[a], number[b]
        if ordered[first].joint > ordered[second].joint:
            first, second = second, first
        if ordered[first].joint != ordered[second].joint >= 0:
            between.append((first, second))
    # Outer links first: they collide most often.
    between.sort(key=lambda p: (-ordered[p[1]].joint, ordered[p[0]].joint))
    # Room for a direction for each pair of parts.
    sizes = [len(rows[a].radius) * len(rows[b].radius) for a, b in between]
    slots = itertools.accumulate(sizes, initial=0)
    pairs_of = [
        (a, b, slot, max(ordered[a].joint, -1) + 1, 0, 0, 0)
        for (a, b), slot in zip(between, slots, strict=False)
    ]
    moving = sum(body.joint >= 0 for body in ordered)
    arrays = ArmArrays(
        fixed=chain.fixed,
        prismatic=chain.prismatic,
        moving=moving,
        held=number[held] if held is not None else -1,
        **_stack_bodies(rows, joints, balls),
        **pair_arrays(moving, np.array(pairs_of, dtype=np.int64).reshape(-1, 7)),
    )
    set_body = np.repeat(np.arange(len(rows)), [len(each.radius) for each in rows])
    return FlatArm(arrays, sum(sizes), ordered, set_body, rows)


def lone_body(rows: SolidRows) -> FlatArm:
    """A body that frame 0 moves, as an arm without joints."""
    arrays = ArmArrays(
        fixed=frozen_array(np.eye(4)[None]),
        prismatic=np.broadcast_to(np.False_, 0),
        moving=1,
        held=-1,
        **_stack_bodies([rows], [0], [rows.ball()]),
        **pair_arrays(1, np.zeros((0, 7), dtype=np.int64)),
    )
    return FlatArm(arrays, 0, (), np.zeros(len(rows.radius), dtype=np.int64), (rows,))


def scratch_for(flat: FlatArm) -> ArmScratch:
    """Work space for `flat`; fixed bodies are placed for good."""
    a = flat.arrays
    # Frames of joints and tip; of the world and the placed object, which stay as they are.
    joints, sets = len(a.prismatic), len(a.radius)
    frames = np.zeros((joints + 3, 4, 4))
    frames[-2:] = np.eye(4)
    fixed = a.sets[:-1, SET_JOINT] > joints
    return ArmScratch(
        frames=frames,
        body_spheres=a.body_spheres.copy(),
        set_spheres=a.node_spheres[a.sets[:-1, SET_FIRST_NODE], :4],
        vertices=a.vertices.copy(),
        bounds=np.vstack([rows.boxes() for rows in flat.rows]),
        body_stamp=np.where(np.arange(len(a.bodies)) < a.moving, 0, np.iinfo(np.int64).max),
        set_stamp=np.where(fixed, np.iinfo(np.int64).max, 0),
        sides=np.tile([0.0, 0.0, 0.0, np.inf], (sets, 1)),
        side=np.zeros(4),
        leaves=np.zeros(len(a.nodes), dtype=np.int64),
        leaf_bounds=np.zeros(len(a.nodes)),
        leaf_ends=np.zeros(a.moving + 1, dtype=np.int64),
        asked=np.zeros(len(a.movers), dtype=np.int64),
        motion=np.zeros(len(a.movers)),
        stamp=np.zeros(1, dtype=np.int64),
        sweep=np.zeros(1),
        work=np.zeros((9, 4)),
        mesh_points=np.zeros((8 + int(np.diff(a.sets[:, SET_FIRST_VERTEX]).max(initial=0)), 3)),
        mesh_frames=np.zeros((3, 4, 4)),
        mesh_pairs=np.zeros((64, 2), np.int64),
        direction=np.zeros((flat.directions, 6)),
        hit=np.zeros(3, dtype=np.int64),
        bound=np.zeros((a.moving, joints + 1)),
        bound_straight=np.zeros((a.moving, joints + 1)),
        edge=np.zeros((3, joints)),
    )


def place_body(flat: FlatArm, scratch: ArmScratch, body: int, T_world_body: pin.SE3) -> None:
    """Put a body that stands in the world, at the origin in `flat`, at that pose."""
    a, rows = flat.arrays, flat.rows[body].moved(T_world_body)
    sets = slice(*a.bodies[body : body + 2, BODY_FIRST_SET].tolist())
    vertices = slice(*a.sets[[sets.start, sets.stop], SET_FIRST_VERTEX].tolist())
    scratch.frames[a.bodies[body, BODY_JOINT]] = T_world_body.homogeneous
    scratch.body_spheres[body, :3] = T_world_body.act(a.body_spheres[body, :3])
    scratch.set_spheres[sets] = rows.node_spheres[rows.sets[:, SET_FIRST_NODE], :4]
    scratch.vertices[vertices] = rows.vertices
    scratch.bounds[sets] = rows.boxes()


def pair_arrays(moving: int, pairs: Index) -> dict[str, Any]:
    """The fields that pairs make, without tables.

    Args:
        moving: how many bodies the arm moves.
        pairs: (c, 7).
    """
    bodies = np.column_stack([np.arange(moving), np.zeros(moving, dtype=np.int64)])
    return {
        "pairs": pairs,
        # in C order where there is one body, too, or kernels are compiled for it
        "movers": np.ascontiguousarray(np.vstack([bodies, pairs[:, [PAIR_OUTER, PAIR_OUTWARD]]])),
        "pair_lower": np.zeros((len(pairs), 2)),
        "tables": NO_TABLES,
        "clear": 0.0,
    }


def _stack_bodies(
    bodies: Sequence[SolidRows], joints: Sequence[int], balls: Sequence[Array]
) -> dict[str, Any]:
    """The rows of bodies (b), of joints (b), one below the other."""
    rows = SolidRows.joined(bodies)
    sets = [len(each.radius) for each in bodies]
    ends = [*rows.sizes[:1], *rows.sizes[2:3], 0, -1]
    # In the same order for each arm of a robot, so that they share the arrays.
    ordered = sorted(rows.meshes, key=lambda tree: (len(tree.corners), float(tree.corners.sum())))
    trees = list(dict.fromkeys(ordered))
    number = {tree: i for i, tree in enumerate(trees)}
    meshes = np.column_stack(
        [
            [number[tree] for tree in rows.meshes],
            np.repeat(joints, [len(each.meshes) for each in bodies]),
        ]
    )
    return {
        "bodies": np.column_stack([[*joints, 0], np.cumsum([0, *sets])]).astype(np.int64),
        "body_spheres": np.array(balls),
        "sets": np.vstack([np.insert(rows.sets, SET_JOINT, np.repeat(joints, sets), axis=1), ends]),
        "meshes": meshes.astype(np.int64).reshape(-1, 2),
        "trees": shared_arrays(tuple(trees)),
        **{name: getattr(rows, name) for name in _AS_THEY_ARE},
    }


_AS_THEY_ARE = "nodes", "node_spheres", "radius", "vertices", "mesh_frames"
"""Fields that `ArmArrays` has from `SolidRows`."""
