"""Collision of an arm, its hand and the object it holds: with the obstacle set and with the robot.

The kernels say free only where that is certain. What lies within `separation.BOUND_TOLERANCE_M` of
a margin is not free: `free` is never true nearer than the margin.
"""

from __future__ import annotations

import copy
import functools
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision import arrays as at
from placement_planner_ros.core.collision.against_boxes import KeptMargins
from placement_planner_ros.core.collision.arrays import (
    ArmArrays,
    FlatArm,
    lay_out_arm,
    place_body,
    scratch_for,
)
from placement_planner_ros.core.collision.attached_object import (
    AttachedObject,
    PlacedObject,
    object_solids,
)
from placement_planner_ros.core.collision.boxes import box_arrays
from placement_planner_ros.core.collision.configurations import check_hands, check_states
from placement_planner_ros.core.collision.edges import EdgeLimits, JointEdge, check_edge
from placement_planner_ros.core.collision.pair_tables import with_pair_tables
from placement_planner_ros.core.collision.separation import BOUND_TOLERANCE_M
from placement_planner_ros.core.collision.shapes import Shape, link_shapes
from placement_planner_ros.core.collision.solids import PLACED_JOINT, CollisionBody
from placement_planner_ros.core.errors import JointStateError
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.robot.arm import Arm, MovingArm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.settings import Settings, setting
from placement_planner_ros.core.types import Array, Mask, kernel_input
from placement_planner_ros.core.weak_cache import weak_lru_cache

HELD_OBJECT = "the held object"
PLACED_OBJECT = "the placed object"
ENVIRONMENT = "an obstacle"
_QUEUED_INTERVALS = 4096
"""Of an edge that wait at a time."""
_REMEMBERED_ARMS = 32
"""Arms laid out, and rooms for their edges, that are remembered."""


@dataclass(frozen=True, slots=True)
class CollisionSettings(Settings):
    """Distances to keep.

    Attributes:
        obstacle_error: how far obstacles may be from where they were measured.
        self_margin: links and object from each other.
        planning_reserve: what planning keeps beyond both margins, so that a motion can still be
            certified when it is rounded and timed; pass it as `reserve`.
        approach_stray: how far the object may stray from the vertical on its straight way down;
            c_f(x) keeps as much beyond the margin.
        self_reserve: how much of a `reserve` counts for the robot against itself, whose links may
            pass each other by less than a millimetre wherever they are.
        edge_resolution: an edge is refused where its distance to the margin is below the motion of
            this short a piece of it; `self_resolution` is the same for the robot against itself.
        cover_excess: how far the finest covering spheres may stick out of a link.
    """

    collision_margin: float = setting(
        0.003, "[0, 0.1]", "m", "Distance that arm, hand and object keep from obstacles."
    )
    contact_tolerance: float = setting(
        0.003,
        "[0.0001, 0.02]",
        "m",
        "Surface within this distance of the contact plane supports the object.",
    )
    obstacle_error: float = setting(0.0, "[0, 0.1]", "m")
    self_margin: float = setting(0.0, "[0, 0.1]", "m")
    planning_reserve: float = setting(0.001, "[0, 0.1]", "m")
    approach_stray: float = setting(0.0002, "[0, 0.1]", "m")
    self_reserve: float = setting(0.0002, "[0, 0.1]", "m")
    edge_resolution: float = setting(0.0005, "[0.00001, 0.1]", "m")
    self_resolution: float = setting(0.00005, "[0.00001, 0.1]", "m")
    cover_excess: float = setting(0.02, "[0.001, 0.1]", "m")

    @property
    def obstacle_margin(self) -> float:
        """Metres to keep from obstacles as they were measured."""
        return self.collision_margin + self.obstacle_error

    @property
    def clear(self) -> float:
        """Metres from obstacles at which it is certain that `can_be_left`."""
        kept = self.obstacle_margin + self.planning_reserve + self.edge_resolution
        return kept + 2.0 * BOUND_TOLERANCE_M


@dataclass(frozen=True, slots=True, eq=False)
class Meeting:
    """What meets what at a configuration, and where.

    Attributes:
        first, second: links, `HELD_OBJECT`, `PLACED_OBJECT` or `ENVIRONMENT`.
        where: (3,) m.
    """

    first: str
    second: str
    where: Array

    def __str__(self) -> str:
        x, y, z = self.where
        return f"{self.first} meets {self.second} at ({x:.3f}, {y:.3f}, {z:.3f})"


@functools.lru_cache(maxsize=_REMEMBERED_ARMS)
def _edge_room(movers: int, thread: int) -> tuple[Array, Mask]:
    """What `check_edge` works in: in each thread one for all of so many bodies and pairs."""
    return np.zeros((_QUEUED_INTERVALS, 2)), np.zeros((_QUEUED_INTERVALS, movers), dtype=np.bool_)


class ArmCollision:
    """One arm with one object in one grasp, all other joints at rest.

    Not to be shared between threads: the kernels work in its buffers.

    Args:
        moving: the arm, and where the rest of the robot is.
        load: the object, held or standing; None for an empty hand with nothing around it.
        obstacles: the environment.
        settings: margins.
        aside: those of the obstacles that are no support, whatever the held object comes to stand
            on: it keeps the margins from them at contact too. None where there are none.

    Raises:
        RobotError: a link's geometry is of an unknown kind.
    """

    def __init__(
        self,
        moving: MovingArm,
        load: AttachedObject | PlacedObject | None,
        obstacles: ObstacleSet,
        settings: CollisionSettings | None = None,
        aside: ObstacleSet | None = None,
    ) -> None:
        self.settings = settings or CollisionSettings()
        self._obstacles = obstacles
        arm = moving.arm
        self._dof = arm.dof
        self._flat = _flat_arm(
            moving.robot,
            arm,
            None if load is None else load.body,
            load.grasp if isinstance(load, AttachedObject) else None,
            moving.q_zero.tobytes(),
            self.settings.cover_excess,
            self.settings.self_margin + self.settings.self_reserve,
        )
        # The obstacle set, and room to work in.
        self._boxes = box_arrays(obstacles)
        self._scratch = scratch_for(self._flat)
        arrays = self._flat.arrays
        self._T_tip_joint = np.linalg.inv(arrays.fixed[-1])
        if isinstance(load, PlacedObject):
            self.place(load.T_world_object)
        self._no_deviation = np.zeros(self._dof)
        # The same arm against another set of obstacles, in the same buffers.
        self._aside: ArmCollision | None = None
        if aside is not None:
            other = copy.copy(self)  # works in the same buffers
            other._obstacles, other._boxes = aside, box_arrays(aside)
            self._aside = other

    @property
    def arrays(self) -> ArmArrays:
        """The arm laid out for kernels; not to be written to."""
        return self._flat.arrays

    def free(self, q: Array, reserve: float = 0.0, contact: bool = False) -> bool:
        """Whether q (dof,) keeps the margins, and of `reserve` metres what the settings say.

        True is certain. False means a collision, or a distance so close to the margin (some
        `separation.BOUND_TOLERANCE_M`) that it is not certain.

        Args:
            contact: leave out the held object against the obstacle set.

        Raises:
            JointStateError: a value is not finite.
        """
        return bool(self.free_batch(q, reserve, contact)[0])

    def free_batch(self, Q: Array, reserve: float = 0.0, contact: bool = False) -> Mask:
        """`free` for (n, dof) configurations."""
        answers = self._keep(Q, self._margins(reserve, contact))
        if contact and self._aside is not None:
            answers[answers] = self._aside.free_batch(Q.reshape(-1, self._dof)[answers], reserve)
        return answers

    def can_be_left(self, q: Array, reserve: float = 0.0) -> bool:
        """Whether q (dof,) is free by so much that an edge which begins there can be certified: by
        what `edge_free` resolves, beyond the margins."""
        margin, self_margin, contact = self._margins(reserve, contact=False)
        margin += self.settings.edge_resolution
        self_margin += self.settings.self_resolution
        return bool(self._keep(q, KeptMargins(margin, self_margin, contact))[0])

    def _keep(self, Q: Array, kept: KeptMargins) -> Mask:
        """(n,) which of (n, dof) configurations keep these margins."""
        Q = kernel_input(Q).reshape(-1, self._dof)
        answers = np.empty(len(Q), dtype=np.bool_)
        check_states(self._flat.arrays, self._boxes, self._scratch, Q, kept, answers)
        if not answers.all():
            _require_finite(Q)
        return answers

    def hands_free(
        self, T_world_tip: Array, slack: float, reserve: float = 0.0, contact: bool = False
    ) -> Mask:
        """(n,) False where it is certain that no configuration with the tip at (n, 4, 4) is free.

        Hand, fingers and, but for `contact`, the held object against the obstacle set and the robot
        at rest.

        Args:
            slack: metres that points of the hand may be off by at a configuration.
            reserve, contact: as in `free`.
        """
        if not len(T_world_tip):
            return np.empty(0, dtype=np.bool_)
        # The margins, less what inverse kinematics may miss.
        margin, self_margin, _ = self._margins(reserve, contact)
        kept = KeptMargins(margin - slack, self_margin - slack, contact)
        answers = np.empty(len(T_world_tip), dtype=np.bool_)
        T = kernel_input(T_world_tip @ self._T_tip_joint)
        check_hands(self._flat.arrays, self._boxes, self._scratch, T, kept, answers)
        return answers

    def edge_free(
        self,
        a: Array,
        b: Array,
        *,
        contact: bool = False,
        deviation: Array | None = None,
        reserve: float = 0.0,
    ) -> bool:
        """Whether the straight joint motion from a to b (dof,) keeps the margins all the way.

        True is certain. False means a collision, or a distance so close to the margin
        (`edge_resolution`) that it cannot be certified.

        Args:
            contact: leave out the held object against the obstacle set (`ObjectCollision` checks
                its way down).
            deviation: (dof,) how far each joint may stray from the straight line, rad or m.
            reserve: metres to keep beyond the margins, as in `free`.

        Raises:
            JointStateError: a value is not finite.
        """
        ends = kernel_input(a).reshape(self._dof), kernel_input(b).reshape(self._dof)
        strays = self._no_deviation if deviation is None else kernel_input(deviation)
        edge, settings = JointEdge(*ends, strays.reshape(self._dof)), self.settings
        resolutions = settings.edge_resolution, settings.self_resolution
        limits = EdgeLimits(self._margins(reserve, contact), *resolutions)
        work = _edge_room(len(self._flat.arrays.movers), threading.get_ident())
        free = check_edge(self._flat.arrays, self._boxes, self._scratch, edge, limits, work)
        if not free:
            _require_finite(np.array(edge))
        # Free here: what the other set of obstacles says.
        if not free or not contact or self._aside is None:
            return bool(free)
        return self._aside.edge_free(a, b, deviation=deviation, reserve=reserve)

    def meeting(self, q: Array, reserve: float = 0.0, contact: bool = False) -> Meeting | None:
        """A collision at q (dof,), or what is not certain to be free of one; None where free."""
        # Free here: what the other set of obstacles says.
        if self._keep(q, self._margins(reserve, contact))[0]:
            return self._aside.meeting(q, reserve) if contact and self._aside is not None else None
        kind, s, other = self._scratch.hit.tolist()
        if kind == 2:
            s, other = self._ball_in_box(s)
        first = self._flat.bodies[self._flat.set_body[s]].name
        if kind != 1:
            where = (self._obstacles.lower[other] + self._obstacles.upper[other]) / 2
            return Meeting(first, ENVIRONMENT, where)
        second = self._flat.bodies[self._flat.set_body[other]].name
        # The middle of where the boxes around the two overlap, or of what is between.
        a, b = self._scratch.bounds[s], self._scratch.bounds[other]
        where = np.asarray((np.maximum(a[:3], b[:3]) + np.minimum(a[3:], b[3:])) / 2.0)
        return Meeting(second, first, where)

    def place(self, T_world_object: pin.SE3) -> None:
        """Put the placed object elsewhere, here and in what `with_pairs` made."""
        (row,) = (i for i, body in enumerate(self._flat.bodies) if body.joint == PLACED_JOINT)
        place_body(self._flat, self._scratch, row, T_world_object)

    def with_pairs(
        self,
        kept: Callable[[str, str], bool],
        settings: CollisionSettings | None = None,
        environment: bool = True,
    ) -> ArmCollision:
        """The same arm with fewer pairs of bodies to keep apart; shares this one's buffers.

        Args:
            kept: whether a pair of names (links, `PLACED_OBJECT`) stays.
            settings: other margins.
            environment: False leaves out the obstacle set.
        """
        # Rows of the pairs that are kept.
        names = [body.name for body in self._flat.bodies]
        pairs = self._flat.arrays.pairs
        rows = [kept(names[a], names[b]) for a, b, *_ in pairs.tolist()]
        other = copy.copy(self)
        arrays = self._flat.arrays
        fewer = arrays._replace(
            pairs=pairs[rows],
            movers=arrays.movers[[*[True] * arrays.moving, *rows]],
            pair_lower=arrays.pair_lower[rows],
        )
        other._flat = replace(self._flat, arrays=fewer)
        other.settings = settings or self.settings
        if not environment:
            other._boxes = self._boxes._replace(number=0)
        other._aside = None
        if environment and self._aside is not None:
            other._aside = self._aside.with_pairs(kept, settings)
        return other

    def among(self, obstacles: ObstacleSet, settings: CollisionSettings) -> ArmCollision:
        """The same arm against other obstacles and nothing else, in buffers of its own."""
        other = self.with_pairs(lambda a, b: False, settings, environment=False)
        other._obstacles, other._boxes = obstacles, box_arrays(obstacles)
        other._scratch = scratch_for(self._flat)
        return other

    def _margins(self, reserve: float, contact: bool) -> KeptMargins:
        settings = self.settings
        kept = min(reserve, settings.self_reserve)
        margins = settings.obstacle_margin + reserve, settings.self_margin + kept
        return KeptMargins(*margins, contact)

    def _ball_in_box(self, node: int) -> tuple[int, int]:
        """Which set meets which box, where the ball inside a sphere is known to meet one."""
        arrays, corners = self._flat.arrays, self._boxes.corners
        s = int(np.searchsorted(arrays.sets[:, at.SET_FIRST_NODE], node, "right")) - 1
        frame = self._scratch.frames[arrays.sets[s, at.SET_JOINT]]
        center = frame[:3, :3] @ arrays.node_spheres[node, :3] + frame[:3, 3]
        away = np.maximum(np.maximum(corners[:, :3] - center, center - corners[:, 3:]), 0.0)
        return s, int(np.argmin(np.linalg.norm(away, axis=1)))


def _require_finite(Q: Array) -> None:
    """Refuse configurations (n, dof) of which one has no place."""
    if not np.isfinite(Q).all():
        raise JointStateError(
            "configuration",
            Q[~np.isfinite(Q).all(axis=1)][:1].tolist(),
            "every joint value must be finite",
        )


def arm_joint(model: pin.Model, joint_ids: Sequence[int], joint: int) -> int:
    """Index of the last arm joint that moves what hangs on `joint`, or -1."""
    while joint != 0 and joint not in joint_ids:
        joint = model.parents[joint]
    return joint_ids.index(joint) if joint != 0 else -1


@weak_lru_cache("body", maxsize=_REMEMBERED_ARMS)
def _flat_arm(
    robot: Robot,
    arm: Arm,
    body: Body | None,
    grasp: int | None,
    q_zero: bytes,
    excess: float,
    clear: float,
) -> FlatArm:
    """An arm laid out; remembered, as it is the same from start to start of a robot at rest.

    Args:
        grasp: index into the arm's grasps; None where the body stands at the world's origin.
        q_zero: (nq,) joints of the whole robot, the arm's at zero.
        excess, clear: as for `lay_out_arm` and `with_pair_tables`.
    """
    # The robot with the arm's joints at zero.
    q = np.frombuffer(q_zero)
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, q)
    joint_ids = [model.getJointId(name) for name in arm.joints]
    bodies = list(_arm_links(robot, tuple(joint_ids), q_zero))
    pairs = _checked_pairs(robot, [link.name for link in bodies])
    # The object as one more body: placed in the world, or held by the last joint.
    if body is not None:
        tip = robot.frame_id(arm.tip_frame)
        others = [link for link in bodies if link.name not in arm.touch_links]
        if grasp is None:
            parts = _object_parts(body, pin.SE3.Identity())
            thing = CollisionBody(PLACED_OBJECT, PLACED_JOINT, parts)
        else:
            tip_joint = arm_joint(model, joint_ids, model.frames[tip].parentJoint)
            parts = _object_parts(body, data.oMf[tip] * arm.grasps[grasp])
            thing = CollisionBody(HELD_OBJECT, tip_joint, parts)
        # Every link but those that may touch it is to keep off the object.
        pairs += [(link.name, thing.name) for link in others]
        bodies.append(thing)
    held = HELD_OBJECT if body is not None and grasp is not None else None
    chain = Chain.from_robot(robot, arm, q)
    return with_pair_tables(lay_out_arm(chain, bodies, held, pairs, excess), chain, clear)


@weak_lru_cache("robot", maxsize=_REMEMBERED_ARMS)
def _arm_links(
    robot: Robot, joint_ids: tuple[int, ...], q_zero: bytes
) -> tuple[CollisionBody, ...]:
    """The links of an arm with those joints, remembered for each grasp and object."""
    # Geometries by their link, each with the last arm joint that moves it.
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, np.frombuffer(q_zero))
    parts: dict[str, list[tuple[Shape, pin.SE3]]] = {}
    joints: dict[str, int] = {}
    rigid: dict[str, bool] = {}
    mount = robot.model.parents[joint_ids[0]]
    for link, thing, shape in zip(
        robot.geometry_links, robot.geometry.geometryObjects, link_shapes(robot), strict=True
    ):
        joints[link] = arm_joint(robot.model, joint_ids, thing.parentJoint)
        rigid[link] = thing.parentJoint in (mount, *joint_ids)
        T = data.oMi[thing.parentJoint] * thing.placement
        parts.setdefault(link, []).append((shape, T))
    return tuple(
        CollisionBody(link, joints[link], tuple(parts[link]), rigid[link]) for link in parts
    )


def _checked_pairs(robot: Robot, links: list[str]) -> list[tuple[str, str]]:
    return [
        (a, b)
        for i, a in enumerate(links)
        for b in links[i + 1 :]
        if (min(a, b), max(a, b)) not in robot.allowed_pairs
    ]


def _object_parts(body: Body, T_world_object: pin.SE3) -> tuple[tuple[Shape, pin.SE3], ...]:
    return tuple((solid.shape, T_world_object) for solid in object_solids(body))
