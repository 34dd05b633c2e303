"""How the hand stands where nobody gave a start: holding the object, as it will have to."""

from __future__ import annotations

from dataclasses import replace

from placement_planner_ros.ros.tools.robot_check.findings import Findings
from placement_planner_ros.ros.tools.robot_check.grasps import close_on
from placement_planner_ros.ros.tools.robot_check.subject import Subject


def holding(subject: Subject, findings: Findings) -> Subject:
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
