"""The error of a camera's calibration, by the robot that it shows."""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.point_cloud import some_of
from placement_planner_ros.ros.inputs.self_filter import OWN_M, Outline

ORDINARY_M = 0.006
"""By which ordinary calibrations are off at most, with what noise adds; more is no calibration."""
_TRUSTED_M = (0.01, 0.006, 0.004, 0.003)
"""From a surface, once it is shifted, within which a point is taken for one of it, look by look."""
_FEWEST = 300
"""Points of the robot without which nothing is known."""
_SPREAD = 0.1
"""Least mean square of the surfaces' normals along any direction, where a ball has 1/3: a board
beside one side of the robot does not pass for its surface."""


def camera_shift(robot: Outline, points: Array) -> Array:
    """(3,) by which the points (n, 3) of one camera are off the robot's surfaces, metres.

    Zeros where that is no more than joint values are true to, where too little of the robot is
    seen, or where no ordinary calibration explains it.
    """
    step("laying the clouds on the robot that they show")
    # of the points by the robot some, with the normals of its surfaces there
    near = some_of(points[robot.near(points)])
    look = robot.look(near)
    rows = look.padded & (look.apart > 0.0) & np.isfinite(look.apart)
    # distances from the surfaces, negative inside
    signed = np.where(look.inside, -look.apart, look.apart)[rows]
    normals = (near - look.nearest)[rows] / signed[:, None]
    shift: Array = np.zeros(3)
    # least squares, closer and closer: what is no part of the robot drops out
    for trusted in _TRUSTED_M:
        of_robot = np.abs(signed - normals @ shift) <= trusted
        n, along = normals[of_robot], signed[of_robot]
        # normals in few directions leave the shift along the others open
        if len(n) < _FEWEST or np.linalg.eigvalsh(n.T @ n / len(n))[0] < _SPREAD:
            return np.zeros(3)
        shift = np.asarray(np.linalg.solve(n.T @ n, n.T @ along))
    length = float(np.linalg.norm(shift))
    return shift if OWN_M / 2 < length <= ORDINARY_M else np.zeros(3)
