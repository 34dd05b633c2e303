"""The obstacle set in the form the collision kernels read, made once per set."""

from __future__ import annotations

import weakref

import numpy as np
from scipy.ndimage import distance_transform_edt

from placement_planner_ros.core.robot.collision_kernels import BoxArrays
from placement_planner_ros.core.scene.grid import ObstacleSet

_made: dict[int, BoxArrays] = {}


def box_arrays(obstacles: ObstacleSet) -> BoxArrays:
    """Boxes, index and field of distance bounds of an obstacle set; remembered while it lives."""
    key = id(obstacles.index)
    known = _made.get(key)
    if known is None:
        known = _made[key] = _make(obstacles)
        weakref.finalize(obstacles.index, _made.pop, key, None)
    return known


def _make(obstacles: ObstacleSet) -> BoxArrays:
    origin = np.ascontiguousarray(obstacles.origin, dtype=np.float64)
    size = float(obstacles.cell_size)
    lower = np.ascontiguousarray(obstacles.lower, dtype=np.float64).reshape(-1, 3)
    upper = np.ascontiguousarray(obstacles.upper, dtype=np.float64).reshape(-1, 3)
    number = len(lower)
    index = np.ascontiguousarray(obstacles.index, dtype=np.int32)
    if number:
        extent = np.concatenate([lower.min(axis=0), upper.max(axis=0)])
        distance = distance_transform_edt(index < 0) * size
        # Both centres may be half a diagonal from the points that matter; a box fills its cell at
        # most, and the query's own half is taken off where the field is read.
        field = np.maximum(distance - 0.5 * np.sqrt(3.0) * size, 0.0).astype(np.float32) - 1e-6
    else:
        extent = np.zeros(6)
        index = np.full((1, 1, 1), -1, dtype=np.int32)
        field = np.zeros((1, 1, 1))
    return BoxArrays(
        number=number,
        origin=origin,
        cell_size=size,
        rows=index,
        lower=lower,
        upper=upper,
        next=np.ascontiguousarray(obstacles.next, dtype=np.int32),
        extent=extent,
        field_origin=origin,
        field_cell=size,
        field=np.ascontiguousarray(field, dtype=np.float32),
    )
