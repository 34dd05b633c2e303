"""The check of the start: limits, self-collision, tilt and collision at q_0.

By coal alone: in milliseconds, for any robot, and before anything is compiled or covered with
spheres. `usable_holdings` asks it why, where q_0 is not certain to be free.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.carry.settings import TiltLimit
from placement_planner_ros.core.collision.arm import (
    HELD_OBJECT,
    CollisionSettings,
    arm_joint,
)
from placement_planner_ros.core.collision.object_solids import (
    coal_transform,
    depths_in_links,
    object_in_hand,
    object_overlaps,
    object_solids,
)
from placement_planner_ros.core.errors import GraspError, PlacementPlannerError, StartError, listed
from placement_planner_ros.core.robot.allowed_pairs import sorted_pair, srdf_line
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.robot.overlap import Overlaps, meet, winding_number
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import Array

WITH_CLOUDS = "in collision with the clouds"
"""How a collision with the obstacle set begins, in words."""

MOVE_ROBOT = "move the robot to where it keeps collision_margin with the object in hand"
CHECK_GRASP = "check grasps and object.scale, as the held object is in the way"
FILTER_ITSELF = (
    "where these are points of the robot or of the object, set self_filter.enabled or raise "
    "self_filter.padding"
)
_Thing = tuple[str, coal.CollisionGeometry, coal.Transform3s, Array | None]
"""A name, a shape at its place, and what triangles enclose its inside, where it is a surface."""
_NAMED_PAIRS = 3
"""Pairs of links that are named at most."""


@dataclass(frozen=True, slots=True)
class Fault:
    """Why an arm, or one of its grasps, cannot begin at q_0.

    Attributes:
        words: which, and what is wrong.
        remedies: what may help.
    """

    words: str
    remedies: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.words}; {'; '.join(self.remedies)}"


def faults_at_start(
    robot: Robot,
    arms: tuple[Arm, ...],
    q_start: Array,
    body: Body,
    settings: CollisionSettings,
    obstacles: ObstacleSet | None = None,
    tilt: TiltLimit | None = None,
    keep_out: Array | None = None,
) -> tuple[str, ...]:
    """Why some arms and grasps cannot be used: joint limits, collision and tilt at q_0 (nq,).

    Args:
        obstacles: the environment; None where it is not known yet.
        tilt: by how much the held object may lean; None for any.
        keep_out: (k, 2, 3) corners of boxes that nothing which moves may be in.

    Raises:
        StartError: q_0 is wrong for every arm and grasp.
        GraspError: in every grasp the object overlaps the hand.
    """
    faults: list[Fault] = []
    bad_grasps: list[GraspError] = []
    usable = 0
    placed = StartState(robot, q_start)
    margin = settings.collision_margin
    for arm in arms:
        # What the arm meets wherever the object is held.
        fault = beyond_limits(arm, q_start) or placed.met(arm, settings.self_margin)
        if obstacles is not None and not fault:
            fault = placed.met_in(obstacles, arm, margin)
        if fault is not None:
            faults.append(Fault(f"{arm.name}: {fault.words}", fault.remedies))
            bad_grasps += placed.bad_grasps(arm, body)  # wherever the arm is
            continue
        for grasp in range(len(arm.grasps)):
            found = placed.leans(arm, grasp, tilt) or placed.met_when_held(
                arm, grasp, body, settings, obstacles, keep_out
            )
            if found is None:
                usable += 1
            elif isinstance(found, GraspError):
                bad_grasps.append(found)
            else:
                words = f"{arm.name} with grasp {grasp}: {found.words}"
                faults.append(Fault(words, found.remedies))
    if not usable:
        raise none_usable(faults, bad_grasps)
    return (*map(str, bad_grasps), *map(str, faults))


def tilt_fault(limit: TiltLimit, tilt: float) -> Fault | None:
    """The fault of an object that leans by `tilt` rad at q_0; None where it may."""
    if tilt <= limit.most:
        return None
    return Fault(
        f"object.up is {in_degrees(tilt)} from the vertical at q_0, and carry.max_tilt "
        f"{in_degrees(limit.most)}",
        (
            "bring the object upright before start, raise carry.max_tilt, or correct object.up or "
            "the grasp",
        ),
    )


def tilts_at_start(
    robot: Robot, arms: tuple[Arm, ...], q_start: Array, limit: TiltLimit
) -> tuple[str, ...]:
    """By how much the object leans at q_0 (nq,) in each grasp, in words."""
    placed = StartState(robot, q_start)
    return tuple(
        f"{arm.name} with grasp {grasp}: object.up is {in_degrees(placed.tilt(arm, grasp, limit))} "
        f"from the vertical at q_0 (carry.max_tilt: {in_degrees(limit.most)})"
        for arm in arms
        for grasp in range(len(arm.grasps))
    )


def in_degrees(angle: float) -> str:
    """An angle in rad for people, and as parameters have it."""
    return f"{math.degrees(angle):.1f}° ({angle:.4g} rad)"


def none_usable(faults: list[Fault], bad_grasps: list[GraspError]) -> PlacementPlannerError:
    """What to raise where no arm and grasp is left."""
    if not faults:
        return bad_grasps[0]
    # All faults in one sentence, and every remedy once.
    remedies = dict.fromkeys(remedy for fault in faults for remedy in fault.remedies)
    words = [*(fault.words for fault in faults), *map(str, bad_grasps)]
    return StartError("joint_states", listed(words, "; ", 4), "; ".join(remedies))


def beyond_limits(arm: Arm, q_start: Array) -> Fault | None:
    """Which of the arm's joints are beyond their limits at q_0 (nq,), and how far."""
    beyond = []
    # Joints beyond their limits, but for those that turn without end.
    for joint, q, lower, upper in zip(
        arm.joints, q_start[arm.q_index].tolist(), arm.lower, arm.upper, strict=True
    ):
        if joint in arm.continuous or lower <= q <= upper:
            continue
        side, limit = ("lower", lower) if q < lower else ("upper", upper)
        beyond.append(
            f"{joint} = {q:.4f} is not in [{lower:.4f}, {upper:.4f}], {abs(q - limit):.4g} beyond "
            f"its {side} limit"
        )
    if not beyond:
        return None
    return Fault(
        f"beyond the joint limits: {listed(beyond)}",
        (
            "move these joints back between their limits, raise start_limit_tolerance where they "
            "are barely beyond, or correct the limits in the URDF",
        ),
    )


def met_itself(robot: Robot, q: Array, links: list[tuple[str, str]]) -> Fault:
    """The fault of links that meet each other at q (nq,), with what they need to be left out."""
    # Where the links of each pair are deepest in each other.
    rows = dict.fromkeys(sorted_pair(*each) for each in links)
    overlaps, placements = _robot_overlaps(robot), robot.geometry_poses(q)
    words = []
    for first, second in rows:
        said, deepest = f"{first} meets {second}", 0.0
        for i, j in product(_shapes_of(robot, first), _shapes_of(robot, second)):
            depth = overlaps.depth(i, j, placements[i], placements[j])
            if depth > deepest:
                x, y, z = overlaps.place(i, j, placements[i], placements[j])
                said = (
                    f"{first} meets {second} at ({x:.3f}, {y:.3f}, {z:.3f}), their shapes "
                    f"{depth:.4f} m in each other"
                )
                deepest = depth
        words.append(said)
    if any(HELD_OBJECT in each for each in rows):
        return Fault(f"in self-collision: {listed(words)}", (CHECK_GRASP, MOVE_ROBOT))
    remedy = (
        "where the robot does stand like this and only its meshes overlap, add to the SRDF "
        f"(robot_description_semantic): {' '.join(map(srdf_line, rows))}"
    )
    return Fault(f"in self-collision: {listed(words)}", (remedy, MOVE_ROBOT))


def _shapes_of(robot: Robot, link: str) -> list[int]:
    return [i for i, name in enumerate(robot.geometry_links) if name == link]


def met_environment(met: str, near: bool, margin: float) -> Fault:
    """The fault of what meets the clouds, in words.

    Args:
        near: whether it does so only within the margin (metres) around it.
    """
    if not near:
        return Fault(f"{WITH_CLOUDS}: {met}", (MOVE_ROBOT, FILTER_ITSELF))
    within = f"{met}, nearer than collision_margin = {margin:g} m without touching it"
    return Fault(f"{WITH_CLOUDS}: {within}", ("lower collision_margin", MOVE_ROBOT, FILTER_ITSELF))


class StartState:
    """The robot's geometries at one configuration (nq,)."""

    def __init__(self, robot: Robot, q: Array) -> None:
        self._robot = robot
        self._data = robot.model.createData()
        pin.framesForwardKinematics(robot.model, self._data, q)
        objects, places = robot.geometry.geometryObjects, robot.geometry_poses(q)
        self._solids = [
            (g.geometry, coal.Transform3s(T.rotation, T.translation))
            for g, T in zip(objects, places, strict=True)
        ]
        self._q, self._places, self._overlaps = q, places, _robot_overlaps(robot)
        centers, self._radii = self._overlaps.centers, self._overlaps.radii
        self._centers = np.array([T.act(c) for T, c in zip(places, centers, strict=True)])
        self._centers = self._centers.reshape(-1, 3)

    def met(self, arm: Arm, margin: float) -> Fault | None:
        """Which links meet that move to each other with the arm; None where none do."""
        pairs, carried = _checked_pairs(self._robot), _carrying_joints(self._robot, arm)
        # Pairs that the arm moves against each other, and whose balls are near.
        pairs = pairs[carried[pairs[:, 0]] != carried[pairs[:, 1]]]
        apart = np.linalg.norm(self._centers[pairs[:, 0]] - self._centers[pairs[:, 1]], axis=1)
        near = apart <= self._radii[pairs[:, 0]] + self._radii[pairs[:, 1]] + margin
        names, met = self._robot.geometry_links, []
        for a, b in pairs[near].tolist():
            (first, T_first), (second, T_second) = self._solids[a], self._solids[b]
            if meet(first, T_first, second, T_second, margin) or self._overlaps.nested(
                a, b, self._places[a], self._places[b]
            ):
                met.append((names[a], names[b]))
                if len(set(met)) == _NAMED_PAIRS:
                    break
        return met_itself(self._robot, self._q, met) if met else None

    def tilt(self, arm: Arm, grasp: int, limit: TiltLimit) -> float:
        """Angle of the held object's `up` from the vertical, rad."""
        return limit.tilt(self._at(arm, grasp).rotation)

    def leans(self, arm: Arm, grasp: int, limit: TiltLimit | None) -> Fault | None:
        """Whether the held object leans by more than it may."""
        return None if limit is None else tilt_fault(limit, self.tilt(arm, grasp, limit))

    def bad_grasps(self, arm: Arm, body: Body) -> list[GraspError]:
        """Grasps in which the object lies in the hand."""
        found = []
        for grasp in range(len(arm.grasps)):
            depths = self.depths_in_hand(arm, grasp, body)
            if depths:
                found.append(object_in_hand(arm, grasp, depths))
        return found

    def met_when_held(
        self,
        arm: Arm,
        grasp: int,
        body: Body,
        settings: CollisionSettings,
        obstacles: ObstacleSet | None = None,
        keep_out: Array | None = None,
    ) -> Fault | GraspError | None:
        """What the object meets in a grasp: the hand, boxes to keep out of, another link, the
        environment; None where nothing."""
        depths = self.depths_in_hand(arm, grasp, body)
        if depths:
            return object_in_hand(arm, grasp, depths)
        link = self.met_by_object(arm, grasp, body, settings.self_margin)
        if link:
            words = f"in self-collision: {HELD_OBJECT} meets {link}"
            return Fault(words, (CHECK_GRASP, MOVE_ROBOT))
        margin, fault = settings.collision_margin, None
        if keep_out is not None:
            fault = self.kept_out(keep_out, arm, grasp, body, margin)
        if obstacles is not None:
            fault = fault or _met_in(obstacles, self._held(arm, grasp, body), margin)
        return fault

    def depths_in_hand(self, arm: Arm, grasp: int, body: Body) -> dict[str, float]:
        """How deep, metres, the object lies in links of the hand that it may not touch."""
        rows = np.flatnonzero(self._in_hand(arm)).tolist()
        rows = [i for i in rows if self._robot.geometry_links[i] not in arm.touch_links]
        return depths_in_links(self._robot, body, rows, self._places, self._at(arm, grasp))

    def met_by_object(self, arm: Arm, grasp: int, body: Body, margin: float) -> str:
        """Which link that is not of the hand the object meets first; '' where none."""
        T = self._at(arm, grasp)
        overlaps, first = object_overlaps(self._robot, body), len(self._solids)
        others = ~self._in_hand(arm)
        for j in range(first, len(overlaps.shapes)):
            away = np.linalg.norm(self._centers - T.act(overlaps.centers[j]), axis=1)
            near = away <= self._radii + overlaps.radii[j] + margin
            for i in np.flatnonzero(near & others).tolist():
                link = self._robot.geometry_links[i]
                if link not in arm.touch_links and overlaps.meet(i, j, self._places[i], T, margin):
                    return link
        return ""

    def _at(self, arm: Arm, grasp: int) -> pin.SE3:
        """Where the object is in a grasp."""
        return self._data.oMf[self._robot.frame_id(arm.tip_frame)] * arm.grasps[grasp]

    def _in_hand(self, arm: Arm) -> npt.NDArray[np.bool_]:
        """Which geometries move with the hand."""
        robot, model = self._robot, self._robot.model
        tip = model.frames[robot.frame_id(arm.tip_frame)].parentJoint
        hand = arm_joint(model, _joint_ids(robot, arm), tip)
        return np.asarray(_carrying_joints(robot, arm) == hand)

    def kept_out(
        self, boxes: Array, arm: Arm, grasp: int, body: Body, margin: float
    ) -> Fault | None:
        """Which link that the arm moves, or whether the object, is in a box (k, 2, 3) or nearer to
        it than the margin; None where neither is."""
        things = [*self._moved(arm), *self._held(arm, grasp, body)]
        met = _first_met(boxes[:, 0], boxes[:, 1], things, margin)
        if not met:
            return None
        words = f"q_0 is not free: {met.replace('the environment', 'a box of keep_out')}"
        return Fault(words, ("make the boxes of keep_out smaller", MOVE_ROBOT))

    def met_in(self, obstacles: ObstacleSet, arm: Arm, margin: float) -> Fault | None:
        """Which link that the arm moves meets the environment; None where none does."""
        return _met_in(obstacles, self._moved(arm), margin)

    def _moved(self, arm: Arm) -> list[_Thing]:
        """The geometries that the arm moves."""
        moved = np.flatnonzero(_carrying_joints(self._robot, arm) >= 0).tolist()
        return [(self._robot.geometry_links[i], *self._solids[i], None) for i in moved]

    def _held(self, arm: Arm, grasp: int, body: Body) -> list[_Thing]:
        """The object in that grasp."""
        T = self._at(arm, grasp)
        return [
            (HELD_OBJECT, solid.geometry, coal_transform(T), solid.around)
            for solid in object_solids(body)
        ]


def _met_in(
    obstacles: ObstacleSet,
    things: list[_Thing],
    margin: float,
) -> Fault | None:
    """Which of the things comes as near to a box as the margin; None where none does."""
    boxes = obstacles.lower, obstacles.upper
    met = _first_met(*boxes, things, margin)
    if not met:
        return None
    touching = _first_met(*boxes, things, 0.0)
    return met_environment(touching or met, not touching, margin)


def _first_met(
    box_lower: Array,
    box_upper: Array,
    things: list[_Thing],
    margin: float,
) -> str:
    """The first of the things that comes as near to a box, in words; '' where none does."""
    # Boxes along the axes around the things, the margin added.
    bounds = np.empty((len(things), 2, 3))
    for bound, (_, thing, T, _) in zip(bounds, things, strict=True):
        thing.computeLocalAABB()
        local = thing.aabb_local
        center = T.getRotation() @ ((local.min_ + local.max_) / 2) + T.getTranslation()
        half = np.abs(T.getRotation()) @ ((local.max_ - local.min_) / 2) + margin
        bound[:] = center - half, center + half
    # Boxes of the obstacles near any of them.
    lower, upper = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    near = ((box_lower <= upper) & (box_upper >= lower)).all(axis=1)
    corners = np.hstack([box_lower[near], box_upper[near]])
    for (low, high), (name, thing, T, around) in zip(bounds, things, strict=True):
        # Each thing against the boxes near it.
        for box in corners[((corners[:, :3] <= high) & (corners[:, 3:] >= low)).all(axis=1)]:
            at = coal.Transform3s(np.eye(3), (box[:3] + box[3:]) / 2)
            if meet(thing, T, coal.Box(box[3:] - box[:3]), at, margin) or _surface_encloses(
                around, T, (box[:3] + box[3:]) / 2
            ):
                x, y, z = (box[:3] + box[3:]) / 2
                return f"{name} meets the environment at ({x:.3f}, {y:.3f}, {z:.3f})"
    return ""


def _surface_encloses(triangles: Array | None, T: coal.Transform3s, point: Array) -> bool:
    """Whether a closed surface (t, 3, 3) at T encloses a point (3,)."""
    if triangles is None:
        return False
    # The point in the surface's frame, outside the box around that at once.
    local = T.getRotation().T @ (point - T.getTranslation())
    if (local < triangles.min(axis=(0, 1))).any() or (local > triangles.max(axis=(0, 1))).any():
        return False
    return winding_number(local, triangles) > 0.5


@lru_cache(maxsize=4)
def _robot_overlaps(robot: Robot) -> Overlaps:
    return Overlaps.of(robot.geometry, robot.covers)


@lru_cache(maxsize=4)
def _checked_pairs(robot: Robot) -> npt.NDArray[np.int64]:
    """(m, 2) geometries that must not meet."""
    pairs = [(pair.first, pair.second) for pair in robot.geometry.collisionPairs]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


@lru_cache(maxsize=16)
def _carrying_joints(robot: Robot, arm: Arm) -> npt.NDArray[np.int64]:
    """(n,) per geometry, the arm's last joint that moves it; -1 where none does."""
    joints, ids = [g.parentJoint for g in robot.geometry.geometryObjects], _joint_ids(robot, arm)
    return np.array([arm_joint(robot.model, ids, joint) for joint in joints], dtype=np.int64)


def _joint_ids(robot: Robot, arm: Arm) -> list[int]:
    return [robot.model.getJointId(name) for name in arm.joints]
