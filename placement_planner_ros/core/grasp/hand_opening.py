"""Opening the hand: no finger pushes into the object."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.attached_object import AttachedObject, object_overlaps
from placement_planner_ros.core.errors import GraspError
from placement_planner_ros.core.grasp.hand_sweep import (
    joint_frames,
    moving_coordinates,
    revolute_coordinates,
)
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.robot.moving_arm import MovingArm
from placement_planner_ros.core.robot.overlap import Overlaps
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.weak_cache import weak_lru_cache

_OPENING_STEP_M = 1e-3
_OPENING_STEP_RAD = 0.01
"""m or rad that the gripper joints together move between two openings that are looked at."""
_ADDED_DEPTH_M = 1e-4
"""m that a finger may get deeper into the object, for the numerics."""


def opening_error(moving: MovingArm, held: AttachedObject) -> GraspError | None:
    """Which links get deeper into the held object as the hand opens from where it is on.

    A finger that lies in the object to begin with, as joint states and meshes may have it, must
    not get deeper.
    """
    arm = moving.arm
    pushes = _pushing_links(moving.robot, arm, held.grasp, held.body, moving.q_zero.tobytes())
    if not pushes:
        return None
    depths = ", ".join(f"{link} {depth:.4f} m" for link, depth in pushes)
    return grasp_error(
        arm,
        held.grasp,
        f"opening the hand pushes {depths} into the object; move the grasp, check gripper_open and "
        "`scale`, give links whose collision shapes are only drawn around the hand closer "
        "ones, or set require_retreat to false",
    )


def grasp_error(arm: Arm, grasp: int, remedy: str) -> GraspError:
    """What is wrong with a grasp, named with its pose."""
    pose = pin.SE3ToXYZQUAT(arm.grasps[grasp]).round(4).tolist()
    return GraspError(f"`grasps[{grasp}]` of arm {arm.name}", pose, remedy)


@weak_lru_cache("body", maxsize=64)
def _pushing_links(
    robot: Robot, arm: Arm, grasp: int, body: Body, q_bytes: bytes
) -> tuple[tuple[str, float], ...]:
    """Links that get deeper into the object than they begin, beyond `_ADDED_DEPTH_M`; metres."""
    q = np.frombuffer(q_bytes)
    # How far the joints move, in steps.
    change = robot.with_open_hand(q, arm) - q
    step_sizes = np.where(revolute_coordinates(robot), _OPENING_STEP_RAD, _OPENING_STEP_M)
    steps = max(1, int(np.ceil(np.abs(change / step_sizes).sum())))
    frames = joint_frames(robot, q, change, steps)
    at = robot.link_pose(q, arm.tip_frame) * arm.grasps[grasp]
    overlaps, first = object_overlaps(robot, body), len(robot.geometry_links)
    deepest: dict[str, float] = {}
    # Every geometry that moves against every solid of the object.
    for i, thing in enumerate(robot.geometry.geometryObjects):
        if not (moving_coordinates(robot, thing.parentJoint) & (change != 0.0)).any():
            continue
        link = robot.geometry_links[i]
        places = [frame[thing.parentJoint] * thing.placement for frame in frames]
        for j in range(first, len(overlaps.shapes)):
            step(f"looking whether {link} opens into the object")
            depth = _added_depth(overlaps, (i, j), places, at)
            if depth > _ADDED_DEPTH_M:
                deepest[link] = max(depth, deepest.get(link, 0.0))
    return tuple(deepest.items())


def _added_depth(
    overlaps: Overlaps, pair: tuple[int, int], places: list[pin.SE3], at: pin.SE3
) -> float:
    """How much deeper the first shape gets into the second, at a pose, than it begins, metres."""
    i, j = pair
    # The depth at the beginning, and the greatest one on the way; what hardly touches is not deep.
    most = begun = overlaps.depth(i, j, places[0], at, beyond=0.1 * _ADDED_DEPTH_M)
    for place in places[1:]:
        told = max(begun + _ADDED_DEPTH_M, most)
        most = max(most, overlaps.depth(i, j, place, at, beyond=told))
    return most - begun
