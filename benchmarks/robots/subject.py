"""A robot as a parameter file of the node describes it: arms, object, target volume, start."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pinocchio as pin

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.ros.inputs.resources import Files, description_text
from placement_planner_ros.ros.tools.findings import Findings
from placement_planner_ros.ros.tools.given import read_given, start_in
from placement_planner_ros.ros.tools.robot_check import read_snapshot

SHARE = Path(pin.__file__).parents[4] / "share"
"""Where pip puts the robots of example-robot-data."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredRobot:
    """What is measured.

    Attributes:
        name: of its file.
        file: with its parameters.
        urdf: its text.
        package_dirs: folders that hold the packages the URDF names.
        q_start: (nq,) q_0.
        vertices, triangles: of the object.
    """

    name: str
    file: Path
    urdf: str
    package_dirs: tuple[Path, ...]
    robot: Robot
    arms: tuple[Arm, ...]
    q_start: Array
    volume: TargetVolume
    vertices: Array
    triangles: Any


def read_measured_robot(file: Path, package_dirs: Sequence[Path] = (SHARE,)) -> MeasuredRobot:
    """The robot of a parameter file, as the node reads it.

    Args:
        package_dirs: folders that hold packages, besides the file's `package_paths`.

    Raises:
        ParameterError: the node could not plan with it.
    """
    findings, paths = Findings(), [str(folder) for folder in package_dirs]
    with redirect_stdout(sys.stderr):
        paths += read_given(file, {}, findings).parameters["package_paths"]
        given = read_given(file, {"package_paths": paths}, findings)
        start = start_in(file)
        snapshot = findings.attempt(lambda: read_snapshot(given, None, findings, start))
    if snapshot is None or findings.faults:
        raise ParameterError("file", str(file), "; ".join(findings.faults))
    description = given.parameters["robot_description"]
    urdf, beside = description_text("robot_description", description, Files(paths, []))
    above = [] if beside is None else _folders_above(beside, urdf)
    return MeasuredRobot(
        file.stem,
        file,
        urdf,
        (*map(Path, paths), *above),
        snapshot.robot,
        tuple(snapshot.arms),
        snapshot.q_start,
        snapshot.parameters.volume,
        snapshot.body.vertices,
        snapshot.body.triangles,
    )


def _folders_above(urdf_file: Path, urdf: str) -> list[Path]:
    """Folders above a URDF that hold a package that it names."""
    names = set(re.findall(r"package://([^/\"']+)/", urdf))
    above = urdf_file.absolute().parents
    return [folder for folder in above if any((folder / name).is_dir() for name in names)]
