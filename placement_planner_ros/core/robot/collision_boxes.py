"""The obstacle set in the form the collision kernels read, made once per set."""

from __future__ import annotations

import weakref

import numpy as np

from placement_planner_ros.core.robot.collision_kernels import BoxArrays
from placement_planner_ros.core.scene.distance import distance_bound_field
from placement_planner_ros.core.scene.grid import ObstacleSet

_CAP = 0.3
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
    number = len(obstacles.lower)
    size = float(obstacles.cell_size)
    grid = np.array([*obstacles.origin, size])
    if not number:
        return BoxArrays(
            number=0,
            rows=np.full((1, 1, 1), -1, dtype=np.int32),
            next=np.zeros(0, dtype=np.int32),
            corners=np.zeros((0, 6)),
            grid=grid,
            field_grid=np.array([*grid, *np.zeros(6)]),
            field=np.zeros((1, 1, 1), dtype=np.float32),
        )
    corners = np.hstack([obstacles.lower, obstacles.upper])
    field = distance_bound_field(obstacles, _CAP)
    return BoxArrays(
        number=number,
        rows=np.array(obstacles.index, dtype=np.int32, order="C"),
        next=np.array(obstacles.next, dtype=np.int32),
        corners=corners,
        grid=grid,
        field_grid=np.array(
            [
                *field.origin,
                field.cell_size,
                *corners[:, :3].min(axis=0),
                *corners[:, 3:].max(axis=0),
            ]
        ),
        field=np.array(field.values),
    )
