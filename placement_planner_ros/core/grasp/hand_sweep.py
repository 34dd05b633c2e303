"""The space that a hand sweeps while it opens, as convex geometry of a robot's links."""

from __future__ import annotations

import functools
import itertools
from dataclasses import replace

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.spatial import ConvexHull, QhullError

from placement_planner_ros.core.body.convex_part import hull_around, simpler_hull
from placement_planner_ros.core.collision.shapes import shape_of
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.geometry import LinkCover, convex_shape
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array

_COPY_TURN_RAD = 0.05
"""rad that all joints that turn a part together turn between two copies of it, at most."""
STILL_M = 1e-9
"""m, or of a rotation matrix: what moves less as the hand opens does not move."""
_FLAT_THICKNESS_M = 1e-4
"""m that flat geometry is given, which has no hull."""
_ROUNDED_CORNER_M = 2e-4
"""m that corners of rounded fingers may lie outside what these are taken for: they have hundreds,
and each of the hulls that they sweep has those of two copies."""


def with_opening_hand(robot: Robot, arm: Arm, q: Array) -> Robot:
    """The robot, each part of its fingers as large as what it sweeps by opening from q (nq,) on.

    Between two openings that is the hull of both copies, enlarged by as much as the way from one
    to the other may be curved, and by what rounded fingers lose of their corners: exact where
    fingers of few corners slide, and enclosing always.
    """
    change = robot.with_open_hand(q, arm) - q
    hand = np.where(change != 0.0, q, 0.0)
    return _swept_hand(robot, hand.tobytes(), change.tobytes())


@functools.lru_cache(maxsize=8)
def _swept_hand(robot: Robot, hand_bytes: bytes, change_bytes: bytes) -> Robot:
    """`with_opening_hand` from q (nq,) on by that change (nq,)."""
    hand, change = np.frombuffer(hand_bytes), np.frombuffer(change_bytes)
    # Which joints move each frame, and by how much the parts turn together.
    turns = revolute_coordinates(robot)
    joints = {thing.parentJoint for thing in robot.geometry.geometryObjects}
    movers = {joint: moving_coordinates(robot, joint) & (change != 0.0) for joint in joints}
    turned = max((np.abs(change[each & turns]).sum() for each in movers.values()), default=0.0)
    steps = max(1, int(np.ceil(turned / _COPY_TURN_RAD)))
    frames = joint_frames(robot, hand, change, steps)
    change = np.abs(change) / steps
    swept = pin.GeometryModel()
    links: list[str] = []
    covers: list[LinkCover | None] = []
    for link, thing, cover in zip(
        robot.geometry_links, robot.geometry.geometryObjects, robot.covers, strict=True
    ):
        joint = thing.parentJoint
        # What does not move stays as it is.
        if all(frame[joint].isApprox(frames[0][joint], STILL_M) for frame in frames):
            swept.addGeometryObject(pin.GeometryObject(thing))
            links.append(link)
            covers.append(cover)
            continue
        # Its corners, placed at every copy.
        corners = _solid_vertices(thing.geometry, link)
        local = simpler_hull(hull_around(corners), _ROUNDED_CORNER_M).vertices
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
            hull = convex_shape(np.vstack([before, after]))
            hull.setSweptSphereRadius(strays)
            swept.addGeometryObject(
                pin.GeometryObject(
                    f"{thing.name}_{k}", joint, thing.parentFrame, frames[0][joint].inverse(), hull
                )
            )
            links.append(link)
            covers.append(None)
    return replace(robot, geometry=swept, geometry_links=tuple(links), covers=tuple(covers))


def moving_coordinates(robot: Robot, joint: int) -> npt.NDArray[np.bool_]:
    """(nq,) which coordinates move that joint's frame."""
    result = np.zeros(robot.model.nq, np.bool_)
    result[[k - 1 for k in robot.model.supports[joint] if k > 0]] = True
    return result


def revolute_coordinates(robot: Robot) -> npt.NDArray[np.bool_]:
    """(nq,) which coordinates are angles."""
    return ~np.isin(robot.joint_names, list(robot.prismatic))


def joint_frames(robot: Robot, q: Array, change: Array, steps: int) -> list[list[pin.SE3]]:
    """The frames of all joints, in so many equal steps from q (nq,) to q + change."""
    data, frames = robot.model.createData(), []
    for share in np.linspace(0.0, 1.0, steps + 1):
        step("opening the hand")
        pin.forwardKinematics(robot.model, data, q + share * change)
        frames.append([pin.SE3(T) for T in data.oMi])
    return frames


def _solid_vertices(geometry: coal.CollisionGeometry, link: str) -> Array:
    """(m, 3) vertices of a solid that contains the geometry: its hull, or a box where it is round
    or flat."""
    # Vertices of a mesh, or of a shape with what rounds it.
    if isinstance(geometry, coal.BVHModelBase):
        vertices, radius = np.array(geometry.vertices()), 0.0
    else:
        sets = shape_of(geometry, f"link {link}").sets
        vertices = np.vstack([s.vertices for s in sets])
        radius = max(s.radius for s in sets)
    # Their hull, unless it is flat or rounded: then the box around them.
    if radius == 0.0:
        try:
            return np.asarray(vertices[ConvexHull(vertices).vertices])
        except QhullError:
            radius = _FLAT_THICKNESS_M
    corners = np.array([vertices.min(axis=0) - radius, vertices.max(axis=0) + radius])
    return np.array(list(itertools.product(*corners.T)))
