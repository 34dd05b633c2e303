"""Whether the robot can begin as it stands.

What `usable_holdings` asks, by coal alone: in milliseconds, for any robot, and before anything is
compiled or covered with spheres. What is refused here is refused there; there, what lies so close
to a margin that nothing is certain is refused too.
"""

from __future__ import annotations

from functools import lru_cache

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.arm import (
    HELD_OBJECT,
    CollisionSettings,
    arm_joint,
    object_in_hand,
    object_solids,
)
from placement_planner_ros.core.errors import GraspError, PlacementPlannerError, StartError
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import Array

WITH_CLOUDS = "in collision with the clouds"
"""How a collision with the obstacle set begins, in words."""


def faults_at_start(
    robot: Robot,
    arms: tuple[Arm, ...],
    q_start: Array,
    body: Body,
    settings: CollisionSettings,
    obstacles: ObstacleSet | None = None,
) -> tuple[str, ...]:
    """Why some arms and grasps cannot be used: joint limits and collision at q_0 (nq,).

    Args:
        obstacles: the environment; None where it is not known yet.

    Raises:
        StartError: q_0 is wrong for every arm and grasp.
        GraspError: in every grasp the object overlaps the hand.
    """
    reasons: list[str] = []
    bad_grasps: list[GraspError] = []
    usable = 0
    solids = [solid for _, solid in object_solids(body)]
    placed = _Placed(robot, q_start)
    margin = settings.collision_margin
    for arm in arms:
        fault = beyond_limits(arm, q_start) or placed.met(arm, settings.self_margin)
        if obstacles is not None and not fault:
            fault = placed.met_in(obstacles, arm, margin)
        if fault:
            reasons.append(f"{arm.name}: {fault}")
            continue
        for grasp in range(len(arm.grasps)):
            in_hand, link = placed.met_by_object(arm, grasp, solids, settings.self_margin)
            in_cloud = ""
            if obstacles is not None and not link:
                in_cloud = placed.met_by_object_in(obstacles, arm, grasp, solids, margin)
            if in_cloud:
                reasons.append(f"{arm.name} with grasp {grasp}: {in_cloud}")
            elif not link:
                usable += 1
            elif in_hand:
                bad_grasps.append(object_in_hand(arm, grasp, link))
            else:
                met = f"in self-collision: the held object meets {link}"
                reasons.append(f"{arm.name} with grasp {grasp}: {met}")
    if not usable:
        raise none_usable(reasons, bad_grasps)
    return (*map(str, bad_grasps), *reasons)


def none_usable(reasons: list[str], bad_grasps: list[GraspError]) -> PlacementPlannerError:
    """What to raise where no arm and grasp is left."""
    if not reasons:
        return bad_grasps[0]
    remedy = (
        "the start configuration must lie within the joint limits and keep collision_margin "
        "with the object in hand; move the robot"
    )
    if any(HELD_OBJECT in reason for reason in reasons):
        remedy += "; where it is the held object that is in the way, check grasps and object.scale"
    if any(WITH_CLOUDS in reason for reason in reasons):
        remedy += (
            "; where it meets points of its own or of the object, set self_filter.enabled or raise "
            "self_filter.padding"
        )
    return StartError("joint_states", "; ".join(reasons), remedy)


def beyond_limits(arm: Arm, q_start: Array) -> str:
    """Which of the arm's joints are beyond their limits at q_0 (nq,), '' where none is."""
    q = q_start[arm.q_index]
    joints = ", ".join(
        f"{arm.joints[j]} = {q[j]:.4f} is not in [{arm.lower[j]:.4f}, {arm.upper[j]:.4f}]"
        for j in np.flatnonzero((q < arm.lower) | (q > arm.upper))
    )
    return f"beyond the joint limits: {joints}" if joints else ""


class _Placed:
    """The robot's geometries at one configuration (nq,)."""

    def __init__(self, robot: Robot, q: Array) -> None:
        self._robot = robot
        self._data, geometry = robot.model.createData(), robot.geometry.createData()
        pin.updateGeometryPlacements(robot.model, self._data, robot.geometry, geometry, q)
        pin.updateFramePlacements(robot.model, self._data)
        objects = robot.geometry.geometryObjects
        self._solids = [
            (g.geometry, coal.Transform3s(T.rotation, T.translation))
            for g, T in zip(objects, geometry.oMg, strict=True)
        ]
        centers, self._radii = _spheres(robot)
        self._centers = np.array([T.act(c) for T, c in zip(geometry.oMg, centers, strict=True)])
        self._centers = self._centers.reshape(-1, 3)

    def met(self, arm: Arm, margin: float) -> str:
        """Which links meet that move to each other with the arm, in words; '' where none do."""
        pairs, carried = _pairs(self._robot), _carried(self._robot, arm)
        pairs = pairs[carried[pairs[:, 0]] != carried[pairs[:, 1]]]
        apart = np.linalg.norm(self._centers[pairs[:, 0]] - self._centers[pairs[:, 1]], axis=1)
        near = apart <= self._radii[pairs[:, 0]] + self._radii[pairs[:, 1]] + margin
        for a, b in pairs[near].tolist():
            (first, T_first), (second, T_second) = self._solids[a], self._solids[b]
            if _meets(first, T_first, second, T_second, margin):
                names = self._robot.geometry_links
                return f"in self-collision: {names[a]} meets {names[b]}"
        return ""

    def met_by_object(
        self, arm: Arm, grasp: int, parts: list[coal.Convex], margin: float
    ) -> tuple[bool, str]:
        """Whether the object lies in the hand, and which link it meets; '' where none."""
        robot, model = self._robot, self._robot.model
        frame = robot.frame_id(arm.tip_frame)
        T = self._data.oMf[frame] * arm.grasps[grasp]
        place = coal.Transform3s(T.rotation, T.translation)
        carried = _carried(robot, arm)
        hand = arm_joint(model, _joint_ids(robot, arm), model.frames[frame].parentJoint)
        in_hand = carried == hand
        for rows, kept in ((in_hand, 0.0), (~in_hand, margin)):
            for part in parts:
                part.computeLocalAABB()
                center = T.act(np.array(part.aabb_center))
                away = np.linalg.norm(self._centers - center, axis=1)
                near = away <= self._radii + part.aabb_radius + kept
                for i in np.flatnonzero(near & rows):
                    link, (solid, T_solid) = robot.geometry_links[i], self._solids[i]
                    if link not in arm.touch_links and _meets(part, place, solid, T_solid, kept):
                        return bool(in_hand[i]), link
        return False, ""

    def met_in(self, obstacles: ObstacleSet, arm: Arm, margin: float) -> str:
        """Which link that the arm moves meets the environment; '' where none does."""
        moved = np.flatnonzero(_carried(self._robot, arm) >= 0).tolist()
        things = [(self._robot.geometry_links[i], *self._solids[i]) for i in moved]
        return _met_in(obstacles, things, margin)

    def met_by_object_in(
        self, obstacles: ObstacleSet, arm: Arm, grasp: int, parts: list[coal.Convex], margin: float
    ) -> str:
        """Whether the object that the arm holds meets the environment; '' where it does not."""
        T = self._data.oMf[self._robot.frame_id(arm.tip_frame)] * arm.grasps[grasp]
        place = coal.Transform3s(T.rotation, T.translation)
        return _met_in(obstacles, [(HELD_OBJECT, part, place) for part in parts], margin)


def _met_in(
    obstacles: ObstacleSet,
    things: list[tuple[str, coal.CollisionGeometry, coal.Transform3s]],
    margin: float,
) -> str:
    """Which of the things meets a box, in words; '' where none does."""
    bounds = np.empty((len(things), 2, 3))
    for bound, (_, thing, T) in zip(bounds, things, strict=True):
        thing.computeLocalAABB()
        local = thing.aabb_local
        center = T.getRotation() @ ((local.min_ + local.max_) / 2) + T.getTranslation()
        half = np.abs(T.getRotation()) @ ((local.max_ - local.min_) / 2) + margin
        bound[:] = center - half, center + half
    lower, upper = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    near = ((obstacles.lower <= upper) & (obstacles.upper >= lower)).all(axis=1)
    corners = np.hstack([obstacles.lower[near], obstacles.upper[near]])
    for (low, high), (name, thing, T) in zip(bounds, things, strict=True):
        for box in corners[((corners[:, :3] <= high) & (corners[:, 3:] >= low)).all(axis=1)]:
            at = coal.Transform3s(np.eye(3), (box[:3] + box[3:]) / 2)
            if _meets(thing, T, coal.Box(box[3:] - box[:3]), at, margin):
                x, y, z = (box[:3] + box[3:]) / 2
                what = f"{name} meets the environment at ({x:.3f}, {y:.3f}, {z:.3f})"
                return f"{WITH_CLOUDS}: {what}"
    return ""


def _meets(
    a: coal.CollisionGeometry,
    T_a: coal.Transform3s,
    b: coal.CollisionGeometry,
    T_b: coal.Transform3s,
    margin: float,
) -> bool:
    """Whether two shapes are closer than `margin` metres."""
    request = coal.CollisionRequest()
    request.security_margin = margin
    return bool(coal.collide(a, T_a, b, T_b, request, coal.CollisionResult()))


@lru_cache(maxsize=4)
def _spheres(robot: Robot) -> tuple[Array, Array]:
    """Centres (n, 3) in their own frames and radii (n,) of spheres around the geometries."""
    centers, radii = [], []
    for thing in robot.geometry.geometryObjects:
        thing.geometry.computeLocalAABB()
        centers.append(np.array(thing.geometry.aabb_center))
        radii.append(float(thing.geometry.aabb_radius))
    return np.array(centers).reshape(-1, 3), np.array(radii)


@lru_cache(maxsize=4)
def _pairs(robot: Robot) -> npt.NDArray[np.int64]:
    """(m, 2) geometries that must not meet."""
    pairs = [(pair.first, pair.second) for pair in robot.geometry.collisionPairs]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


@lru_cache(maxsize=16)
def _carried(robot: Robot, arm: Arm) -> npt.NDArray[np.int64]:
    """(n,) per geometry, the arm's last joint that moves it; -1 where none does."""
    joints, ids = [g.parentJoint for g in robot.geometry.geometryObjects], _joint_ids(robot, arm)
    return np.array([arm_joint(robot.model, ids, joint) for joint in joints], dtype=np.int64)


def _joint_ids(robot: Robot, arm: Arm) -> list[int]:
    return [robot.model.getJointId(name) for name in arm.joints]
