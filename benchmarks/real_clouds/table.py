"""Finds the table in a sensor's cloud, and puts it in front of the robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.types import Array, TargetVolume

_FARTHEST = 1.6
"""m from the sensor: a table is nearer than the floor and the walls."""
_NEAR_PLANE = 0.006
_TRIES = 400
_FRONT, _REACH, _WIDE = 0.24, 0.62, 0.30
"""m: where the table begins before the robot, and how far V goes ahead and to either side."""
_BELOW, _ABOVE = 0.02, 0.02
"""m that V reaches below and above the table."""


@dataclass(frozen=True, slots=True, eq=False)
class TableCloud:
    """A cloud with its table in the plane z = 0, in front of the robot.

    Attributes:
        points: (n, 3) in the world frame, the finite ones.
        sensor: (3,) where it was.
        volume: V, on the part of the table that the robot may reach.
    """

    points: Array
    sensor: Array
    volume: TargetVolume


def on_table(measured: Array, rng: np.random.Generator) -> TableCloud:
    """Points (n, 3) in the sensor's frame, turned so that the table is level and ahead.

    The table is the plane with most points near the sensor; the robot stands on the sensor's side.

    Raises:
        ParameterError: there is no such plane.
    """
    points = measured[np.isfinite(measured).all(axis=1)]
    near = points[np.linalg.norm(points, axis=1) < _FARTHEST]
    if len(near) < 1000:
        raise ParameterError("cloud", f"{len(near)} points", "give a cloud of a table within 1.6 m")
    normal, offset = _best_plane(near, rng)
    if offset > 0.0:  # the sensor, at the origin, is above
        normal, offset = -normal, -offset
    of_table = near[np.abs(near @ normal - offset) < _NEAR_PLANE]
    ahead = of_table.mean(axis=0)
    ahead = ahead - (ahead @ normal) * normal
    x = ahead / np.linalg.norm(ahead)
    rotation = np.stack([x, np.cross(normal, x), normal])
    along, across = (of_table @ rotation[:2].T).T
    middle = np.median(across[along < np.percentile(along, 60.0)])
    begin = np.percentile(along, 1.0)
    T = pin.SE3(rotation, np.array([_FRONT - begin, -middle, -offset]))
    volume = TargetVolume(np.array([_FRONT, -_WIDE, -_BELOW]), np.array([_REACH, _WIDE, _ABOVE]))
    return TableCloud(points @ T.rotation.T + T.translation, T.translation, volume)


def _best_plane(points: Array, rng: np.random.Generator) -> tuple[npt.NDArray[np.float64], float]:
    """Unit normal n and n @ x of the plane near most points, by random triples."""
    sample = points[rng.choice(len(points), min(len(points), 5000), replace=False)]
    best, most = (np.array([0.0, 0.0, 1.0]), 0.0), -1
    for _ in range(_TRIES):
        a, b, c = sample[rng.choice(len(sample), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        if length < 1e-4:
            continue
        normal /= length
        count = int((np.abs((sample - a) @ normal) < _NEAR_PLANE).sum())
        if count > most:
            best, most = (normal, float(normal @ a)), count
    for _ in range(3):  # all points near it give it more exactly
        rows = points[np.abs(points @ best[0] - best[1]) < _NEAR_PLANE]
        middle = rows.mean(axis=0)
        normal = np.linalg.eigh(np.cov((rows - middle).T))[1][:, 0]
        best = normal, float(normal @ middle)
    return best
