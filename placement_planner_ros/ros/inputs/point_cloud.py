"""PointCloud2 messages to and from arrays, by a structured view: no copy per field, no loop."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from placement_planner_ros.core.errors import CloudError
from placement_planner_ros.core.types import Array

MAX_POINTS = 5_000_000
"""Points that a cloud may have."""

FAR = 1e6
"""Metres from the sensor beyond which a coordinate is none."""

_TYPES = {PointField.FLOAT32: "f4", PointField.FLOAT64: "f8"}


def points_from_message(message: PointCloud2) -> Array:
    """The cloud's finite points, (n, 3) metres in its own frame.

    Fields x, y and z may be float32 or float64, in any order, at any offset, of either byte
    order, with other fields and padding between points and rows. Points with coordinates that are
    NaN or beyond `FAR` are left out.

    Raises:
        CloudError: a field is missing or of another type, the sizes contradict each other, or it
            has more than `MAX_POINTS`.
    """
    fields = {field.name: field for field in message.fields}
    order = ">" if message.is_bigendian else "<"
    formats, offsets = [], []
    for name in "xyz":
        if name not in fields:
            raise CloudError(f"cloud field {name}", sorted(fields), "is missing")
        field = fields[name]
        if field.datatype not in _TYPES:
            raise CloudError(
                f"cloud field {name}", f"datatype {field.datatype}", "must be float32 or float64"
            )
        if field.count > 1:
            raise CloudError(f"cloud field {name}", f"count {field.count}", "must be 1")
        size = int(_TYPES[field.datatype][1])
        if field.offset + size > message.point_step:
            raise CloudError(
                f"cloud field {name}",
                f"offset {field.offset}",
                f"does not fit into point_step {message.point_step}",
            )
        formats.append(order + _TYPES[field.datatype])
        offsets.append(field.offset)
    width, height = message.width, message.height
    if width * height == 0:
        return np.empty((0, 3))
    if width * height > MAX_POINTS:
        raise CloudError("cloud", f"{width * height} points", f"it may have {MAX_POINTS}; thin it")
    if height > 1 and message.row_step < width * message.point_step:
        raise CloudError(
            "cloud row_step",
            message.row_step,
            f"is less than width {width} times point_step {message.point_step}",
        )
    row_step = message.row_step if height > 1 else width * message.point_step
    needed = (height - 1) * row_step + width * message.point_step
    if len(message.data) < needed:
        raise CloudError(
            "cloud data", f"{len(message.data)} bytes", f"{height} x {width} points need {needed}"
        )
    view = np.ndarray(
        shape=(height, width),
        dtype=np.dtype(
            {
                "names": ["x", "y", "z"],
                "formats": formats,
                "offsets": offsets,
                "itemsize": message.point_step,
            }
        ),
        buffer=memoryview(message.data),
        strides=(row_step, message.point_step),
    )
    points = np.empty((height * width, 3))
    with np.errstate(invalid="ignore"):  # a NaN may be a signalling one
        for column, name in enumerate("xyz"):
            points[:, column] = view[name].reshape(-1)
    return np.asarray(points[(np.abs(points) <= FAR).all(axis=1)])


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
