"""The setting of the demonstration: scene, robot, object, and the node's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.demo.processes import DemoError
from placement_planner_ros.ros.tools.findings import Findings
from placement_planner_ros.ros.tools.given import read_given, start_in
from placement_planner_ros.ros.tools.robot_check import read_snapshot
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.scenes import Scene, scene_by_name, table_of_things
from placement_planner_ros.scenes.yumi import (
    START_CONFIGURATION,
    load_yumi,
    start_configuration,
    yumi_arm,
)
from placement_planner_ros.share import share_path


@dataclass(frozen=True, slots=True, eq=False)
class Setting:
    """One demonstration.

    Attributes:
        title: of pictures and lines.
        scene: with V as the node is told.
        positions: joint values by name where the robot stands, rad or m.
        arms: by name.
        corners: (t, 3, 3) of the object's triangles.
        file: of parameters, for the node.
        parameters: for the node, besides.
    """

    title: str
    scene: Scene
    robot: Robot
    positions: Mapping[str, float]
    arms: Mapping[str, Arm]
    corners: Array
    file: Path
    parameters: Mapping[str, object]


def bundled(scene_name: str, object_name: str) -> Setting:
    """The bundled robot at a bundled scene.

    On the table the object shall stand on the table itself, away from its edges; in the cabinets
    anywhere in the paper's V; in the shelf it shall lean.
    """
    held, robot, scene = object_by_name(object_name), load_yumi(), scene_by_name(scene_name)
    parameters = _told_parameters(scene)
    # the picture shows V as the node is told
    corners = np.array(parameters["target_volume"])
    return Setting(
        f"{scene_name}, {object_name}",
        replace(scene, volume=TargetVolume(corners[:3], corners[3:])),
        robot,
        start_configuration(object_name),
        {name: yumi_arm(robot, name, grasps) for name, grasps in held.grasps.items()},
        held.vertices[held.triangles],
        share_path("config", f"{object_name}.yaml"),
        parameters,
    )


def _told_parameters(scene: Scene) -> dict[str, object]:
    """What the node is told of a bundled scene."""
    volume = [*scene.volume.lower.tolist(), *scene.volume.upper.tolist()]
    if scene.name == "shelf":  # where things lean
        return {"contacts": ["lean"], "target_volume": volume}
    told: dict[str, object] = {"support_region": "largest"}  # not on top of other things
    if scene.name == "table":  # on the table alone, of which other things are higher; 8 cm inside
        return told | {"edge_margin": 0.08, "target_volume": [0.17, -0.4, -0.05, 0.66, 0.4, 0.02]}
    return told | {"target_volume": volume}


def of_file(file: Path, scene_name: str) -> Setting:
    """The robot and the object of a parameter file, at a table of things.

    Where the file names no robot it is the bundled one at a bundled scene, and what is told of that
    counts unless the file says otherwise.

    Raises:
        DemoError: something is wrong with them.
    """
    # read as placement_check_robot reads it
    findings = Findings()
    given, parameters, start = read_given(file, {}, findings), dict[str, object](), start_in(file)
    scene: Scene | None = None
    if "robot_description" not in given.names and not findings.faults:
        scene = scene_by_name(scene_name)
        # the bundled robot: what the file does not say is as for its scenes
        told = _told_parameters(scene)
        parameters = {name: told[name] for name in told if name not in given.names}
        given = read_given(file, parameters, findings)
        start = {**START_CONFIGURATION, **(start or {})}
    subject = findings.attempt(lambda: read_snapshot(given, None, findings, start))
    if subject is None or findings.faults:
        faults = "; ".join(findings.faults)
        raise DemoError(f"{file}: {faults}", f"placement_check_robot --params-file {file}")
    volume = subject.parameters.volume
    shown = table_of_things(volume) if scene is None else replace(scene, volume=volume)
    # joints that mimic others are published by nobody
    values = zip(subject.robot.joint_names, subject.q_start.tolist(), strict=True)
    positions = {name: value for name, value in values if name not in subject.robot.mimics}
    return Setting(
        f"{subject.robot.name}, {shown.name.replace('_', ' ')}, {file.name}",
        shown,
        subject.robot,
        positions,
        {arm.name: arm for arm in subject.arms},
        subject.body.vertices[subject.body.triangles],
        file,
        parameters,
    )
