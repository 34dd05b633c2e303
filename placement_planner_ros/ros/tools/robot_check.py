"""`placement_check_robot`: what the node would make of a robot, and everything that is wrong.

Parameters, robot, object and start go the way that they go in the node, over a plane for a cloud.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from html import escape
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from placement_planner_ros.core.collision.attached_object import object_overlaps
from placement_planner_ros.core.errors import ParameterError, PlacementPlannerError
from placement_planner_ros.core.robot.allowed_pairs import srdf_line
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.core.warmup.warm_up import warm_up
from placement_planner_ros.pictures.robot_picture import draw_robot
from placement_planner_ros.ros.inputs.cloud_store import PointSet
from placement_planner_ros.ros.inputs.inputs import Inputs
from placement_planner_ros.ros.inputs.robot_input import announced
from placement_planner_ros.ros.run.preparation import make_planner
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.run.start_checks import start_notes, take_snapshot
from placement_planner_ros.ros.run.surroundings import Surroundings
from placement_planner_ros.ros.tools.findings import Findings
from placement_planner_ros.ros.tools.given import Given, read_given, read_yaml, start_in
from placement_planner_ros.scenes.yumi import START_CONFIGURATION

FAR_FROM_HAND_M = 0.06
"""From the open hand, beyond which an object is hardly held: wide hands open by 0.12 m."""
SEARCH_S = 4.0
"""Processor time for a first placement on a plane."""


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
    # parameters as the node would take them
    given = read_given(options.params_file, overrides, findings)
    start: Mapping[str, Any] | None = None
    if options.params_file is not None:
        start = findings.attempt(lambda: start_in(options.params_file))
    if start is None and not given.parameters["robot_description"]:
        start = START_CONFIGURATION  # the bundled robot's; at zero it hits itself
    # robot, object and start as a run would begin with them
    snapshot = read_snapshot(given, options.joints, findings, start)
    if snapshot is not None:
        robot = snapshot.robot
        describe_robot(robot, bool(given.parameters["robot_description"]), findings)
        describe_arms(snapshot, findings)
        findings.write(options.write_srdf, lambda path: path.write_text(srdf_of(robot), "utf-8"))
        shown = snapshot.q_start, snapshot.arms, snapshot.body, snapshot.parameters.volume
        findings.write(options.picture, lambda path: draw_robot(path, robot, *shown))
        check_grasps(snapshot, findings)
        check_search(snapshot, findings)
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
        "for others zero or the limit next to it; where there is none, hands open",
        "--write-srdf": "with the pairs that are left out",
        "--picture": "robot, grasps, target volume and cover (PNG)",
    }
    for name, words in files.items():
        parser.add_argument(name, type=Path, metavar="FILE", help=words)
    return parser


def read_snapshot(
    given: Given, joints: Path | None, findings: Findings, start: Mapping[str, Any] | None = None
) -> Snapshot | None:
    """All that a run would begin with, over a plane through V; None, and what is wrong is said,
    where it could not begin.

    Args:
        joints: a file with the start.
        start: some joint values where there is no such file; None for zero.
    """
    parameters = given.parameters
    inputs = findings.attempt(lambda: Inputs(parameters, ["points"]))
    if inputs is None:
        return None
    inputs.object.wait()
    inputs.robot.wait()
    robot = findings.attempt(lambda: inputs.robot.robot)
    if robot is not None:
        if parameters["robot_description"] and "arms" not in given.names:
            findings.wrong("arms: none is named; set arms and, of each, tip_frame and grasps")
            return None
        # zero, or the limit next to it, for joints of which no start is given
        zero = np.clip(np.zeros(len(robot.joint_names)), robot.lower, robot.upper)
        q = dict(zip(robot.joint_names, zero.tolist(), strict=True))
        told = start
        if joints is not None:
            told, q = findings.attempt(lambda: read_yaml(joints)), {}
        if told is not None:
            where = "start" if joints is None else str(joints)
            q |= findings.attempt(lambda: positions_of(told, where)) or {}
        inputs.joints.update(list(q), list(q.values()), time.monotonic())
    # a plane stands for the cloud that a camera would send
    plane = _plane_in(parameters.volume, 0.1)
    inputs.clouds.add(PointSet(plane, topic="points", time=time.monotonic()))
    taken = take_snapshot(inputs, parameters)
    if isinstance(taken, list):
        for fault in taken:
            findings.wrong(fault)
        return None
    return taken if joints or start else with_open_hands(taken, findings)


def positions_of(tree: Any, where: str) -> dict[str, float]:
    """Joint values by name, from a mapping or a joint state as `ros2 topic echo` writes it.

    Raises:
        ParameterError: it is neither.
    """
    if isinstance(tree, Mapping) and {"name", "position"} <= set(tree):
        tree = dict(zip(tree["name"], tree["position"], strict=False))
    if not isinstance(tree, Mapping) or not tree:
        words = "give `joint: value` lines, or a joint state's name and position"
        raise ParameterError(where, tree, words)
    for name, value in tree.items():
        if type(value) not in (int, float) or not isfinite(value):
            raise ParameterError(f"{where}: {name}", value, "give a finite number, rad or m")
    return {str(name): float(value) for name, value in tree.items()}


def describe_robot(robot: Robot, given: bool, findings: Findings) -> None:
    """Names, sizes and what was decided where the description is silent."""
    which = "" if given else ": the bundled YuMi, as none is given"
    findings.title(f"robot {robot.name}{which}")
    findings.say(f"planning_frame {robot.root_link}, {len(robot.joint_names)} movable joints")
    for name, mimic in robot.mimics.items():
        findings.say(f"{name} = {mimic.multiplier:g} · {mimic.master} + {mimic.offset:g}", 2)
    for words in robot.warnings:
        findings.say(f"assumed: {words}")


def describe_arms(snapshot: Snapshot, findings: Findings) -> None:
    """Each arm's chain with what bounds it, its hand, and the joints that the node waits for."""
    timing = snapshot.parameters.planner_settings.timing
    for arm in snapshot.arms:
        findings.title(f"arm {arm.name}: {arm.dof} joints to {arm.tip_frame}")
        accelerations = np.broadcast_to(timing.accelerations(arm), (arm.dof,))
        for k, joint in enumerate(arm.joints):
            ends = f"{arm.lower[k]:.3f} to {arm.upper[k]:.3f}"
            ends = "without end stops" if joint in snapshot.robot.continuous else ends
            findings.say(
                f"{joint}: {ends}, velocity {arm.velocity[k]:.3g}, acceleration "
                f"{accelerations[k]:.3g}, starts at {snapshot.q_start[arm.q_index[k]]:.3f}",
                2,
            )
        findings.say("rad and m, per s and s²", 2)
        for words in announced(snapshot.robot, snapshot.parameters, arm):
            findings.say(words)
        findings.say(f"may touch the object: {', '.join(arm.touch_links) or 'nothing'}")
        opened = zip(arm.gripper_joints, arm.gripper_open, strict=True)
        opening = [f"{joint} {value:g}" for joint, value in opened]
        findings.say(f"opens by: {', '.join(opening) or 'nothing; see gripper_joints'}")
    findings.title("joint_states must have, in one or several messages")
    findings.say(", ".join(snapshot.joints))


def srdf_of(robot: Robot) -> str:
    """An SRDF that has the same pairs left out."""
    lines = [srdf_line(pair, reason) for pair, reason in robot.allowed_pairs.items()]
    body = "\n".join(f"  {line}" for line in lines)
    return f'<?xml version="1.0"?>\n<robot name="{escape(robot.name)}">\n{body}\n</robot>\n'


def with_open_hands(snapshot: Snapshot, findings: Findings) -> Snapshot:
    """The snapshot with every hand open: at zero many are closed, their fingers in the object."""
    opened = [joint for arm in snapshot.arms for joint in arm.gripper_joints]
    at = f", but {', '.join(opened)} where the hands are open" if opened else ""
    findings.say(
        f"no start is given: all joints are assumed at zero or the limit next to it{at}; --joints "
        "FILE gives it"
    )
    q = snapshot.q_start
    for arm in snapshot.arms:
        q = snapshot.robot.with_open_hand(q, arm)
    return replace(snapshot, q_start=q)


def check_grasps(snapshot: Snapshot, findings: Findings) -> None:
    """Remark on grasps in which the object is far from the open hand."""
    for arm in snapshot.arms:
        for number in range(len(arm.grasps)):
            if is_far_from_hand(snapshot, arm, number):
                findings.remarks.append(
                    f"{arm.name}.grasps: in grasp {number} the open hand is more than "
                    f"{1e3 * FAR_FROM_HAND_M:.0f} mm from the object; unless something holds it "
                    "that the description lacks, as a suction cup, check the pose of the object in "
                    f"{arm.tip_frame}, its quaternion (x y z w) and object.scale"
                )


def is_far_from_hand(snapshot: Snapshot, arm: Arm, grasp: int) -> bool:
    """Whether the object in a grasp is far from all links of the open hand, if that has any."""
    robot, body = snapshot.robot, snapshot.body
    q = robot.with_open_hand(snapshot.q_start, arm)
    T = robot.link_pose(q, arm.tip_frame) * arm.grasps[grasp]
    overlaps, places = object_overlaps(robot, body), robot.geometry_poses(q)
    # links that may touch the object are those of the hand
    hand = [i for i, link in enumerate(robot.geometry_links) if link in arm.touch_links]
    solids = range(len(places), len(overlaps.shapes))
    pairs = itertools.product(hand, solids)
    return bool(hand) and not any(
        overlaps.meet(i, j, places[i], T, FAR_FROM_HAND_M) for i, j in pairs
    )


def check_search(snapshot: Snapshot, findings: Findings) -> None:
    """Say whether a search finds a placement on a plane through V, low, in the middle or high."""
    findings.title("a search on a plane through target_volume")
    # kernels are loaded, the first time compiled, before the search's time counts
    with contextlib.suppress(PlacementPlannerError):  # which the search tells
        warm_up(snapshot.robot, snapshot.arms, snapshot.q_start)
    why, began = "", time.process_time()
    for share in (0.1, 0.5, 0.9):
        found = findings.attempt(partial(_search, snapshot, share))
        if found is None:
            return
        in_vain, notes = found
        # of the low plane, as surfaces lie low in most volumes
        why = why or in_vain
        # a placement at one height is enough
        if not in_vain:
            for note in notes:
                findings.say(note)
            findings.say(f"a placement after {time.process_time() - began:.1f} s of processor time")
            return
    findings.wrong(f"on no plane through target_volume; on one low in it: {why}")


def _search(snapshot: Snapshot, share: float) -> tuple[str, list[str]]:
    """Why no placement is found on a plane at that share of V's height, '' where one is; and what
    to know of such a run.

    Raises:
        PlacementPlannerError: it could not begin.
    """
    # furniture and known objects stay, the plane is in place of the clouds
    known = tuple(part for part in snapshot.parts if part.placed)
    plane = PointSet(_plane_in(snapshot.parameters.volume, share))
    over = replace(snapshot, parts=(*known, plane))
    environment = Surroundings.of(over).environment()
    notes = start_notes(over, environment)
    planner = make_planner(over, environment)
    notes += [f"does without {each}" for each in planner.unusable]
    # processor time, so that a busy machine is not taken for a fault
    end = time.process_time() + SEARCH_S
    if next(planner.run(lambda: time.process_time() > end), None) is not None:
        return "", notes
    return planner.exhausted or planner.explain().short, notes


def _plane_in(volume: TargetVolume, share: float) -> Array:
    """(n, 3) points every 5 mm at that share of the height of each of V's boxes."""
    planes = []
    for low, high in volume.boxes:
        x, y = (np.arange(low[i], high[i], 0.005) for i in range(2))
        grid = np.meshgrid(x, y, [low[2] + share * (high[2] - low[2])], indexing="ij")
        planes.append(np.column_stack([axis.ravel() for axis in grid]))
    return np.concatenate(planes)
