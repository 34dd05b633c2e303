"""Checks of rules and wishes that a value alone can fail.

Each takes the parameter's name and raises a ParameterError.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from placement_planner_ros.core.errors import ParameterError, VolumeError
from placement_planner_ros.core.types import TargetVolume

_UNIT_LENGTH_TOLERANCE = 1e-2
"""How far a quaternion's length may be from 1."""
_LEAST_COORDINATE, _GREATEST_COORDINATE = 1e-6, 1e6
"""Of the largest coordinate of a direction, so that its length can be told."""
_FARTHEST_POSE_M = 1e3
"""m from the origin that a pose may be."""


def check_direction(name: str, value: Sequence[float]) -> None:
    """Three numbers that are not all zero, or nothing."""
    if len(value) not in (0, 3):
        raise ParameterError(name, list(value), "give a direction x y z, or nothing")
    if len(value) and not _LEAST_COORDINATE <= np.abs(value).max() <= _GREATEST_COORDINATE:
        raise ParameterError(
            name,
            list(value),
            f"give three numbers that are not all zero, up to {_GREATEST_COORDINATE:g}: only the "
            "direction counts",
        )


def check_pose_value(name: str, value: Sequence[float]) -> None:
    """One pose x y z qx qy qz qw, or nothing."""
    if len(value) not in (0, 7):
        raise ParameterError(name, list(value), "give seven numbers: x y z qx qy qz qw")
    if len(value) and not np.abs(value[:3]).max() <= _FARTHEST_POSE_M:
        raise ParameterError(
            name, list(value), f"give a place within {_FARTHEST_POSE_M:g} m of the origin"
        )
    # Without a pose there is nothing wrong with its length.
    length = float(np.linalg.norm(value[3:])) if len(value) else 1.0
    if not abs(length - 1.0) < _UNIT_LENGTH_TOLERANCE:
        raise ParameterError(
            name, list(value), f"the quaternion x y z w must have length 1, not {length:.3g}"
        )


def check_boxes(name: str, value: Sequence[float]) -> None:
    """Minimum and maximum corners of boxes, six numbers each, or nothing."""
    # As V is checked, which is such boxes too.
    try:
        if len(value):
            TargetVolume.of_numbers(value)
    except VolumeError as error:
        raise ParameterError(name, error.value, error.remedy) from error
