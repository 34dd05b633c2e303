"""The check of the start: limits, self-collision, tilt and collision at q_0.

By coal alone: in milliseconds, for any robot, and before anything is compiled or covered with
spheres. The search begins with what it leaves.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import product

import coal
import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.carry.settings import TiltLimit
from placement_planner_ros.core.collision.arm import HELD_OBJECT, CollisionSettings, arm_joint
from placement_planner_ros.core.collision.attached_object import object_overlaps
from placement_planner_ros.core.errors import (
    NAMED_THINGS,
    GraspError,
    PlacementPlannerError,
    StartError,
    listed,
)
from placement_planner_ros.core.grasp.hand_opening import grasp_error
from placement_planner_ros.core.robot.allowed_pairs import sorted_pair, srdf_line
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.joint_space import limit_violations
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.robot.overlap import meet
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array, Index, Mask

WITH_CLOUDS = "in collision with the surroundings"
"""How a collision with the obstacle set begins, in words."""

MOVE_ROBOT = "move the robot to where it keeps collision_margin with the object in hand"
BACK_IN_LIMITS = (
    "move these joints back between their limits, raise start_limit_tolerance where they are "
    "barely beyond, or correct the limits in the URDF",
)
CHECK_GRASP = "check grasps and `scale`, as the held object is in the way"
FILTER_ITSELF = "where these are points of the robot or of the object, leave them out: `own points`"

_Thing = tuple[str, int, pin.SE3]
"""A name, the number of a shape, and its place."""


@dataclass(frozen=True, slots=True)
class Fault:
    """Why an arm, or one of its grasps, cannot begin at q_0.

    Attributes:
        words: which, and what is wrong.
        remedies: what may help.
    """

    words: str
    remedies: tuple[str, ...]

    def of(self, who: str) -> Fault:
        """The same, of that arm or grasp."""
        return Fault(f"{who}: {self.words}", self.remedies)

    def __str__(self) -> str:
        return f"{self.words}; {'; '.join(self.remedies)}"


@dataclass(frozen=True, slots=True, eq=False)
class StartRules:
    """What is kept at q_0.

    Attributes:
        environment: None where it is not known yet.
        tilt: by how much the held object may lean; None for any.
        keep_out: (k, 2, 3) corners of boxes that nothing which moves may be in.
    """

    collision: CollisionSettings = field(default_factory=CollisionSettings)
    environment: Environment | None = None
    tilt: TiltLimit | None = None
    keep_out: Array | None = None


def faults_at_start(
    robot: Robot, arms: tuple[Arm, ...], q_start: Array, body: Body, rules: StartRules
) -> tuple[str, ...]:
    """Why some arms and grasps cannot be used: joint limits, collision and tilt at q_0 (nq,).

    Raises:
        StartError: q_0 is wrong for every arm and grasp.
        GraspError: in every grasp the object overlaps the hand.
    """
    state = StartState(robot, q_start, body, rules)
    found = [state.usable_grasps(arm) for arm in arms]
    faults = [fault for _, of_arm in found for fault in of_arm]
    if not any(usable for usable, _ in found):
        raise none_usable(faults)
    return tuple(map(str, faults))


def in_degrees(angle: float) -> str:
    """An angle in rad for people, and as parameters have it."""
    return f"{math.degrees(angle):.1f}° ({angle:.4g} rad)"


def none_usable(faults: Sequence[Fault | GraspError]) -> PlacementPlannerError:
    """What to raise where no arm and grasp is left."""
    of_start = [fault for fault in faults if isinstance(fault, Fault)]
    if not of_start:
        return next(fault for fault in faults if isinstance(fault, GraspError))
    # All faults in one sentence, and every remedy once.
    remedies = dict.fromkeys(remedy for fault in of_start for remedy in fault.remedies)
    words = [fault.words if isinstance(fault, Fault) else str(fault) for fault in faults]
    return StartError("`q_start`", listed(words, "; ", 4), "; ".join(remedies))


class StartState:
    """The robot's geometries and the object in hand at one configuration (nq,)."""

    def __init__(self, robot: Robot, q: Array, body: Body, rules: StartRules) -> None:
        self._robot, self._q, self._rules = robot, robot.unwound(q), rules
        self._data = robot.model.createData()
        pin.framesForwardKinematics(robot.model, self._data, self._q)
        # Shapes of the links, then of the object.
        self._overlaps = object_overlaps(robot, body)
        self._places = robot.geometry_poses(self._q)
        self._solids = range(len(self._places), len(self._overlaps.shapes))

    def usable_grasps(self, arm: Arm) -> tuple[list[int], list[Fault | GraspError]]:
        """The grasps of an arm with which it can begin here, and what is wrong with the others."""
        # What is wrong wherever the object is held.
        joints, links = _carrying_joints(self._robot, arm), self._robot.geometry_links
        moved = [(links[i], i, self._places[i]) for i in np.flatnonzero(joints >= 0).tolist()]
        of_arm = self._beyond_limits(arm) or self._met_itself(joints) or self._met_zones(moved)
        if of_arm is not None:
            return [], [of_arm.of(arm.name)]
        # Each grasp, with the obstacles that count for it.
        usable: list[int] = []
        faults: list[Fault | GraspError] = []
        met: dict[int, Fault | None] = {}
        around = self._rules.environment
        for grasp in range(len(arm.grasps)):
            obstacles = around.obstacles_of(arm.name, grasp)[0] if around is not None else None
            if id(obstacles) not in met:
                met[id(obstacles)] = self._met_boxes(moved, obstacles)
            bad = self._object_in_hand(arm, grasp)
            found = met[id(obstacles)] or self._of_grasp(arm, grasp, obstacles)
            if bad is not None:
                faults.append(bad)
            elif found is not None:
                faults.append(found.of(f"{arm.name} with grasp {grasp}"))
            else:
                usable.append(grasp)
        return usable, faults

    def _beyond_limits(self, arm: Arm) -> Fault | None:
        """Which of the arm's joints are beyond their limits, and how far."""
        q = self._q[arm.q_index]
        beyond = limit_violations(arm.joints, q, arm.lower, arm.upper)
        words = f"beyond the joint limits: {listed(beyond)}"
        return Fault(words, BACK_IN_LIMITS) if beyond else None

    def _of_grasp(self, arm: Arm, grasp: int, obstacles: ObstacleSet | None) -> Fault | None:
        """What is wrong with how the object is held: it leans, or meets a link that is not of the
        hand, or the environment."""
        T = self._object_at(arm, grasp)
        link = self._met_by_object(arm, T)
        things = [(HELD_OBJECT, j, T) for j in self._solids]
        words = f"in self-collision: {HELD_OBJECT} meets {link}"
        return (
            self._leans(arm, grasp)
            or (Fault(words, (CHECK_GRASP, MOVE_ROBOT)) if link else None)
            or self._met_zones(things)
            or self._met_boxes(things, obstacles)
        )

    def _leans(self, arm: Arm, grasp: int) -> Fault | None:
        """By how much more than it may the held object leans."""
        limit = self._rules.tilt
        tilt = limit.tilt(self._object_at(arm, grasp).rotation) if limit is not None else 0.0
        if limit is None or tilt <= limit.most:
            return None
        return Fault(
            f"`up` is {in_degrees(tilt)} from the vertical at q_0, and `max_tilt` "
            f"{in_degrees(limit.most)}",
            (
                "bring the object upright before start, raise `max_tilt`, or correct `up` or the "
                "grasp",
            ),
        )

    def _object_in_hand(self, arm: Arm, grasp: int) -> GraspError | None:
        """The object overlaps links of the hand that it may not touch."""
        depths: dict[str, float] = {}
        T = self._object_at(arm, grasp)
        for i in np.flatnonzero(self._in_hand(arm)).tolist():
            link = self._robot.geometry_links[i]
            if link in arm.touch_links:
                continue
            step(f"comparing the object with link {link}")
            for j in self._solids:
                depth = self._overlaps.depth(i, j, self._places[i], T)
                if depth > 0.0:
                    depths[link] = max(depth, depths.get(link, 0.0))
        if not depths:
            return None
        links = ", ".join(f"{link} ({depth:.4f} m deep)" for link, depth in depths.items())
        return grasp_error(
            arm,
            grasp,
            f"the object lies in {links}; move the grasp, list "
            f"{'the link' if len(depths) == 1 else 'the links'} in touch_links, or correct "
            "`scale` where the object is not that large",
        )

    def _object_at(self, arm: Arm, grasp: int) -> pin.SE3:
        return self._data.oMf[self._robot.frame_id(arm.tip_frame)] * arm.grasps[grasp]

    def _in_hand(self, arm: Arm) -> Mask:
        """Which geometries move with the hand."""
        robot, model = self._robot, self._robot.model
        tip = model.frames[robot.frame_id(arm.tip_frame)].parentJoint
        hand = arm_joint(model, _joint_ids(robot, arm), tip)
        return np.asarray(_carrying_joints(robot, arm) == hand)

    def _met_itself(self, joints: Index) -> Fault | None:
        """Which links meet that move to each other with the arm.

        Args:
            joints: (n,) as `_carrying_joints` has them.
        """
        # Pairs that the arm moves against each other.
        pairs = _checked_pairs(self._robot)
        pairs = pairs[joints[pairs[:, 0]] != joints[pairs[:, 1]]]
        names = self._robot.geometry_links
        met: dict[tuple[str, str], str] = {}
        for a, b in self._meeting(pairs, pin.SE3.Identity()):
            links = sorted_pair(names[a], names[b])
            if links not in met:
                met[links] = self._overlap_words(a, b)
                if len(met) == NAMED_THINGS:
                    break
        if not met:
            return None
        remedy = (
            "where the robot does stand like this and only its meshes overlap, add to the SRDF "
            "(`srdf`; without one, to what placement_check_robot --write-srdf "
            f"writes): {' '.join(map(srdf_line, met))}"
        )
        return Fault(f"in self-collision: {listed([*met.values()])}", (remedy, MOVE_ROBOT))

    def _overlap_words(self, i: int, j: int) -> str:
        """Which links meet, and how deep."""
        depth = self._overlaps.depth(i, j, self._places[i], self._places[j])
        first, second = sorted_pair(*(self._robot.geometry_links[k] for k in (i, j)))
        return f"{first} meets {second}, their shapes {depth:.4f} m in each other"

    def _met_by_object(self, arm: Arm, T: pin.SE3) -> str:
        """Which link that is not of the hand the object at T meets first; '' where none."""
        names = self._robot.geometry_links
        others = [i for i in np.flatnonzero(~self._in_hand(arm)) if names[i] not in arm.touch_links]
        pairs = np.array([*product(others, self._solids)], dtype=np.int64).reshape(-1, 2)
        return next((names[i] for i, _ in self._meeting(pairs, T)), "")

    def _meeting(self, pairs: Index, T_object: pin.SE3) -> Iterator[tuple[int, int]]:
        """Those of pairs (n, 2) of shapes that meet, the object being there."""
        places = [*self._places, *[T_object] * len(self._solids)]
        margin = self._rules.collision.self_margin
        for i, j in pairs[self._overlaps.near(pairs, places, margin)].tolist():
            if self._overlaps.meet(i, j, places[i], places[j], margin):
                yield i, j

    def _met_zones(self, things: list[_Thing]) -> Fault | None:
        """Which of the things is in a box to keep out of."""
        zones, margin = self._rules.keep_out, self._rules.collision.obstacle_margin
        met = self._first_met(zones[:, 0], zones[:, 1], things, margin) if zones is not None else ""
        if not met:
            return None
        words = met.replace("an obstacle", "a box of keep_out")
        remedies = "make the boxes of keep_out smaller", MOVE_ROBOT
        return Fault(f"q_0 is not free: {words}", remedies)

    def _met_boxes(self, things: list[_Thing], obstacles: ObstacleSet | None) -> Fault | None:
        """Which of the things meets the environment, or comes nearer than its margin."""
        settings = self._rules.collision
        margin, error = settings.obstacle_margin, settings.obstacle_error
        if obstacles is None:
            return None
        boxes = obstacles.lower, obstacles.upper
        met = self._first_met(*boxes, things, margin)
        touching = self._first_met(*boxes, things, 0.0) if met else ""
        if touching:
            return Fault(f"{WITH_CLOUDS}: {touching}", (MOVE_ROBOT, FILTER_ITSELF))
        within = f"{met}, nearer than collision_margin = {settings.collision_margin:g} m"
        within += f" and {error:.2g} m by which cameras are off" if error else ""
        within += " without touching it"
        remedies = "lower collision_margin", MOVE_ROBOT, FILTER_ITSELF
        return Fault(f"{WITH_CLOUDS}: {within}", remedies) if met else None

    def _first_met(self, lower: Array, upper: Array, things: list[_Thing], margin: float) -> str:
        """The first of the things that comes as near to one of the boxes (m, 3), in words; ''
        where none does."""
        if not things:
            return ""
        # The box along the axes around each thing, and the boxes that come near any of these.
        around = np.array([self._bounds(number, T, margin) for _, number, T in things])
        rows = _boxes_near(lower, upper, around[:, 0].min(axis=0), around[:, 1].max(axis=0))
        lower, upper = lower[rows], upper[rows]
        for (name, number, T), (low, high) in zip(things, around, strict=True):
            shape = self._overlaps.shapes[number]
            for row in _boxes_near(lower, upper, low, high):
                middle = (lower[row] + upper[row]) / 2
                box = coal.Box(upper[row] - lower[row])
                if meet(shape, T, box, pin.SE3(np.eye(3), middle), margin):
                    x, y, z = middle
                    return f"{name} meets an obstacle at ({x:.3f}, {y:.3f}, {z:.3f})"
        return ""

    def _bounds(self, number: int, T: pin.SE3, margin: float) -> tuple[Array, Array]:
        """Lower and upper (3,) of the box along the axes around a shape at T, and that margin."""
        local = self._overlaps.shapes[number].aabb_local
        center = T.act((local.min_ + local.max_) / 2)
        half = np.abs(T.rotation) @ ((local.max_ - local.min_) / 2) + margin
        return center - half, center + half


def _boxes_near(lower: Array, upper: Array, low: Array, high: Array) -> Index:
    """Rows of the boxes (m, 3) that meet the box from low to high (3,), axis by axis."""
    rows = np.arange(len(lower))
    for axis in range(3):
        rows = rows[(lower[rows, axis] <= high[axis]) & (upper[rows, axis] >= low[axis])]
    return rows


@lru_cache(maxsize=4)
def _checked_pairs(robot: Robot) -> Index:
    """(m, 2) geometries that must not meet."""
    pairs = [(pair.first, pair.second) for pair in robot.geometry.collisionPairs]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


@lru_cache(maxsize=16)
def _carrying_joints(robot: Robot, arm: Arm) -> Index:
    """(n,) per geometry, the arm's last joint that moves it; -1 where none does."""
    joints, ids = [g.parentJoint for g in robot.geometry.geometryObjects], _joint_ids(robot, arm)
    return np.array([arm_joint(robot.model, ids, joint) for joint in joints], dtype=np.int64)


def _joint_ids(robot: Robot, arm: Arm) -> list[int]:
    return [robot.model.getJointId(name) for name in arm.joints]
