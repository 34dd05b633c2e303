"""Checks of a parameter's value alone, beyond its type and range.

Each takes the parameter's name and raises a PlacementPlannerError that names it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.mesh import require_few
from placement_planner_ros.core.errors import GraspError, ObjectError, ParameterError
from placement_planner_ros.core.objective.by_name import term_names
from placement_planner_ros.core.settings import Meaning
from placement_planner_ros.core.types import TargetVolume

MAX_GRASPS = 200
"""Grasps that an arm may have: each takes a megabyte."""


def poses_from_list(name: str, values: Sequence[float]) -> tuple[pin.SE3, ...]:
    """Poses from x y z qx qy qz qw, one after the other.

    Raises:
        GraspError: not a multiple of seven numbers, or a quaternion that is not of unit length.
    """
    if len(values) % 7 != 0:
        raise GraspError(name, list(values), "give seven numbers per pose: x y z qx qy qz qw")
    poses = []
    for pose in np.array(values, dtype=np.float64).reshape(-1, 7):
        length = float(np.linalg.norm(pose[3:]))
        if not abs(length - 1.0) < 1e-2:
            words = f"the quaternion x y z w must have length 1, not {length:.3g}"
            raise GraspError(name, pose.tolist(), words)
        # of unit length exactly, as rotations are made of it
        quaternion = pin.Quaternion(pose[3:] / length)
        poses.append(pin.SE3(quaternion.toRotationMatrix(), pose[:3]))
    return tuple(poses)


def grasp_poses(name: str, value: Sequence[float]) -> None:
    """Up to `MAX_GRASPS` poses."""
    if len(value) > 7 * MAX_GRASPS:
        raise GraspError(name, f"{len(value) // 7} poses", f"an arm may have {MAX_GRASPS}")
    poses_from_list(name, value)


def volume_boxes(name: str, value: Sequence[float]) -> None:
    """V; a VolumeError says which box is wrong, and how."""
    if not value or len(value) % 6:
        raise ParameterError(name, value, f"give six numbers per box, not {len(value)} in all")
    TargetVolume.of_numbers(value)


def point_or_nothing(name: str, value: Sequence[float]) -> None:
    """A point, or nothing."""
    if len(value) not in (0, 3):
        raise ParameterError(name, value, "give x y z, or nothing")


def distinct_names(name: str, value: Sequence[str]) -> None:
    """Names that can be part of a parameter's name."""
    if any(not each or any(map(str.isspace, each)) for each in value):
        raise ParameterError(name, list(value), "give names that are not empty, without spaces")
    if len(set(value)) < len(value):
        raise ParameterError(name, list(value), "name each once")


def named_numbers(name: str, value: Sequence[str]) -> dict[str, float]:
    """Numbers by name, from texts `name=number`.

    Raises:
        ParameterError: a text is not of that form, or a name is given twice.
    """
    numbers: dict[str, float] = {}
    for each in value:
        key, equals, number = (part.strip() for part in each.rpartition("="))
        try:
            read = float(number)
        except ValueError:
            read = math.nan
        if not (key and equals and math.isfinite(read)):
            raise ParameterError(name, each, "give name=number, such as wheel_joint=0.0")
        if key in numbers:
            raise ParameterError(name, each, "name each once")
        numbers[key] = read
    return numbers


def paddings_by_link(name: str, value: Sequence[str]) -> None:
    """Distances by link."""
    for link, padding in named_numbers(name, value).items():
        Meaning(unit="m", interval="[0, 0.2]").check(f"{name}: {link}", padding)


def known_terms(name: str, value: Sequence[str]) -> None:
    """Names of terms that there are."""
    for each in value:
        if each not in (known := term_names()):
            raise ParameterError(name, each, f"is no term; choose of {', '.join(known)}")


def triples(name: str, value: Sequence[float]) -> None:
    """Points or triangles."""
    require_few(*(len(value) // 3 if name.endswith(of) else 0 for of in ("vertices", "triangles")))
    if len(value) % 3 != 0:
        raise ObjectError(name, f"{len(value)} numbers", "give three for each")
