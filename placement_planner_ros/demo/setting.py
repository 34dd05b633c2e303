"""The setting of the demonstration: scene, robot, object, and the node's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.demo.processes import DemoError
from placement_planner_ros.ros.parameters.spec import Value
from placement_planner_ros.ros.tools.findings import Findings
from placement_planner_ros.ros.tools.given import read_given, start_in
from placement_planner_ros.ros.tools.robot_check import read_snapshot
from placement_planner_ros.scenes.scenes import Scene, scene_by_name, table_of_things
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, start_configuration
from placement_planner_ros.share import share_path


@dataclass(frozen=True, slots=True, eq=False)
class Setting:
    """One object in the robot's hands.

    Attributes:
        name: of the object, for people.
        scene: with V as the node is told.
        positions: joint values by name where the robot stands, rad or m.
        arms: by name.
        corners: (t, 3, 3) of the object's triangles.
        file: of parameters, for the node.
        parameters: for the node, besides.
        given: all of these, by name.
    """

    name: str
    scene: Scene
    robot: Robot
    positions: Mapping[str, float]
    arms: Mapping[str, Arm]
    corners: Array
    file: Path
    parameters: Mapping[str, Value]
    given: Mapping[str, Value]


def bundled(scene_name: str, object_name: str) -> Setting:
    """The bundled robot with a bundled object at a bundled scene."""
    file = share_path("config", f"{object_name}.yaml")
    return read_setting(file, scene_name, start_configuration(object_name))


def read_setting(
    file: Path, scene_name: str, start: Mapping[str, float] = START_CONFIGURATION
) -> Setting:
    """The robot and the object of a parameter file, at a table of things.

    Where the file names no robot it is the bundled one at a bundled scene, and what is told of that
    counts unless the file says otherwise.

    Args:
        start: where the bundled robot stands unless the file says otherwise.

    Raises:
        DemoError: something is wrong with them.
    """
    # read as placement_check_robot reads it
    findings = Findings()
    given, parameters = read_given(file, {}, findings), dict[str, Value]()
    own = findings.attempt(lambda: start_in(file))
    scene: Scene | None = None
    if "robot_description" not in given.names and not findings.faults:
        scene = scene_by_name(scene_name)
        # the bundled robot: what the file does not say is as for its scenes
        told = _told_parameters(scene)
        parameters = {name: told[name] for name in told if name not in given.names}
        given = read_given(file, parameters, findings)
        own = {**start, **(own or {})}
    subject = findings.attempt(lambda: read_snapshot(given, None, findings, own))
    if subject is None or findings.faults:
        faults = "; ".join(findings.faults)
        raise DemoError(f"{file}: {faults}", f"placement_check_robot --params-file {file}")
    volume = subject.parameters.volume
    # joints that mimic others are published by nobody
    values = zip(subject.robot.joint_names, subject.q_start.tolist(), strict=True)
    return Setting(
        file.stem.replace("_", " "),
        table_of_things(volume) if scene is None else replace(scene, volume=volume),
        subject.robot,
        {name: value for name, value in values if name not in subject.robot.mimics},
        {arm.name: arm for arm in subject.arms},
        subject.body.vertices[subject.body.triangles],
        file,
        parameters,
        {name: given.parameters[name] for name in given.names if name in given.parameters.specs},
    )


def _told_parameters(scene: Scene) -> dict[str, Value]:
    """What the node is told of a bundled scene.

    On the table the object shall stand on the table itself, away from its edges; in the cabinets
    anywhere in the paper's V; in the shelf it shall lean.
    """
    volume = [*scene.volume.lower.tolist(), *scene.volume.upper.tolist()]
    if scene.name == "shelf":  # where things lean
        return {"contacts": ["lean"], "target_volume": volume}
    told: dict[str, Value] = {"support_region": "largest"}  # not on top of other things
    if scene.name == "table":  # on the table alone, of which other things are higher; 8 cm inside
        return told | {"edge_margin": 0.08, "target_volume": [0.17, -0.4, -0.05, 0.66, 0.4, 0.02]}
    return told | {"target_volume": volume}
