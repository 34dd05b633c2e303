"""A PointCloud2's coordinates where they are, without a copy."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import PointCloud2, PointField

from placement_planner_ros.core.errors import CloudError

KINDS = {PointField.FLOAT32: "f4", PointField.FLOAT64: "f8"}
"""What coordinates may be, by NumPy's name."""


def structured_points(message: PointCloud2) -> npt.NDArray[Any]:
    """(height, width) points with fields x, y and z, a view of the message's data.

    The fields may be float32 or float64, in any order, at any offset, of either byte order, with
    other fields and padding between points and rows.

    Raises:
        CloudError: a field is missing or of another type, or the sizes contradict each other.
    """
    fields = {field.name: field for field in message.fields}
    order = ">" if message.is_bigendian else "<"
    formats, offsets = [], []
    for name in "xyz":
        if name not in fields:
            raise CloudError(f"cloud field {name}", sorted(fields), "is missing")
        field = fields[name]
        if field.datatype not in KINDS:
            raise CloudError(
                f"cloud field {name}", f"datatype {field.datatype}", "must be float32 or float64"
            )
        if field.count > 1:
            raise CloudError(f"cloud field {name}", f"count {field.count}", "must be 1")
        size = int(KINDS[field.datatype][1])
        if field.offset + size > message.point_step:
            raise CloudError(
                f"cloud field {name}",
                f"offset {field.offset}",
                f"does not fit into point_step {message.point_step}",
            )
        formats.append(order + KINDS[field.datatype])
        offsets.append(field.offset)
    width, height = message.width, message.height
    layout = np.dtype(
        {
            "names": ["x", "y", "z"],
            "formats": formats,
            "offsets": offsets,
            "itemsize": message.point_step,
        }
    )
    if width * height == 0:
        return np.empty((0, 0), layout)
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
    return np.ndarray(
        shape=(height, width),
        dtype=layout,
        buffer=memoryview(message.data),
        strides=(row_step, message.point_step),
    )
