"""A robot as a parameter file of the node describes it: arms, object, target volume, start."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

from placement_planner_ros.core.errors import ObjectError, ParameterError
from placement_planner_ros.core.meshes.read import read_mesh
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array, TargetVolume

SHARE = Path(pin.__file__).parents[4] / "share"
"""Where pip puts the robots of example-robot-data."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredRobot:
    """What is measured.

    Attributes:
        name: of its file.
        file: with its parameters.
        urdf, srdf: texts; the second is '' where there is none.
        package_dirs: folders that hold the packages the URDF names.
        q_start: (nq,) q_0.
        vertices, triangles: of the object.
    """

    name: str
    file: Path
    urdf: str
    srdf: str
    package_dirs: tuple[Path, ...]
    robot: Robot
    arms: tuple[Arm, ...]
    q_start: Array
    volume: TargetVolume
    vertices: Array
    triangles: Any


def read_measured_robot(file: Path, package_dirs: Sequence[Path] = (SHARE,)) -> MeasuredRobot:
    """The robot of a parameter file.

    Its meshes are looked for where the node looks for them: in `package_paths`, and in packages
    in folders above the URDF too.

    Args:
        package_dirs: folders that hold packages, besides these.

    Raises:
        ParameterError: the file does not name what it must, or what it names is not there.
        ObjectError: the object's file is no mesh.
        PlacementPlannerError: robot or arm are unusable.
    """
    tree = yaml.safe_load(file.read_text(encoding="utf-8"))
    try:
        values = tree["/**"]["ros__parameters"]
        package_dirs = (*package_dirs, *map(Path, values.get("package_paths") or ()))
        urdf_file = _find_file("robot_description", values["robot_description"], package_dirs)
        semantic = values.get("robot_description_semantic")
        srdf_file = semantic and _find_file("robot_description_semantic", semantic, package_dirs)
        srdf = srdf_file.read_text(encoding="utf-8") if srdf_file else ""
        urdf = urdf_file.read_text(encoding="utf-8")
        folders = (*package_dirs, urdf_file.parent, *_folders_above(urdf_file, urdf))
        robot = Robot.from_urdf(urdf, folders, srdf or None)
        arms = tuple(_read_arm(robot, name, values[name]) for name in values["arms"])
        start = tree.get("placement_scene", {}).get("ros__parameters", {}).get("start", {})
        vertices, triangles = _read_object(values["object"], package_dirs)
    except (KeyError, TypeError) as error:
        raise ParameterError("file", str(file), f"it does not give {error}") from error
    at_rest = np.clip(np.zeros(len(robot.joint_names)), robot.lower, robot.upper)
    given = {name: float(value) for name, value in zip(robot.joint_names, at_rest, strict=True)}
    given |= {name: float(value) for name, value in start.items()}
    return MeasuredRobot(
        file.stem,
        file,
        urdf,
        srdf,
        tuple(folders),
        robot,
        arms,
        robot.configuration(given),
        TargetVolume.of_numbers(values["target_volume"]),
        vertices,
        triangles,
    )


def _read_arm(robot: Robot, name: str, values: Mapping[str, Any]) -> Arm:
    poses = np.array(values["grasps"], dtype=np.float64).reshape(-1, 7)
    tip = values["tip_frame"]
    return robot.arm(
        name,
        tip,
        joints=values.get("joints") or None,
        grasps=[pin.XYZQUATToSE3(pose) for pose in poses],
        touch_links=values.get("touch_links") or None,
        gripper_joints=values.get("gripper_joints", ()),
        gripper_open=values.get("gripper_open", ()),
    )


def _folders_above(urdf_file: Path, urdf: str) -> list[Path]:
    """Folders above a URDF that hold a package that it names."""
    names = set(re.findall(r"package://([^/\"']+)/", urdf))
    above = urdf_file.absolute().parents
    return [folder for folder in above if any((folder / name).is_dir() for name in names)]


def _read_object(values: Mapping[str, Any], package_dirs: Sequence[Path]) -> tuple[Array, Any]:
    """Vertices (n, 3) in metres and triangles (t, 3) of the object, as the node reads them."""
    scale = float(values.get("scale", 1.0))
    if "mesh" not in values:
        vertices = np.array(values["vertices"], dtype=np.float64).reshape(-1, 3)
        return scale * vertices, np.array(values["triangles"], dtype=np.int64).reshape(-1, 3)
    file = _find_file("object.mesh", values["mesh"], package_dirs)
    try:
        vertices, triangles = read_mesh(file)
    except Exception as error:  # whatever loaders raise at what they are given
        raise ObjectError("object.mesh", str(file), f"it cannot be read: {error}") from error
    return scale * vertices, triangles


def _find_file(field: str, name: str, package_dirs: Sequence[Path]) -> Path:
    """The file of a path or a `package://` URI."""
    inside = name.removeprefix("package://")
    for path in [folder / inside for folder in package_dirs] if inside != name else [Path(name)]:
        if path.is_file():
            return path
    where = ", ".join(map(str, package_dirs))
    words = f"is in none of {where}: pip install example-robot-data, or give --packages"
    raise ParameterError(field, name, words)
