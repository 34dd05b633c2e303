"""PointCloud2 messages to and from arrays: by way of a structured view."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
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


def coordinates_from_message(message: PointCloud2) -> tuple[Array, Array, Array]:
    """x, y and z of all of the cloud's points, (n,) each, metres; see `structured_points` for what
    is read.

    Raises:
        CloudError: it cannot be read, or has more than `MAX_POINTS`.
    """
    # refused before anything of that size is made
    count = message.width * message.height
    if count > MAX_POINTS:
        raise CloudError("cloud", f"{count} points", f"it may have {MAX_POINTS}; thin it")
    view = structured_points(message)
    # each by itself, as the three need not lie side by side
    x, y, z = (view[name].astype(np.float64).ravel() for name in "xyz")
    return x, y, z


def points_from_message(message: PointCloud2) -> Array:
    """(n, 3) the points that `measured_points` has of a cloud in its own frame, without anything
    that is compiled.

    Raises:
        CloudError: see `coordinates_from_message`.
    """
    points = np.column_stack(coordinates_from_message(message))
    return points[(np.abs(points) <= FAR_M).all(axis=1) & points.any(axis=1)]


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
