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
        field = fields.get(name)
        if field is None:
            raise CloudError(f"cloud field {name}", sorted(fields), "is missing")
        kind = KINDS.get(field.datatype)
        if kind is None or field.count > 1:
            words = f"datatype {field.datatype}, count {field.count}"
            raise CloudError(f"cloud field {name}", words, "must be one float32 or float64")
        if field.offset + int(kind[1]) > message.point_step:
            words = f"does not fit into point_step {message.point_step}"
            raise CloudError(f"cloud field {name}", f"offset {field.offset}", words)
        formats.append(order + kind)
        offsets.append(field.offset)
    width, height, step = message.width, message.height, message.point_step
    # a view and no copy: other fields and padding are stepped over
    layout = np.dtype(
        {"names": ["x", "y", "z"], "formats": formats, "offsets": offsets, "itemsize": step}
    )
    if width * height == 0:
        return np.empty((0, 0), layout)
    # with a single row the step between rows means nothing
    row_step = message.row_step if height > 1 else width * step
    if row_step < width * step:
        words = f"is less than width {width} times point_step {step}"
        raise CloudError("cloud row_step", row_step, words)
    # the last row need not be padded
    needed = (height - 1) * row_step + width * step
    spare = len(message.data) - needed
    # a row that is followed by a whole point has more points than it says, or longer ones
    if spare < 0 or (height == 1 and spare >= step):
        words = f"{height} x {width} points of point_step {step} are {needed}"
        raise CloudError("cloud data", f"{len(message.data)} bytes", words)
    data = memoryview(message.data)
    return np.ndarray((height, width), layout, data, strides=(row_step, step))
