"""The obstacle set in the form the collision kernels read, made once per set."""

from __future__ import annotations

import weakref
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.collision.against_boxes import BoxArrays
from placement_planner_ros.core.scene.distance import distance_bound_field
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import Array, Index32

_T = TypeVar("_T", bound=np.generic)

_FIELD_REACH_M = 0.3
_made: dict[tuple[int, int], tuple[BoxArrays, Array]] = {}


def box_arrays(obstacles: ObstacleSet) -> BoxArrays:
    """Boxes, index and field of distance bounds of an obstacle set; remembered while it lives.

    `obstacles.cells`, which the result does not hold, stands for the life of the set.
    """
    key = id(obstacles.cells), id(obstacles.lower)
    if key not in _made:
        _made[key] = _lay_out_boxes(obstacles), obstacles.lower
        weakref.finalize(obstacles.cells, _made.pop, key, None)
    return _made[key][0]


def _lay_out_boxes(obstacles: ObstacleSet) -> BoxArrays:
    field = distance_bound_field(obstacles, _FIELD_REACH_M)
    scales = field.step, field.exact, 1.0 / field.cell_size
    return BoxArrays(
        number=len(obstacles.lower),
        columns=_read_only_view(_column_index(obstacles)),
        layers=_read_only_view(obstacles.cells[:, 2]),
        corners=np.hstack([obstacles.lower, obstacles.upper]),
        grid=np.array([*obstacles.origin, obstacles.cell_size]),
        field_grid=np.array([*field.origin, field.cell_size, *field.shape, *scales]),
        field=_read_only_view(field.levels),
        tops=np.zeros(0),
        support=np.zeros(4),
    )


def _column_index(obstacles: ObstacleSet) -> Index32:
    """First box of each column of cells, as `BoxArrays.columns`: boxes are in the cells' order."""
    nx, ny, _ = obstacles.shape
    column = obstacles.cells[:, 0].astype(np.int64) * ny + obstacles.cells[:, 1]
    ends = np.cumsum(np.bincount(column, minlength=nx * ny)).reshape(nx, ny)
    columns = np.zeros((nx, ny + 1), dtype=np.int32)
    columns[:, 1:] = ends
    columns[1:, 0] = ends[:-1, -1]
    return columns


def _read_only_view(array: npt.NDArray[_T]) -> npt.NDArray[_T]:
    """A read-only view: the kernels are compiled for arrays of one kind."""
    view = np.ascontiguousarray(array).view()
    view.setflags(write=False)
    return view
