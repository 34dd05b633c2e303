"""What the object touches in each grasp, and whether the hand can let go of it."""

from __future__ import annotations

from dataclasses import dataclass

import coal
import numpy as np

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.attached_object import AttachedObject
from placement_planner_ros.core.collision.object_solids import object_overlaps
from placement_planner_ros.core.errors import GraspError, PlacementPlannerError
from placement_planner_ros.core.grasp.release_check import check_letting_go
from placement_planner_ros.core.grasp.start_state_check import faults_at_start, tilts_at_start
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.robot.moving_arm import MovingArm
from placement_planner_ros.core.robot.surface import nearest
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.tools.robot_check.findings import Findings
from placement_planner_ros.ros.tools.robot_check.subject import Subject

TOUCHING = 0.001
"""m; what is closer to the object touches it."""
_FAR = 0.005
"""m; a hand that comes no closer does not hold it."""
_STEPS = 40
"""Between the open hand and its closed end."""


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """How far the links are from the object; overlapping ones at 0."""

    distances: dict[str, float]

    @property
    def links(self) -> list[str]:
        """Those that touch it."""
        return sorted(link for link, far in self.distances.items() if far <= TOUCHING)

    def __str__(self) -> str:
        if self.links:
            return ", ".join(self.links)
        if not self.distances:
            return "nothing within 0.1 m"
        nearest = min(self.distances, key=self.distances.__getitem__)
        return f"nothing; {nearest} is {1e3 * self.distances[nearest]:.1f} mm away"


def check_grasps(subject: Subject, findings: Findings) -> bool:
    """Say what touches the object in each grasp, and whether the hand can let go of it.

    Returns:
        whether the robot can begin so.
    """
    body, robot = subject.body, subject.robot
    if body is None or not any(arm.grasps for arm in subject.arms):
        return False
    findings.title("grasps: what the object touches")
    held_fast: list[GraspError] = []
    for arm in subject.arms:
        for number in range(len(arm.grasps)):
            findings.say(f"{arm.name}, grasp {number}")
            at_start = touched(robot, arm, number, body, subject.q)
            findings.say(f"as the hand stands: {at_start}", 2)
            best = min(at_start.distances.values(), default=np.inf)
            if arm.gripper_joints:
                opened = touched(robot, arm, number, body, robot.with_open_hand(subject.q, arm))
                findings.say(f"open hand: {opened}", 2)
                closing = close_on(subject, arm, number, body)
                findings.say(f"closing: {closing}", 2)
                best = min(best, closing.closest, *opened.distances.values())
            if best > _FAR:
                findings.remark(
                    f"{arm.name}.grasps: in grasp {number} the hand comes no closer to the object "
                    f"than {1e3 * min(best, 9.999):.0f} mm; unless something holds it that the "
                    "description lacks, as a suction cup, check the pose of the object in "
                    f"{arm.tip_frame}, its quaternion (x y z w) and object.scale"
                )
            fault = _held_fast(subject, arm, number, body)
            findings.say(f"letting go: {'as it should' if fault is None else fault.remedy}", 2)
            if fault is not None:
                held_fast.append(fault)
    if len(held_fast) == sum(len(arm.grasps) for arm in subject.arms):
        for fault in held_fast:
            findings.wrong(fault)
    return _check_start(subject, body, findings)


def _held_fast(subject: Subject, arm: Arm, grasp: int, body: Body) -> GraspError | None:
    """Why the hand cannot let go of the object, wherever that stands; None where it can."""
    grasping = subject.parameters.planner_settings.grasp
    if not grasping.require_retreat:
        return None
    try:
        moving = MovingArm(subject.robot, arm, subject.q)
        check_letting_go(moving, AttachedObject(body, grasp), grasping)
    except GraspError as error:
        return error
    return None


def _check_start(subject: Subject, body: Body, findings: Findings) -> bool:
    arms = tuple(arm for arm in subject.arms if arm.grasps)
    settings = subject.parameters.planner_settings
    try:
        tilt = settings.tilt
        if tilt is not None:
            for words in tilts_at_start(subject.robot, arms, subject.q, tilt):
                findings.say(words)
        for words in faults_at_start(
            subject.robot, arms, subject.q, body, settings.collision, tilt=tilt
        ):
            findings.say(f"does without {words}")
        return True
    except PlacementPlannerError as error:
        assumed = " (the start is assumed; give the real one as --joints FILE)"
        findings.wrong(f"{error}{assumed if subject.assumed else ''}")
        return False


def touched(robot: Robot, arm: Arm, grasp: int, body: Body, q: Array) -> Touch:
    """How far links within 0.1 m are from the object in a grasp at q (nq,)."""
    T = robot.link_pose(q, arm.tip_frame) * arm.grasps[grasp]
    place = coal.Transform3s(T.rotation, T.translation)
    overlaps, first = object_overlaps(robot, body), len(robot.geometry_links)
    near: dict[str, float] = {}
    placed = zip(robot.geometry_links, robot.geometry_poses(q), strict=True)
    for i, (link, at) in enumerate(placed):
        shape, center = overlaps.shapes[i], at.act(overlaps.centers[i])
        for j, solid in enumerate(overlaps.shapes[first:], first):
            apart = float(np.linalg.norm(center - T.act(overlaps.centers[j])))
            if apart > overlaps.radii[i] + overlaps.radii[j] + 0.1:
                continue
            there = coal.Transform3s(at.rotation, at.translation)
            far = nearest(solid, place, shape, there).min_distance
            if far > 0.0 and overlaps.nested(i, j, at, T):
                far = 0.0
            near[link] = min(near.get(link, np.inf), max(float(far), 0.0))
    return Touch({link: far for link, far in near.items() if far <= 0.1})


@dataclass(frozen=True, slots=True, eq=False)
class Closing:
    """How an open hand closes on the object.

    Attributes:
        fingers: the links that meet it first; none where no finger does.
        at: values of the gripper's joints where they do.
        closest: how close fingers come, metres.
    """

    fingers: tuple[str, ...]
    at: dict[str, float]
    closest: float

    def __str__(self) -> str:
        if not self.fingers:
            return "no finger meets it"
        at = ", ".join(f"{joint} = {value:.3f}" for joint, value in self.at.items())
        return f"{', '.join(self.fingers)} meets it at {at}"


def close_on(subject: Subject, arm: Arm, grasp: int, body: Body) -> Closing:
    """Close the hand from where it is open, until the first finger meets the object."""
    robot, closest = subject.robot, np.inf
    index = [robot.index(joint) for joint in arm.gripper_joints]
    opened = np.array(arm.gripper_open)
    low, high = robot.lower[index], robot.upper[index]
    closed = np.where(np.abs(low - opened) > np.abs(high - opened), low, high)
    moved = _moved(robot, arm)
    for share in np.linspace(0.0, 1.0, _STEPS + 1):
        values = opened + share * (closed - opened)
        at = dict(zip(arm.gripper_joints, values.tolist(), strict=True))
        touch = touched(robot, arm, grasp, body, robot.with_positions(subject.q, at))
        fingers = {link: far for link, far in touch.distances.items() if link in moved}
        closest = min(closest, *fingers.values(), np.inf)
        met = sorted(link for link, far in fingers.items() if far <= TOUCHING)
        if met:
            return Closing(tuple(met), at, closest)
    return Closing((), {}, closest)


def _moved(robot: Robot, arm: Arm) -> set[str]:
    """Links that the gripper's joints move."""
    movers = set(arm.gripper_joints) | {
        follower for follower, mimic in robot.mimics.items() if mimic.master in arm.gripper_joints
    }
    ids = {robot.model.getJointId(name) for name in movers}
    found = set()
    for thing, link in zip(robot.geometry.geometryObjects, robot.geometry_links, strict=True):
        joint = thing.parentJoint
        while joint != 0 and joint not in ids:
            joint = robot.model.parents[joint]
        if joint != 0:
            found.add(link)
    return found
