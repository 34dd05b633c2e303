"""Opening the hand: what its fingers sweep, and that none of them pushes into the object."""

from __future__ import annotations

import functools
import itertools
from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.body.convex_part import hull_around, simpler_hull
from placement_planner_ros.core.body.covered_mesh import CoveredMesh
from placement_planner_ros.core.collision.attached_object import AttachedObject, object_overlaps
from placement_planner_ros.core.errors import GraspError
from placement_planner_ros.core.robot.arm import Arm, MovingArm
from placement_planner_ros.core.robot.geometry import convex_geometry
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.robot.overlap import Overlaps
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array, Mask
from placement_planner_ros.core.weak_cache import weak_lru_cache

_COPY_TURN_RAD = 0.05
"""rad that all joints that turn a part together turn between two copies of it, at most."""
_OPENING_STEP_M = 1e-3
"""m that corners of a finger move, about, between two openings that are looked at."""
_ADDED_DEPTH_M = 1e-4
"""m that a finger may get deeper into the object, for the numerics."""


def with_opening_hand(robot: Robot, arm: Arm, q: Array) -> Robot:
    """The robot, each part of its fingers as large as what it sweeps by opening from q (nq,) on.

    Between two openings that is the hull of both copies, enlarged by as much as the way from one
    to the other may be curved: exact where fingers of few corners slide, and enclosing always.
    """
    change = robot.with_open_hand(q, arm) - q
    hand = np.where(change != 0.0, q, 0.0)
    return _swept_hand(robot, hand.tobytes(), change.tobytes())


@functools.lru_cache(maxsize=8)
def _swept_hand(robot: Robot, hand_bytes: bytes, change_bytes: bytes) -> Robot:
    """`with_opening_hand` from q (nq,) on by that change (nq,)."""
    hand, change = np.frombuffer(hand_bytes), np.frombuffer(change_bytes)
    # Which joints move each frame, and by how much the parts turn together.
    turns = ~np.isin(robot.joint_names, list(robot.prismatic))  # which coordinates are angles
    joints = {thing.parentJoint for thing in robot.geometry.geometryObjects}
    movers = {joint: moving_coordinates(robot, joint) & (change != 0.0) for joint in joints}
    turned = max((np.abs(change[each & turns]).sum() for each in movers.values()), default=0.0)
    steps = max(1, int(np.ceil(turned / _COPY_TURN_RAD)))
    frames = joint_frames(robot, hand, change, steps)
    change = np.abs(change) / steps
    swept = pin.GeometryModel()
    links: list[str] = []
    meshes: list[CoveredMesh | None] = []
    for link, thing, mesh in zip(
        robot.geometry_links, robot.geometry.geometryObjects, robot.meshes, strict=True
    ):
        joint = thing.parentJoint
        # What does not move stays as it is.
        if not movers[joint].any():
            swept.addGeometryObject(pin.GeometryObject(thing))
            links.append(link)
            meshes.append(mesh)
            continue
        # Its corners, of round things those of the box around, placed at every copy.
        local = simpler_hull(hull_around(_corners_of(thing.geometry)), 0.0).vertices
        turning = movers[joint] & turns
        turn, slide = float(change[turning].sum()), float(change[movers[joint] & ~turns].sum())
        places = [frame[joint] * thing.placement for frame in frames]
        copies = [local @ T.rotation.T + T.translation for T in places]
        # How far they are from the axes that turn them.
        axes = np.array([[T.translation for T in frame[1:]] for frame in frames])[:, turning]
        away = [
            np.linalg.norm(copy[:, None] - axis, axis=2).max(initial=0.0)
            for copy, axis in zip(copies, axes, strict=True)
        ]
        # With W and V the turns and slides that a step moves it by, a point R from every axis
        # stays within (2 W² R + 2 W V) / 8 of the chord; within the step R grows by less than
        # W R + V.
        reach = max(away) * (1.0 + turn) + slide
        strays = 0.25 * turn * (turn * reach + slide)
        # The hull of each copy and the next.
        for k, (before, after) in enumerate(itertools.pairwise(copies)):
            step(f"making what {link} sweeps as the hand opens")
            hull = convex_geometry(hull_around(np.vstack([before, after])))
            hull.setSweptSphereRadius(strays)
            swept.addGeometryObject(
                pin.GeometryObject(
                    f"{thing.name}_{k}", joint, thing.parentFrame, frames[0][joint].inverse(), hull
                )
            )
            links.append(link)
            meshes.append(None)
    return replace(robot, geometry=swept, geometry_links=tuple(links), meshes=tuple(meshes))


def moving_coordinates(robot: Robot, joint: int) -> Mask:
    """(nq,) which coordinates move that joint's frame."""
    result = np.zeros(robot.model.nq, np.bool_)
    result[[k - 1 for k in robot.model.supports[joint] if k > 0]] = True
    return result


def joint_frames(robot: Robot, q: Array, change: Array, steps: int) -> list[list[pin.SE3]]:
    """The frames of all joints, in so many equal steps from q (nq,) to q + change."""
    data, frames = robot.model.createData(), []
    for share in np.linspace(0.0, 1.0, steps + 1):
        step("opening the hand")
        pin.forwardKinematics(robot.model, data, q + share * change)
        frames.append([pin.SE3(T) for T in data.oMi])
    return frames


def _corners_of(geometry: coal.CollisionGeometry) -> Array:
    """(n, 3) points whose hull holds a shape: of what is round the corners of the box around it."""
    if isinstance(geometry, coal.BVHModelBase):
        return np.array(geometry.vertices()).reshape(-1, 3)
    if isinstance(geometry, coal.ConvexBase):
        return np.array(geometry.points()).reshape(-1, 3)
    box = geometry.aabb_local
    return np.array(list(itertools.product(*zip(box.min_, box.max_, strict=True))))


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
    change = robot.with_open_hand(q, arm) - q
    at = robot.link_pose(q, arm.tip_frame) * arm.grasps[grasp]
    overlaps, first = object_overlaps(robot, body), len(robot.geometry_links)
    frames_in = functools.cache(functools.partial(joint_frames, robot, q, change))
    deepest: dict[str, float] = {}
    # Every geometry that moves against every solid of the object.
    for i, thing in enumerate(robot.geometry.geometryObjects):
        joint, link = thing.parentJoint, robot.geometry_links[i]
        if not (moving_coordinates(robot, joint) & (change != 0.0)).any():
            continue
        # How far it moves, in steps.
        ends = [frame[joint] * thing.placement for frame in frames_in(1)]
        away = [T.rotation @ _corners_of(thing.geometry).T + T.translation[:, None] for T in ends]
        far = float(np.linalg.norm(away[1] - away[0], axis=0).max())
        frames = frames_in(1 + int(far / _OPENING_STEP_M))
        places = [frame[joint] * thing.placement for frame in frames]
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
