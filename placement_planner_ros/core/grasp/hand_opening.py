"""Whether a hand can let go: no finger pushes into the object while it opens."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.arm import coal_convex
from placement_planner_ros.core.collision.load import Held
from placement_planner_ros.core.errors import GraspError, RobotError
from placement_planner_ros.core.grasp.hand_sweep import revolute
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.robot.moving_arm import MovingArm
from placement_planner_ros.core.stopping import step

_TRAVEL = 1e-3
_TURN = 0.01
"""m or rad that the gripper joints together move between two openings that are looked at."""
_MOST = 5000
"""Openings that are looked at, at most: 5 m, or 50 rad."""
_STILL = 1e-9
"""m; geometry that moves less does not move."""
_DEEPER = 1e-4
"""m that a finger may get deeper into the object, for the numerics."""


def check_opening(moving: MovingArm, held: Held) -> None:
    """Raise if opening the hand, from where it is on, pushes a finger into the object it holds.

    A finger that lies in the object to begin with, as joint states and meshes may have it, must
    not get deeper.

    Raises:
        GraspError: names the grasp, the link and how deep it gets.
    """
    arm = moving.arm
    link, depth = _deepest(moving.robot, arm, held.grasp, held.body, moving.q_zero.tobytes())
    if depth > _DEEPER:
        raise GraspError(
            f"{arm.name}.grasps[{held.grasp}]",
            arm.grasps[held.grasp].homogeneous.round(4).tolist(),
            f"opening the hand pushes {link} {1000 * depth:.1f} mm into the object; "
            "move the grasp, check gripper_open, or set require_retreat to false",
        )


@dataclass(frozen=True, slots=True)
class _Finger:
    """A geometry that opening moves.

    Attributes:
        places: where it is from the beginning to the end of opening.
        travel: no point of it gets further than this from where it begins, metres.
        slides: whether it is convex and slides, so that its distance from convex things is a convex
            function of the way.
    """

    link: str
    geometry: coal.CollisionGeometry
    places: tuple[coal.Transform3s, ...]
    travel: float
    slides: bool


@functools.lru_cache(maxsize=64)
def _deepest(robot: Robot, arm: Arm, grasp: int, body: Body, q_bytes: bytes) -> tuple[str, float]:
    """Which finger gets how much deeper into the object than it begins, metres."""
    at = _coal(robot.link_pose(np.frombuffer(q_bytes), arm.tip_frame) * arm.grasps[grasp])
    parts = [coal_convex(part.vertices, part.triangles) for part in body.parts]
    deepest = "", 0.0
    for finger in _fingers(robot, arm, q_bytes):
        for part in parts:
            depth = _deeper(finger, part, at)
            if depth > deepest[1]:
                deepest = finger.link, depth
    return deepest


def _deeper(finger: _Finger, part: coal.CollisionGeometry, at: coal.Transform3s) -> float:
    """How much deeper it gets into a part than it begins, metres; only looked at where it might."""
    first = _gap(finger, 0, part, at)
    if first > finger.travel:
        return 0.0
    allowed = min(first, 0.0)
    second = _gap(finger, 1, part, at)
    steps = len(finger.places) - 1
    if finger.slides and first + steps * min(second - first, 0.0) > allowed - _DEEPER:
        return 0.0
    least = second
    for stage in range(2, steps + 1):
        step(f"looking whether {finger.link} opens into the object")
        least = min(least, _gap(finger, stage, part, at))
    return allowed - least


@functools.lru_cache(maxsize=8)
def _fingers(robot: Robot, arm: Arm, q_bytes: bytes) -> tuple[_Finger, ...]:
    q = np.frombuffer(q_bytes)
    change = robot.with_open_hand(q, arm) - q
    turning = revolute(robot)
    steps = max(1, int(np.ceil(np.abs(change / np.where(turning, _TURN, _TRAVEL)).sum())))
    if steps > _MOST:
        raise RobotError(
            f"{arm.name}.gripper_open",
            list(arm.gripper_open),
            f"is too far from where the gripper is: {steps} steps of {_TRAVEL:g} m or {_TURN:g} "
            f"rad, and {_MOST} are looked at; give it in m or rad",
        )
    data = robot.model.createData()
    frames = []
    for share in np.linspace(0.0, 1.0, steps + 1):
        step(f"opening the hand of arm {arm.name}")
        pin.forwardKinematics(robot.model, data, q + share * change)
        frames.append([pin.SE3(T) for T in data.oMi])
    fingers = []
    for link, thing in zip(robot.geometry_links, robot.geometry.geometryObjects, strict=True):
        step(f"opening the hand of arm {arm.name}, at {link}")
        ways = [frames[0][thing.parentJoint].actInv(f[thing.parentJoint]) for f in frames]
        turned = max(float(np.linalg.norm(pin.log3(way.rotation))) for way in ways)
        thing.geometry.computeLocalAABB()
        reach = float(np.linalg.norm(thing.placement.act(thing.geometry.aabb_center)))
        reach += thing.geometry.aabb_radius
        travel = max(float(np.linalg.norm(way.translation)) for way in ways) + turned * reach
        if travel > _STILL:
            places = tuple(_coal(frame[thing.parentJoint] * thing.placement) for frame in frames)
            slides = turned < _STILL and not isinstance(thing.geometry, coal.BVHModelBase)
            fingers.append(_Finger(link, thing.geometry, places, travel, slides))
    return tuple(fingers)


def _gap(finger: _Finger, stage: int, part: coal.CollisionGeometry, at: coal.Transform3s) -> float:
    """Signed distance, metres."""
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    return float(
        coal.distance(
            finger.geometry, finger.places[stage], part, at, request, coal.DistanceResult()
        )
    )


def _coal(T: pin.SE3) -> coal.Transform3s:
    return coal.Transform3s(T.rotation, T.translation)
