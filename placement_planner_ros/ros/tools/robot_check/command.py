"""`placement_check_robot`: what the node would make of a robot, and everything that is wrong."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.pictures.robot_picture import draw_robot
from placement_planner_ros.ros.tools.robot_check import description
from placement_planner_ros.ros.tools.robot_check.findings import Findings
from placement_planner_ros.ros.tools.robot_check.given import read_given, start_in
from placement_planner_ros.ros.tools.robot_check.grasps import check_grasps, with_closed_hands
from placement_planner_ros.ros.tools.robot_check.reach import check_planner, check_reach
from placement_planner_ros.ros.tools.robot_check.subject import read_subject
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
        description.describe_robot(robot, bool(given.parameters["robot_description"]), findings)
        if subject.fixed:
            findings.say(subject.fixed)
        description.describe_arms(subject, findings)
        description.describe_joint_states(subject, findings)
        subject = with_closed_hands(subject, findings)
        description.describe_links(robot, findings)
        description.describe_pairs(robot, findings)
        if options.write_srdf is not None:
            options.write_srdf.write_text(description.srdf_of(robot), encoding="utf-8")
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


if __name__ == "__main__":
    sys.exit(main())
