"""`placement_check_robot`: what the node would make of a robot, and everything that is wrong."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.robot.allowed_pairs import srdf_line
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.pictures.robot_picture import draw_robot
from placement_planner_ros.ros.inputs.robot_input import announced
from placement_planner_ros.ros.tools.robot_check.findings import Findings
from placement_planner_ros.ros.tools.robot_check.given import read_given, start_in
from placement_planner_ros.ros.tools.robot_check.grasps import check_grasps, with_closed_hands
from placement_planner_ros.ros.tools.robot_check.reach import check_planner, check_reach
from placement_planner_ros.ros.tools.robot_check.subject import Subject, read_subject
from placement_planner_ros.scenes.yumi import START_CONFIGURATION


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; 0 where the node could plan."""
    options = _parser().parse_args(arguments)
    try:
        return _check(options)
    except KeyboardInterrupt:
        return 130


def _check(options: argparse.Namespace) -> int:
    findings = Findings()
    files = {
        "robot_description": options.urdf,
        "robot_description_semantic": options.srdf,
        "object.mesh": options.object,
    }
    overrides = {name: str(path.absolute()) for name, path in files.items() if path is not None}
    given = read_given(options.params_file, overrides, findings)
    start: Mapping[str, Any] | None = None
    if options.params_file is not None:
        with contextlib.suppress(ParameterError):  # what is wrong with the file has been said
            start = start_in(options.params_file)
    if start is None and not given.parameters["robot_description"]:
        start = START_CONFIGURATION  # the bundled robot's; at zero it hits itself
    subject = read_subject(given, options.joints, findings, start)
    if subject is not None:
        robot = subject.robot
        describe_robot(robot, bool(given.parameters["robot_description"]), findings)
        if subject.fixed:
            findings.say(subject.fixed)
        describe_arms(subject, findings)
        describe_joint_states(subject, findings)
        subject = with_closed_hands(subject, findings)
        describe_links(robot, findings)
        describe_pairs(robot, findings)
        if options.write_srdf is not None:
            options.write_srdf.write_text(srdf_of(robot), encoding="utf-8")
            findings.say(f"wrote {options.write_srdf}")
        can_begin = check_grasps(subject, findings)
        if options.picture is not None:
            draw_robot(
                options.picture, robot, subject.q, subject.arms, subject.body,
                given.parameters.volume,
            )  # fmt: skip
            findings.say(f"wrote {options.picture}")
        check_reach(subject, findings)
        if can_begin:
            check_planner(subject, findings)
    findings.conclude()
    return 1 if findings.faults else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="placement_check_robot",
        description="Loads robot, object and grasps as the node would; says what it understood, "
        "what it assumed and what is wrong. Exit code 0 only where the node could plan.",
    )
    files = {
        "--params-file": "the node's own",
        "--urdf": "instead of robot_description",
        "--srdf": "instead of robot_description_semantic",
        "--object": "instead of object.mesh",
        "--joints": "the start: lines `joint: value`, or a joint state as ros2 topic echo writes "
        "it; else `start` of placement_scene in the params file, else that of the bundled robot, "
        "for others zero or the limit next to it, the fingers at the object",
        "--write-srdf": "with the pairs that are left out",
        "--picture": "robot, grasps, target volume and cover (PNG)",
    }
    for name, words in files.items():
        parser.add_argument(name, type=Path, metavar="FILE", help=words)
    return parser


def describe_robot(robot: Robot, given: bool, findings: Findings) -> None:
    """Names, sizes and what was decided where the description is silent."""
    which = "" if given else ": the bundled YuMi, as none is given"
    findings.title(f"robot {robot.name}{which}")
    findings.say(f"planning_frame {robot.root_link}, {len(robot.joint_names)} movable joints")
    for name, mimic in robot.mimics.items():
        findings.say(f"{name} = {mimic.multiplier:g} · {mimic.master} + {mimic.offset:g}", 2)
    for words in robot.warnings:
        if not words.startswith("left out:"):  # in a section of its own
            findings.say(f"assumed: {words}")


def describe_arms(subject: Subject, findings: Findings) -> None:
    """Each arm's chain with what bounds it, its hand and grasps."""
    timing = subject.parameters.planner_settings.timing
    for arm in subject.arms:
        told = announced(subject.robot, subject.parameters, arm)
        findings.title(f"arm {arm.name}: {arm.dof} joints to {arm.tip_frame}")
        unstated = {(each.joint, each.what) for each in told.assumed}
        if timing.chosen:
            unstated = {each for each in unstated if each[1] == "velocity"}
        accelerations = np.broadcast_to(timing.accelerations(arm), (arm.dof,))
        rows = []
        for k, joint in enumerate(arm.joints):
            ends = f"{arm.lower[k]:.3f}", f"{arm.upper[k]:.3f}"
            rows.append(
                [
                    joint,
                    *(("without", "end") if joint in arm.continuous else ends),
                    f"{arm.velocity[k]:.3g}" + "*" * ((joint, "velocity") in unstated),
                    f"{accelerations[k]:.3g}" + "*" * ((joint, "acceleration") in unstated),
                    f"{subject.q[arm.q_index[k]]:.3f}",
                ]
            )
        start = "zero" if subject.assumed else "start"
        findings.table(["joint", "lower", "upper", "velocity", "acceleration", start], rows)
        findings.say(f"rad and m, per s and s²{'; * is assumed' if unstated else ''}", 2)
        for words in (told.torso, told.limits(accelerations=not timing.chosen)):
            if words:
                findings.say(words)
        findings.say(f"may touch the object: {', '.join(arm.touch_links) or 'nothing'}")
        opened = zip(arm.gripper_joints, arm.gripper_open, strict=True)
        opening = [f"{joint} {value:g}" for joint, value in opened]
        findings.say(f"opens by: {', '.join(opening) or 'nothing; see gripper_joints'}")


def describe_joint_states(subject: Subject, findings: Findings) -> None:
    """Which joints the node waits for."""
    robot = subject.robot
    matter = {joint for arm in subject.arms for joint in robot.joints_to(arm.tip_frame)}
    matter = matter.union(robot.needed_joints) - set(subject.parameters.assumed_joints)
    names = [name for name in robot.joint_names if name in matter]
    findings.title("joint_states must have, in one or several messages")
    findings.say(", ".join(names))


def describe_links(robot: Robot, findings: Findings) -> None:
    """Shapes of each link, and how well a cover of convex parts stands in for a mesh."""
    findings.title("links")
    shapes = zip(robot.geometry.geometryObjects, robot.geometry_links, robot.covers, strict=True)
    rows = [
        [
            link,
            str(thing.geometry.num_tris),
            str(len(cover.parts)),
            f"{1e3 * cover.excess:.1f}",
            "solid" if cover.closed else "open",
        ]
        for thing, link, cover in shapes
        if cover is not None
    ]
    if rows:
        findings.table(["mesh of", "triangles", "parts", "excess mm", ""], rows)
        findings.say("open meshes count as sheets, without an inside", 2)
    plain = len(robot.geometry_links) - len(rows)
    findings.say(f"{plain} shapes are primitives or convex" + ("" if rows else ", all there are"))
    if not robot.geometry_links:
        findings.wrong(
            "the robot has no collision shapes: nothing would be kept apart; give its links "
            "<collision> elements"
        )


def describe_pairs(robot: Robot, findings: Findings) -> None:
    """Which links are not kept apart from each other, and why."""
    findings.title("pairs of links that are not kept apart")
    if robot.left_out is None:
        findings.say(f"{len(robot.allowed_pairs)}, as the SRDF says")
        return
    hidden = [each for each in robot.left_out if each.can_hide]
    neighbours = f"{len(robot.left_out) - len(hidden)} of neighbours"
    if not hidden:
        findings.say(f"{neighbours}, and no others")
        return
    findings.say(f"{neighbours}, and {len(hidden)} more, whose true collisions would not be "
                 "noticed:")  # fmt: skip
    for each in hidden:
        findings.say(str(each), 2)
    findings.say("an SRDF (--write-srdf FILE) says which of these to leave out")


def srdf_of(robot: Robot) -> str:
    """An SRDF that has the same pairs left out."""
    if robot.left_out is None:
        lines = [srdf_line(links) for links in sorted(robot.allowed_pairs)]
    else:
        lines = [each.srdf for each in robot.left_out]
    body = "\n".join(f"  {line}" for line in dict.fromkeys(lines))
    return f'<?xml version="1.0"?>\n<robot name={quoteattr(robot.name)}>\n{body}\n</robot>\n'


if __name__ == "__main__":
    sys.exit(main())
