"""Touching of the object by each grasp, and whether the hand can let go of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

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

TOUCHING_M = 0.001
"""What is closer to the object touches it."""
HOLDING_M = 0.005
"""A hand that comes no closer does not hold it."""
NEAR_M = 0.1
"""What is farther away is not looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """How far the links are from the object; overlapping ones at 0."""

    distances: dict[str, float]

    @property
    def links(self) -> list[str]:
        """Those that touch it."""
        return sorted(link for link, far in self.distances.items() if far <= TOUCHING_M)

    def __str__(self) -> str:
        if self.links:
            return ", ".join(self.links)
        if not self.distances:
            return "nothing within 0.1 m"
        nearest = min(self.distances, key=self.distances.__getitem__)
        return f"nothing; {nearest} is {1e3 * self.distances[nearest]:.1f} mm away"


def with_closed_hands(subject: Subject, findings: Findings) -> Subject:
    """The subject, its fingers where they meet the object in the first grasp of their arm.

    At zero, where the other joints stay, many hands are closed and their fingers in the object, so
    that it would be told that opening pushes them through it. A start that was given stays.
    """
    if not subject.assumed or subject.body is None:
        return subject
    closed: dict[str, float] = {}
    for arm in subject.arms:
        if arm.gripper_joints and arm.grasps:
            closed |= close_on(subject, arm, 0, subject.body).at
    if not closed:
        return subject
    findings.say(
        "no start is given: all joints are assumed at zero or the limit next to it, but "
        f"{', '.join(closed)} where the fingers meet the object; --joints FILE gives it"
    )
    return replace(subject, q=subject.robot.with_positions(subject.q, closed))


def check_grasps(subject: Subject, findings: Findings) -> bool:
    """Say what touches the object in each grasp, and whether the hand can let go of it.

    Returns:
        whether the robot can begin so.
    """
    body, robot = subject.body, subject.robot
    grasps = [(arm, number) for arm in subject.arms for number in range(len(arm.grasps))]
    if body is None or not grasps:
        return False
    findings.title("grasps: what the object touches")
    held_fast: list[GraspError] = []
    for arm, number in grasps:
        findings.say(f"{arm.name}, grasp {number}")
        touch = touched(robot, arm, number, body, subject.q)
        findings.say(f"as the hand stands: {touch}", 2)
        best = min(touch.distances.values(), default=NEAR_M)
        if arm.gripper_joints:
            opened = touched(robot, arm, number, body, robot.with_open_hand(subject.q, arm))
            closing = close_on(subject, arm, number, body)
            findings.say(f"open hand: {opened}\nclosing: {closing}", 2)
            best = min(best, closing.closest, *opened.distances.values())
        if best > HOLDING_M:
            findings.remark(
                f"{arm.name}.grasps: in grasp {number} the hand comes no closer to the object than "
                f"{1e3 * best:.0f} mm; unless something holds it that the description lacks, as a "
                f"suction cup, check the pose of the object in {arm.tip_frame}, its quaternion "
                "(x y z w) and object.scale"
            )
        fault = _held_fast(subject, arm, number, body)
        findings.say(f"letting go: {'as it should' if fault is None else fault.remedy}", 2)
        held_fast += [] if fault is None else [fault]
    for error in held_fast if len(held_fast) == len(grasps) else ():
        findings.wrong(error)
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
    robot, q, settings = subject.robot, subject.q, subject.parameters.planner_settings
    try:
        tilt = settings.tilt
        for words in () if tilt is None else tilts_at_start(robot, arms, q, tilt):
            findings.say(words)
        for words in faults_at_start(robot, arms, q, body, settings.collision, tilt=tilt):
            findings.say(f"does without {words}")
    except PlacementPlannerError as error:
        assumed = " (the start is assumed; give the real one as --joints FILE)"
        findings.wrong(f"{error}{assumed if subject.assumed else ''}")
        return False
    return True


def touched(robot: Robot, arm: Arm, grasp: int, body: Body, q: Array) -> Touch:
    """How far links within `NEAR_M` are from the object in a grasp at q (nq,)."""
    T = robot.link_pose(q, arm.tip_frame) * arm.grasps[grasp]
    place = coal.Transform3s(T.rotation, T.translation)
    overlaps, first = object_overlaps(robot, body), len(robot.geometry_links)
    near: dict[str, float] = {}
    for i, (link, at) in enumerate(zip(robot.geometry_links, robot.geometry_poses(q), strict=True)):
        there = coal.Transform3s(at.rotation, at.translation)
        for j, solid in enumerate(overlaps.shapes[first:], first):
            between = at.act(overlaps.centers[i]) - T.act(overlaps.centers[j])
            if np.linalg.norm(between) > overlaps.radii[i] + overlaps.radii[j] + NEAR_M:
                continue
            far = max(float(nearest(solid, place, overlaps.shapes[i], there).min_distance), 0.0)
            far = 0.0 if overlaps.nested(i, j, at, T) else far
            near[link] = min(near.get(link, NEAR_M), far)
    return Touch({link: far for link, far in near.items() if far < NEAR_M})


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
    moved = _moved_by_gripper(robot, arm)
    for share in np.linspace(0.0, 1.0, 41):
        values = opened + share * (closed - opened)
        at = dict(zip(arm.gripper_joints, values.tolist(), strict=True))
        touch = touched(robot, arm, grasp, body, robot.with_positions(subject.q, at))
        fingers = {link: far for link, far in touch.distances.items() if link in moved}
        closest = min(closest, *fingers.values(), np.inf)
        met = sorted(link for link, far in fingers.items() if far <= TOUCHING_M)
        if met:
            return Closing(tuple(met), at, closest)
    return Closing((), {}, closest)


def _moved_by_gripper(robot: Robot, arm: Arm) -> set[str]:
    """Links that the gripper's joints move."""
    followers = {f for f, mimic in robot.mimics.items() if mimic.master in arm.gripper_joints}
    movers = followers.union(arm.gripper_joints)
    return {link for link in robot.geometry_links if movers.intersection(robot.joints_to(link))}
