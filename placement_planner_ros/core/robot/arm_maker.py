"""An arm of a robot: what is given of it checked, what is not derived."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pinocchio as pin
import trimesh

from placement_planner_ros.core.errors import GraspError, RobotError
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.types import ROUNDING, SINGLE_ROUNDING, Array

if TYPE_CHECKING:
    from placement_planner_ros.core.robot.model import Robot


def derive_arm(
    robot: Robot,
    name: str,
    tip_frame: str,
    joints: Sequence[str] | None = None,
    grasps: Iterable[pin.SE3 | npt.ArrayLike] = (),
    touch_links: Sequence[str] = (),
    gripper_joints: Sequence[str] = (),
    gripper_open: Sequence[float] = (),
) -> Arm:
    """An arm of a robot; what is None is derived.

    Args:
        name: for messages and results.
        tip_frame: link the grasps refer to.
        joints: root to tip; None: every movable joint between the root and the tip.
        grasps: T_tip_object, each a pose or (4, 4).
        touch_links: links that may touch the held object besides the hand, that is, the tip link
            and all links it carries, or where these have no geometry, the next link towards the
            root that does, with all it carries.
        gripper_joints, gripper_open: joints that open the hand, and their values when open.

    Raises:
        RobotError: no collision shapes, unknown names, joints that do not lead to the tip, a chain
            with mimicking joints, values beyond limits.
        GraspError: a grasp is not a rigid transform.
    """
    where = f"arm {name}"
    if not robot.geometry_links:
        raise RobotError("robot", robot.name, "has no collision shapes: give its links <collision>")
    if not robot.has_link(tip_frame):
        words = f"name a link of the robot {robot.name!r}"
        raise RobotError(f"{where}: tip_frame", tip_frame, words)
    # Joints on the way to the tip, or those chosen of them.
    chain = robot.chain_joints(tip_frame)
    joints = chain if joints is None else tuple(joints)
    if not joints:
        raise RobotError(f"{where}: joints", [], f"no movable joint leads to {tip_frame}")
    ordered = [joint for joint in chain if joint in joints]
    if list(joints) != ordered:
        words = f"list some of those on the way to {tip_frame}, each once, root to tip"
        raise RobotError(f"{where}: joints", list(joints), f"{words}: {list(chain)}")
    # What moves together, and what may touch.
    ties = _ties(robot, where, joints, chain)
    touching = tuple(dict.fromkeys([*_hand_links(robot, tip_frame), *touch_links]))
    for link in touching:
        if not robot.has_link(link):
            raise RobotError(f"{where}: touch_links", link, "name a link of the robot")
    # The arm, with limits that fit each other.
    index = [robot.index(joint) for joint in joints]
    around = robot.upper - robot.lower >= 4.0 * np.pi - ROUNDING
    endless = set(np.array(robot.joint_names)[around]) - robot.prismatic - robot.coupled
    arm = Arm(
        name=name,
        tip_frame=tip_frame,
        joints=joints,
        grasps=tuple(_checked_grasp(g, f"{where}: grasps[{i}]") for i, g in enumerate(grasps)),
        touch_links=touching,
        gripper_joints=tuple(gripper_joints),
        gripper_open=_checked_gripper(robot, where, joints, gripper_joints, gripper_open),
        q_index=np.array(index),
        lower=robot.lower[index],
        upper=robot.upper[index],
        velocity=robot.velocity_limits[index],
        acceleration=robot.acceleration_limits[index],
        turnable=tuple(joint for joint in joints if joint in endless),
        ties=ties,
    )
    return arm.with_limits(arm.lower, arm.upper)


def _ties(robot: Robot, where: str, joints: Sequence[str], chain: Sequence[str]) -> Array:
    """`Arm.ties` of these joints, of all joints on the way to the tip.

    Raises:
        RobotError: one of them moves with a joint that is not among them.
    """
    # A tie where both are joints of the arm; else neither may be, unless it moves nothing.
    moving = {*chain}.union(*map(robot.chain_joints, {*robot.geometry_links}))
    ties = []
    for follower, mimic in robot.mimics.items():
        if follower in joints and mimic.master in joints:
            places = joints.index(follower), joints.index(mimic.master)
            ties.append((*places, mimic.multiplier, mimic.offset))
        elif follower in joints or (mimic.master in joints and follower in moving):
            tied = {*robot.mimics, mimic.master}
            words = f"mimics {mimic.master}, and not both are joints of the arm: where they should "
            words += f"stay where they are, choose {[name for name in joints if name not in tied]}"
            raise RobotError(f"{where}: joints", follower, words)
    return np.array(ties, dtype=np.float64).reshape(-1, 4)


def _hand_links(robot: Robot, tip_frame: str) -> list[str]:
    frames, frame = robot.model.frames, robot.frame_id(tip_frame)
    # Up as long as nothing has geometry and no joint is passed; frames come before what they carry.
    while True:
        carried, above = {frame}, frames[frame].parentFrame
        carried.update(i for i in range(1, len(frames)) if frames[i].parentFrame in carried)
        links = [
            str(frames[i].name) for i in sorted(carried) if frames[i].type == pin.FrameType.BODY
        ]
        moves = frames[above].parentJoint != frames[frame].parentJoint
        if moves or not set(links).isdisjoint(robot.geometry_links):
            return links
        frame = above


def _checked_gripper(
    robot: Robot,
    where: str,
    joints: Sequence[str],
    gripper_joints: Sequence[str],
    gripper_open: Sequence[float],
) -> tuple[float, ...]:
    if len(gripper_joints) != len(gripper_open):
        words = f"give one value for each of gripper_joints {list(gripper_joints)}"
        raise RobotError(f"{where}: gripper_open", list(gripper_open), words)
    # Joints of the hand alone, within their limits.
    for joint, value in zip(gripper_joints, gripper_open, strict=True):
        field = f"{where}: gripper_joints"
        if joint not in robot.joint_names or joint in joints:
            raise RobotError(field, joint, "name a movable joint, and no joint of the arm itself")
        if joint in robot.mimics:
            raise RobotError(field, joint, f"follows {robot.mimics[joint].master}; list that")
        low, high = robot.lower[robot.index(joint)], robot.upper[robot.index(joint)]
        if not low <= value <= high:
            words = f"must lie in {joint}'s [{low:g}, {high:g}]"
            raise RobotError(f"{where}: gripper_open", value, words)
    return tuple(float(v) for v in gripper_open)


def _checked_grasp(grasp: pin.SE3 | npt.ArrayLike, field: str) -> pin.SE3:
    # A rigid transform.
    try:
        T = np.array(grasp.homogeneous if isinstance(grasp, pin.SE3) else grasp, np.float64)
    except (TypeError, ValueError):
        T = np.empty(0)
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise GraspError(field, grasp, "give T_tip_object, a pinocchio.SE3 or (4, 4), all finite")
    # A mirror is rigid to trimesh, too.
    rigid = trimesh.transformations.is_rigid(T, epsilon=SINGLE_ROUNDING)
    if not rigid or np.linalg.det(T[:3, :3]) < 0.0:
        words = "is no rotation above 0 0 0 1; normalise the quaternion"
        raise GraspError(field, T.tolist(), words)
    return pin.SE3(T[:3, :3], T[:3, 3])
