"""PointCloud2 messages to and from arrays: by way of a structured view."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from placement_planner_ros.core.errors import CloudError
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.structured_points import structured_points

MAX_POINTS = 5_000_000
"""Points that a cloud may have."""

FAR_M = 1e6
"""From the sensor, beyond which a coordinate is none."""

SOME_POINTS = 3000
"""Of a surface, that tell as much of it as all of them do."""


def some_of(points: Array, most: int = SOME_POINTS) -> Array:
    """At most so many of the points (n, 3), from all over them."""
    return points[:: -(-len(points) // most) or 1]


def points_from_message(message: PointCloud2, T_frame_cloud: pin.SE3 | None = None) -> Array:
    """The cloud's finite points, (n, 3) metres in that frame, or in its own without one.

    See `structured_points` for what is read. Points with coordinates that are NaN or beyond `FAR_M`
    are left out, and those at the frame's origin, as which some drivers send pixels without a
    measurement.

    Raises:
        CloudError: it cannot be read, or has more than `MAX_POINTS`.
    """
    # refused before anything of that size is made
    count = message.width * message.height
    if count > MAX_POINTS:
        raise CloudError("cloud", f"{count} points", f"it may have {MAX_POINTS}; thin it")
    view = structured_points(message)
    if view.size == 0:
        return np.empty((0, 3))
    T = np.eye(4) if T_frame_cloud is None else T_frame_cloud.homogeneous
    # each coordinate by itself, as the three need not lie side by side
    x, y, z = (view[name].astype(np.float64).ravel() for name in "xyz")
    near = (np.abs(x) <= FAR_M) & (np.abs(y) <= FAR_M) & (np.abs(z) <= FAR_M)  # and are numbers
    kept = near & ((x != 0.0) | (y != 0.0) | (z != 0.0))
    x, y, z = x[kept], y[kept], z[kept]
    return np.column_stack([a * x + b * y + c * z + d for a, b, c, d in T[:3].tolist()])


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
        # bytes: filling it from an array takes a thousand times as long
        data=grid.tobytes(),
        is_dense=bool(np.isfinite(grid).all()),
    )
