"""PointCloud2 messages to and from arrays: one compiled pass over a structured view."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from placement_planner_ros.core.errors import CloudError
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.structured_points import KINDS, structured_points

MAX_POINTS = 5_000_000
"""Points that a cloud may have."""

FAR_M = 1e6
"""From the sensor, beyond which a coordinate is none."""


def points_from_message(message: PointCloud2, T_frame_cloud: pin.SE3 | None = None) -> Array:
    """The cloud's finite points, (n, 3) metres in that frame, or in its own without one.

    See `structured_points` for what is read. Points with coordinates that are NaN or beyond `FAR_M`
    are left out, and those at the frame's origin, as which some drivers send pixels without a
    measurement.

    Raises:
        CloudError: it cannot be read, or has more than `MAX_POINTS`.
    """
    count = message.width * message.height
    if count > MAX_POINTS:
        raise CloudError("cloud", f"{count} points", f"it may have {MAX_POINTS}; thin it")
    view = structured_points(message)
    if view.size == 0:
        return np.empty((0, 3))
    T = np.eye(4) if T_frame_cloud is None else T_frame_cloud.homogeneous
    widest = max(view.dtype[name].str[1:] for name in "xyz")
    points = np.empty((view.size, 3))
    x, y, z = (_column(view[name], widest) for name in "xyz")
    kept = _read(x, y, z, np.ascontiguousarray(T), points)
    return points[:kept]


def warm_up() -> None:
    """Compile for both kinds of coordinates, or load."""
    for kind in KINDS.values():
        column = _column(np.zeros((1, 1), kind), kind)
        _read(column, column, column, np.eye(4), np.empty((2, 3)))


def _column(values: npt.NDArray[Any], kind: str) -> npt.NDArray[Any]:
    """(h, w) coordinates as `_read` is compiled for: of that kind in this machine's byte order,
    aligned, and with gaps in between; a single one is followed by NaN."""
    flags = values.flags
    if values.dtype == kind and flags.aligned and not (flags.c_contiguous or flags.f_contiguous):
        column = values
    else:
        height, width = values.shape
        column = np.full((height, max(width, 2), 2), np.nan, kind)[..., 0]
        column[:, :width] = values
    column.setflags(write=False)
    return column


@kernel(nogil=True)
def _read(
    x: npt.NDArray[Any], y: npt.NDArray[Any], z: npt.NDArray[Any], T: Array, points: Array
) -> int:
    """Fill `points` (h w, 3) with those of (h, w) that are not zero, nor farther than `FAR_M`, and
    moved by T (4, 4); how many."""
    kept = 0
    for i in range(x.shape[0]):
        for j in range(x.shape[1]):
            a, b, c = float(x[i, j]), float(y[i, j]), float(z[i, j])
            u = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + T[0, 3]
            v = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + T[1, 3]
            w = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + T[2, 3]
            measured = a != 0.0 or b != 0.0 or c != 0.0
            if (
                measured and abs(a) <= FAR_M and abs(b) <= FAR_M and abs(c) <= FAR_M
            ):  # and are numbers
                points[kept, 0] = u
                points[kept, 1] = v
                points[kept, 2] = w
                kept += 1
    return kept


def message_from_points(points: npt.NDArray[np.floating], header: Header) -> PointCloud2:
    """A float32 cloud of points (n, 3), or organised (height, width, 3) with NaN holes."""
    grid = np.ascontiguousarray(points, dtype="<f4")
    if grid.ndim == 2:
        grid = grid[None]
    height, width = grid.shape[:2]
    return PointCloud2(
        header=header,
        height=height,
        width=width,
        fields=[
            PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
            for i, name in enumerate("xyz")
        ],
        is_bigendian=False,
        point_step=12,
        row_step=12 * width,
        data=grid.tobytes(),
        is_dense=bool(np.isfinite(grid).all()),
    )
