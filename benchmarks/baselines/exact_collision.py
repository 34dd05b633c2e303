"""The arm's collision checks by coal alone: what the planner's kernels are measured against.

Plain use of pinocchio and coal on the exact shapes, one configuration at a time: forward
kinematics, each moving shape against a tree of the environment's boxes, then the robot's own pairs
until one collides. Shares nothing with the kernels but their input.
"""

from __future__ import annotations

import itertools
import math
import warnings
from dataclasses import dataclass
from functools import lru_cache

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from placement_planner_ros.core.collision.arm import ArmCollision, CollisionSettings
from placement_planner_ros.core.collision.attached_object import AttachedObject, object_solids
from placement_planner_ros.core.robot.arm import MovingArm
from placement_planner_ros.core.robot.model import Arm
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import Array

TIE = 1e-6
"""m around a margin within which two exact checks may answer differently."""
_LESS = (3e-6, 1e-5, 3e-5, 1e-4)
"""m below a margin at which coal is asked again."""
_OVERLAP = 1e-7
"""m; two shapes overlap for certain where a ball of this radius lies in both."""
STEP = 0.005
"""m that any point of arm and object may move between two checked configurations."""
_STRETCHES = 8
"""Pieces of an edge over which its length is summed up."""


class ExactCollision:
    """One arm with one object in one grasp, all other joints at rest: `ArmCollision` by coal.

    Args:
        moving: the arm, and where the rest of the robot is.
        load: the object in a grasp, or None for an empty hand.
        obstacles: the environment.
        settings: margins.
    """

    def __init__(
        self,
        moving: MovingArm,
        load: AttachedObject | None,
        obstacles: ObstacleSet,
        settings: CollisionSettings | None = None,
    ) -> None:
        self.settings = settings or CollisionSettings()
        robot, arm = moving.robot, moving.arm
        parts = object_solids(load.body) if load is not None else ()
        self._model, self._data = robot.model, robot.model.createData()
        self._q = np.array(moving.q_rest)
        self._q_index = arm.q_index
        links = list(robot.geometry_links)
        shapes = [pin.GeometryObject(thing) for thing in robot.geometry.geometryObjects]
        tip = robot.model.frames[robot.frame_id(arm.tip_frame)]
        self._held = range(len(shapes), len(shapes) + len(parts))
        if load is not None:
            T_joint_object = tip.placement * arm.grasps[load.grasp]
            for i, part in enumerate(parts):
                name = f"held object {i}"
                thing = pin.GeometryObject(name, tip.parentJoint, T_joint_object, part.geometry)
                shapes.append(thing)
        above = [_joint_above(robot.model, arm, shape.parentJoint) for shape in shapes]
        self._geometry = pin.GeometryModel()
        for shape in shapes:
            shape.geometry.computeLocalAABB()
            self._geometry.addGeometryObject(shape)
        pairs = [(pair.first, pair.second) for pair in robot.geometry.collisionPairs]
        strangers = [i for i, link in enumerate(links) if link not in arm.touch_links]
        pairs += itertools.product(self._held, strangers)
        # Outer links first: they collide most often.
        for a, b in sorted(pairs, key=lambda p: -max(above[p[0]], above[p[1]])):
            if above[a] != above[b]:
                self._geometry.addCollisionPair(pin.CollisionPair(a, b))
        self._placed = self._geometry.createData()
        with warnings.catch_warnings():  # pinocchio sets what coal wants nobody to set any more
            warnings.simplefilter("ignore", DeprecationWarning)
            for request in self._placed.collisionRequests:
                # With a guess from the last configuration, coal misses penetrations of 0.7 mm.
                request.enable_cached_gjk_guess = False
        movers = sorted((i for i in range(len(shapes)) if above[i] >= 0), key=lambda i: -above[i])
        self._movers = [(i, coal.CollisionObject(shapes[i].geometry)) for i in movers]
        self._corners = [(i, _box_corners(shapes[i].geometry)) for i in movers]
        self._boxes, self._environment = box_tree(obstacles)
        self._answer = coal.CollisionCallBackDefault()
        self._kept = (math.nan, math.nan)

    def free(
        self, q: Array, reserve: float = 0.0, contact: bool = False, beyond: float = 0.0
    ) -> bool:
        """Whether q (dof,) keeps the margins, as `ArmCollision.free`.

        Args:
            reserve: metres beyond the margins, of which the settings say what counts for the
                robot against itself.
            contact: leave out the held object against the obstacle set.
            beyond: metres beyond both margins.
        """
        settings = self.settings
        kept = min(reserve, settings.self_reserve)
        self._keep(
            settings.collision_margin + reserve + beyond, settings.self_margin + kept + beyond
        )
        poses, answer = self._place(q), self._answer
        for i, mover in self._movers:
            if contact and i in self._held:
                continue
            pose = poses[i]
            mover.setTransform(coal.Transform3s(pose.rotation, pose.translation))
            mover.computeAABB()
            mover.getAABB().expand(self._kept[0])
            answer.init()
            self._environment.collide(mover, answer)
            if answer.data.result.isCollision():
                return False
        return not pin.computeCollisions(self._geometry, self._placed, True)

    def free_batch(
        self, Q: Array, reserve: float = 0.0, contact: bool = False
    ) -> npt.NDArray[np.bool_]:
        """`free` for (n, dof) configurations, one after the other."""
        return np.array([self.free(q, reserve, contact) for q in Q], dtype=np.bool_)

    def hands_free(self, T: Array, *_: object, **__: object) -> npt.NDArray[np.bool_]:
        """As `ArmCollision.hands_free`: coal alone has no such check."""
        return np.ones(len(T), dtype=np.bool_)

    def ties(self, q: Array, reserve: float = 0.0, contact: bool = False) -> bool:
        """Whether the distance at q (dof,) is within `TIE` of a margin."""
        return self.free(q, reserve, contact, -TIE) and not self.free(q, reserve, contact, TIE)

    def contradicts_itself(self, q: Array, reserve: float = 0.0, contact: bool = False) -> bool:
        """Whether coal finds q (dof,) free at the margins yet colliding at smaller ones.

        It misses penetrations of some 0.03 mm between meshes now and then.
        """
        return self.free(q, reserve, contact) and not all(
            self.free(q, reserve, contact, -less) for less in _LESS
        )

    def common_ball(self, q: Array) -> float:
        """Radius of the largest ball inside both shapes of some pair of the robot's, metres, at q.

        By a linear program, which settles what coal gets wrong: now and then it misses that two
        polytopes overlap by some µm. 0 where none do.
        """
        self._place(q)
        largest = 0.0
        for pair in self._geometry.collisionPairs:
            a, b = self._world_hull(pair.first), self._world_hull(pair.second)
            if a is None or b is None or not _boxes_meet(a, b):
                continue
            planes = np.vstack([ConvexHull(a).equations, ConvexHull(b).equations])
            found = linprog(
                [0.0, 0.0, 0.0, -1.0],
                A_ub=np.column_stack([planes[:, :3], np.ones(len(planes))]),
                b_ub=-planes[:, 3],
                bounds=[(None, None)] * 4,
            )
            if found.status == 0:
                largest = max(largest, float(found.x[3]))
        return largest

    def _world_hull(self, index: int) -> Array | None:
        """(m, 3) vertices of a polytope where it is now; None for other shapes."""
        geometry = self._geometry.geometryObjects[index].geometry
        if not isinstance(geometry, coal.ConvexBase):
            return None
        pose = self._placed.oMg[index]
        return np.asarray(np.array(geometry.points()) @ pose.rotation.T + pose.translation)

    def edge_free(
        self,
        a: Array,
        b: Array,
        *,
        contact: bool = False,
        deviation: Array | None = None,
        reserve: float = 0.0,
    ) -> bool:
        """Whether samples of the straight joint motion from a to b (dof,) are free.

        They are so close that no point of arm or object moves further than `STEP` from one to the
        next, and are taken by bisection, the ends first. How far the motion may stray from the
        line is left out.
        """
        count = max(1, math.ceil(self.length(a, b) / STEP))
        if not (self.free(b, reserve, contact) and self.free(a, reserve, contact)):
            return False
        waiting = [(0, count)]
        for low, high in waiting:
            if high - low < 2:
                continue
            middle = (low + high) // 2
            if not self.free(a + middle / count * (b - a), reserve, contact):
                return False
            waiting += [(low, middle), (middle, high)]
        return True

    def length(self, a: Array, b: Array) -> float:
        """Metres that the furthest moving point of arm and object travels from a to b (dof,).

        Summed up over corners of boxes around the shapes and a few stretches of the motion.
        """
        stages = []
        for share in np.linspace(0.0, 1.0, _STRETCHES + 1):
            poses = self._place(a + share * (b - a))
            stages.append(
                np.vstack(
                    [at @ poses[i].rotation.T + poses[i].translation for i, at in self._corners]
                )
            )
        ways = np.linalg.norm(np.diff(stages, axis=0), axis=2)
        return float(ways.max(axis=1).sum())

    def _place(self, q: Array) -> list[pin.SE3]:
        """Where the shapes are in the world at q (dof,)."""
        self._q[self._q_index] = q
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._placed, self._q)
        return self._placed.oMg

    def _keep(self, margin: float, self_margin: float) -> None:
        """Have coal keep these distances, metres."""
        if self._kept != (margin, self_margin):
            self._kept = margin, self_margin
            self._answer.data.request.security_margin = margin
            for request in self._placed.collisionRequests:
                request.security_margin = self_margin


@dataclass(frozen=True, slots=True, eq=False)
class CollisionAgreement:
    """How the planner's collision check and coal alone answer the same configurations.

    Attributes:
        free, colliding: how many coal says are.
        ties: answered differently within `TIE` of a margin.
        contradictions: answered differently elsewhere, where coal contradicts itself, or calls free
            what has a ball of `_OVERLAP` inside two of the robot's shapes.
        disagreements: (k, dof) answered differently elsewhere.
    """

    free: int
    colliding: int
    ties: int
    contradictions: int
    disagreements: Array


def compare(
    fast: ArmCollision, exact: ExactCollision, Q: Array, reserve: float = 0.0, contact: bool = False
) -> CollisionAgreement:
    """Ask both about Q (n, dof)."""
    asked = reserve, contact
    expected = exact.free_batch(Q, *asked)
    differ = np.flatnonzero(fast.free_batch(Q, *asked) != expected)
    ties = np.array([exact.ties(Q[i], *asked) for i in differ], dtype=np.bool_)
    doubted = np.array(
        [
            exact.contradicts_itself(Q[i], *asked)
            or (expected[i] and exact.common_ball(Q[i]) > _OVERLAP)
            for i in differ
        ],
        dtype=np.bool_,
    )
    counts = expected, ~expected, ties, doubted & ~ties
    free, colliding, tied, contradicted = (int(rows.sum()) for rows in counts)
    apart = np.asarray(Q[differ[~(ties | doubted)]])
    return CollisionAgreement(free, colliding, tied, contradicted, apart)


def _boxes_meet(a: Array, b: Array) -> bool:
    return bool((a.min(axis=0) <= b.max(axis=0)).all() and (b.min(axis=0) <= a.max(axis=0)).all())


@lru_cache(maxsize=1)
def box_tree(
    obstacles: ObstacleSet,
) -> tuple[list[coal.CollisionObject], coal.DynamicAABBTreeCollisionManager]:
    """The boxes and a tree of them, shared by checkers of the same environment."""
    boxes = [
        coal.CollisionObject(coal.Box(upper - lower), np.eye(3), (lower + upper) / 2)
        for lower, upper in zip(obstacles.lower, obstacles.upper, strict=True)
    ]
    tree = coal.DynamicAABBTreeCollisionManager()
    tree.registerObjects(boxes)
    tree.setup()
    return boxes, tree


def _joint_above(model: pin.Model, arm: Arm, joint: int) -> int:
    """Index of the last of the arm's joints that moves what hangs on `joint`, or -1."""
    moves = [model.names[k] for k in model.supports[joint]]
    return max((i for i, name in enumerate(arm.joints) if name in moves), default=-1)


def _box_corners(shape: coal.CollisionGeometry) -> Array:
    """(8, 3) of the box around a shape, in its own frame."""
    box = shape.aabb_local
    return np.array(list(itertools.product(*zip(box.min_, box.max_, strict=True))))
