"""Size of the object against what such a hand holds: is its mesh in another unit?"""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.weak_cache import weak_lru_cache

_HAND_PER_OBJECT = 6.0
"""Times that a hand is larger than the object's longest side, for it to be doubted."""
_HAND_SHARE_OF_REACH = 0.125
"""Share of an arm's reach that its hand is large at least: some hands have but a link for a tip."""
_OBJECT_SHARE_OF_REACH = 0.75
"""Share of an arm's reach that the object's longest side is, for it to be doubted."""


def size_doubt(robot: Robot, arms: tuple[Arm, ...], q: Array, body: Body) -> str:
    """What is odd about the object's size beside hand and arm, in words; empty where nothing is.

    Too large is what has no side as short as the hand, or a longer one than most of the reach: ten
    times what hands hold is. Too small is what is lost in the hand. Only a doubt: of several arms,
    the one it fits best counts.

    Args:
        q: (nq,) where the robot stands.
    """
    doubts = [_size_doubt(robot, arm, q, body) for arm in arms]
    return doubts[0] if doubts and all(doubts) else ""


def _size_doubt(robot: Robot, arm: Arm, q: Array, body: Body) -> str:
    # The sides of the object against hand and reach.
    q = q.copy()
    q[arm.q_index] = 0.0  # wherever the arm is
    hand, reach = _hand_measures(robot, arm, q.round(4).tobytes())
    sides = np.sort(np.ptp(body.vertices, axis=0))
    size = " x ".join(f"{side:.4g}" for side in sides[::-1])
    if sides[-1] > _OBJECT_SHARE_OF_REACH * reach or sides[0] > hand:
        beside = f"{arm.name}'s hand is {hand:.2g} m large, its reach {reach:.2g} m"
        return (
            f"the object is large, {size} m, and {beside}; if its mesh is in another unit, set "
            "object.scale, such as 0.1 or 0.001 times what it is"
        )
    if hand > _HAND_PER_OBJECT * sides[-1]:
        return (
            f"the object is small, {size} m, and {arm.name}'s hand {hand:.2g} m large; if its mesh "
            "is in another unit, set object.scale, such as 10 or 1000 times what it is"
        )
    return ""


@weak_lru_cache("robot", maxsize=16)
def _hand_measures(robot: Robot, arm: Arm, q_bytes: bytes) -> tuple[float, float]:
    """How large the hand is taken to be, and how far the arm reaches; kept from start to start."""
    reach = stretched_length(robot, arm)
    return max(hand_size(robot, arm, np.frombuffer(q_bytes)), _HAND_SHARE_OF_REACH * reach), reach


def stretched_length(robot: Robot, arm: Arm) -> float:
    """Metres from the arm's first joint over all others to the tip: more than its reach."""
    # From joint to joint, from the tip inwards.
    ids = [robot.model.getJointId(joint) for joint in arm.joints]
    tip = robot.model.frames[robot.frame_id(arm.tip_frame)]
    steps = [float(np.linalg.norm(tip.placement.translation))]
    joint = tip.parentJoint
    while joint not in (0, ids[0]):
        steps.append(float(np.linalg.norm(robot.model.jointPlacements[joint].translation)))
        joint = robot.model.parents[joint]
    return sum(steps)


def hand_size(robot: Robot, arm: Arm, q: Array) -> float:
    """Longest side of what may touch the object, in the planning frame at q (nq,), metres; 0
    without geometry."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    shapes, poses = robot.geometry.geometryObjects, robot.geometry_poses(q)
    # The box around all links that may touch the object.
    for link, g, T in zip(robot.geometry_links, shapes, poses, strict=True):
        if link in arm.touch_links:
            g.geometry.computeLocalAABB()
            middle = T.act(np.array(g.geometry.aabb_center))
            half = np.abs(T.rotation) @ (0.5 * np.ptp(_bounding_box(g.geometry), axis=0))
            low, high = np.minimum(low, middle - half), np.maximum(high, middle + half)
    return float(np.max(high - low, initial=0.0)) if np.isfinite(low).all() else 0.0


def _bounding_box(shape: object) -> Array:
    aabb = shape.aabb_local  # type: ignore[attr-defined]
    return np.array([aabb.min_, aabb.max_])
