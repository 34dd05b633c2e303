"""Opening the hand: no finger pushes into the object, and none stays deep in it."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.attached_object import AttachedObject
from placement_planner_ros.core.collision.object_solids import object_overlaps
from placement_planner_ros.core.errors import GraspError, RobotError
from placement_planner_ros.core.grasp.hand_sweep import STILL_M, revolute_coordinates
from placement_planner_ros.core.grasp.settings import PARTING_M
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.robot.moving_arm import MovingArm
from placement_planner_ros.core.robot.overlap import Overlaps
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.weak_cache import weak_lru_cache

_OPENING_STEP_M = 1e-3
_OPENING_STEP_RAD = 0.01
"""m or rad that the gripper joints together move between two openings that are looked at."""
_MAX_OPENINGS = 5000
"""Openings that are looked at, at most: 5 m, or 50 rad."""
_STILL_RAD = 1e-9
"""rad; what turns less does not turn."""
_ADDED_DEPTH_M = 1e-4
"""m that a finger may get deeper into the object, for the numerics."""
_FINE_DEPTH_M = 2e-5
"""m to which it is told how deep a mesh lies in another shape to begin with."""
_COARSE_DEPTH_M = 0.001
"""m by which a depth may be told too large."""


def check_opening(
    moving: MovingArm, held: AttachedObject, parted_within: float = PARTING_M
) -> None:
    """Raise if the hand, from where it is on, cannot let go of the object that it holds.

    A finger that lies in the object to begin with, as joint states and meshes may have it, must
    not get deeper as the hand opens; what the open hand leaves in the object must come off soon.

    Args:
        parted_within: metres of the retreat within which it must have come off.

    Raises:
        GraspError: names the grasp, all links at once, and how deep each gets.
    """
    arm = moving.arm
    given = moving.robot, arm, held.grasp, held.body, moving.q_zero.tobytes()
    pushes, stuck = (
        dict(_pushing_links(*given)),
        dict(_stuck_links(*given, parted_within + _COARSE_DEPTH_M)),
    )
    words = []
    if pushes:
        words.append(f"opening the hand pushes {_listed_depths(pushes)} into the object")
    if stuck:
        words.append(
            f"the open hand leaves {_listed_depths(stuck)} in the object, and the retreat must "
            f"have brought it off within {parted_within:g} m"
        )
    if words:
        raise GraspError(
            f"{arm.name}.grasps[{held.grasp}]",
            pin.SE3ToXYZQUAT(arm.grasps[held.grasp]).round(4).tolist(),
            f"{'; '.join(words)}; move the grasp, check gripper_open and object.scale, give links "
            "whose collision shapes are only drawn around the hand closer ones, or set "
            "require_retreat to false",
        )


def _listed_depths(depths: dict[str, float]) -> str:
    return ", ".join(f"{link} {depth:.4f} m" for link, depth in depths.items())


@dataclass(frozen=True, slots=True)
class _Finger:
    """A geometry that opening moves.

    Attributes:
        number: of the robot's geometries.
        places: where it is from the beginning to the end of opening.
        travel: no point of it gets further than this from where it begins, metres.
        slides: whether it does not turn on the way.
    """

    number: int
    link: str
    places: tuple[pin.SE3, ...]
    travel: float
    slides: bool


Depths = tuple[tuple[str, float], ...]
"""Links, and metres."""


@weak_lru_cache("body", maxsize=64)
def _pushing_links(robot: Robot, arm: Arm, grasp: int, body: Body, q_bytes: bytes) -> Depths:
    """Which links get how much deeper into the object than they begin, beyond `_ADDED_DEPTH_M`."""
    # The object as it is held.
    at = robot.link_pose(np.frombuffer(q_bytes), arm.tip_frame) * arm.grasps[grasp]
    overlaps, first = object_overlaps(robot, body), len(robot.geometry_links)
    deepest: dict[str, float] = {}
    # Every finger that moves against every solid of the object.
    for finger in _moving_fingers(robot, arm, q_bytes):
        for number in range(first, len(overlaps.shapes)):
            depth = _added_depth(finger, overlaps, number, at)
            if depth > _ADDED_DEPTH_M:
                deepest[finger.link] = max(depth, deepest.get(finger.link, 0.0))
    return tuple(deepest.items())


@weak_lru_cache("body", maxsize=64)
def _stuck_links(
    robot: Robot, arm: Arm, grasp: int, body: Body, q_bytes: bytes, most: float
) -> Depths:
    """Which links lie deeper in the object than `most`, metres, when the hand is open."""
    # The hand open, with the object where it is held.
    q = robot.with_open_hand(np.frombuffer(q_bytes), arm)
    places = robot.geometry_poses(q)
    at = robot.link_pose(q, arm.tip_frame) * arm.grasps[grasp]
    overlaps, first = object_overlaps(robot, body), len(robot.geometry_links)
    found: dict[str, float] = {}
    # Every link that may touch, against every solid.
    for i, link in enumerate(robot.geometry_links):
        if link not in arm.touch_links:
            continue
        step(f"looking how deep {link} of the open hand lies in the object")
        for j in range(first, len(overlaps.shapes)):
            depth = overlaps.depth(i, j, places[i], at, beyond=most)
            if depth > most:
                found[link] = max(depth, found.get(link, 0.0))
    return tuple(found.items())


def _added_depth(finger: _Finger, overlaps: Overlaps, number: int, at: pin.SE3) -> float:
    """How much deeper it gets into the object's solid of that number than it begins, metres."""
    # Balls around both, too far apart to meet on the way.
    i, places = finger.number, finger.places
    apart = np.linalg.norm(places[0].act(overlaps.centers[i]) - at.act(overlaps.centers[number]))
    if apart > overlaps.radii[i] + overlaps.radii[number] + finger.travel:
        return 0.0
    # The gap of two solids is a convex function of the way that one slides along.
    if finger.slides and not overlaps.has_mesh(i, number):
        first, second = (overlaps.solids_gap(i, number, place, at) for place in places[:2])
        last = first + (len(places) - 1) * min(second - first, 0.0)
        if last > min(first, 0.0) - _ADDED_DEPTH_M:
            return 0.0
    # The depth at the beginning, and the greatest one on the way.
    begun = overlaps.depth(i, number, places[0], at, _FINE_DEPTH_M)
    most = begun
    for place in places[1:]:
        step(f"looking whether {finger.link} opens into the object")
        told = max(begun + _ADDED_DEPTH_M, most)
        most = max(most, overlaps.depth(i, number, place, at, beyond=told))
    return most - begun


@functools.lru_cache(maxsize=8)
def _moving_fingers(robot: Robot, arm: Arm, q_bytes: bytes) -> tuple[_Finger, ...]:
    q = np.frombuffer(q_bytes)
    # How far the joints move, in steps.
    change = robot.with_open_hand(q, arm) - q
    turning = revolute_coordinates(robot)
    steps = max(
        1,
        int(np.ceil(np.abs(change / np.where(turning, _OPENING_STEP_RAD, _OPENING_STEP_M)).sum())),
    )
    if steps > _MAX_OPENINGS:
        raise RobotError(
            f"{arm.name}.gripper_open",
            list(arm.gripper_open),
            f"is too far from where the gripper is: {steps} steps of {_OPENING_STEP_M:g} m or "
            f"{_OPENING_STEP_RAD:g} rad, and {_MAX_OPENINGS} are looked at; give it in m or rad",
        )
    # Joint frames at every step.
    data = robot.model.createData()
    frames = []
    for share in np.linspace(0.0, 1.0, steps + 1):
        step(f"opening the hand of arm {arm.name}")
        pin.forwardKinematics(robot.model, data, q + share * change)
        frames.append([pin.SE3(T) for T in data.oMi])
    # Geometries on joints that move.
    fingers, moved = [], _moved_joints(robot, change)
    for i, (link, thing) in enumerate(
        zip(robot.geometry_links, robot.geometry.geometryObjects, strict=True)
    ):
        if thing.parentJoint not in moved:
            continue
        step(f"opening the hand of arm {arm.name}, at {link}")
        # How far any point of it gets from where it begins.
        ways = [frames[0][thing.parentJoint].actInv(f[thing.parentJoint]) for f in frames]
        turned = max(float(np.linalg.norm(pin.log3(way.rotation))) for way in ways)
        thing.geometry.computeLocalAABB()
        reach = float(np.linalg.norm(thing.placement.act(thing.geometry.aabb_center)))
        reach += thing.geometry.aabb_radius
        travel = max(float(np.linalg.norm(way.translation)) for way in ways) + turned * reach
        if travel > STILL_M:
            places = tuple(frame[thing.parentJoint] * thing.placement for frame in frames)
            fingers.append(_Finger(i, link, places, travel, slides=turned <= _STILL_RAD))
    return tuple(fingers)


def _moved_joints(robot: Robot, change: Array) -> set[int]:
    """Joints that a change (nq,) of configuration moves, themselves or by one they hang on."""
    moved: set[int] = set()
    for joint in range(1, robot.model.njoints):
        first = robot.model.idx_qs[joint]
        own = change[first : first + robot.model.nqs[joint]]
        if own.any() or robot.model.parents[joint] in moved:
            moved.add(joint)
    return moved
