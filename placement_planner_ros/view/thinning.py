"""A cloud as the page shows it: few of its points, read without looking at the others."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from sensor_msgs.msg import PointCloud2, PointField

from placement_planner_ros.core.errors import CloudError
from placement_planner_ros.core.types import Array

MOST_POINTS = 30_000
"""Points of one cloud that are shown."""
FAR = 1e3
"""Metres from the sensor beyond which nothing is shown."""
_TYPES = {PointField.FLOAT32: "f4", PointField.FLOAT64: "f8"}


@dataclass(frozen=True, slots=True, eq=False)
class ThinCloud:
    """Some points of a cloud.

    Attributes:
        frame: that they are in.
        points: (n, 3) metres.
        count: how many points the cloud had.
    """

    frame: str
    points: Array
    count: int


def thinned(message: PointCloud2, most: int = MOST_POINTS) -> ThinCloud:
    """Every k-th point of a cloud, of an organised one every so many-th row and column.

    Every k-th pixel along the rows would be stripes with gaps where the width is about a multiple
    of k. At most `most` points are left.

    The node reads clouds by itself, all of their points; this is for looking only, and loads
    nothing that has to be compiled.

    Raises:
        CloudError: the message is no cloud.
    """
    height, width, count = message.height, message.width, message.height * message.width
    if count == 0:
        return ThinCloud(message.header.frame_id, np.zeros((0, 3)), 0)
    row_step = message.row_step if height > 1 else width * message.point_step
    needed = (height - 1) * row_step + width * message.point_step
    if len(message.data) < needed or row_step < width * message.point_step:
        words = f"do not fit {height} rows of {width} points of {message.point_step} bytes"
        raise CloudError("cloud data", f"{len(message.data)} bytes", words)
    kind = _point(message)
    every = -(-count // most)
    down = min(math.isqrt(every), height)
    along = min(-(-every // down), width)
    down = max(down, -(-every // along))  # a cloud may be narrow
    while -(-height // down) * -(-width // along) > most:  # the last steps count as whole ones
        along, down = (along + 1, down) if along < width else (along, down + 1)
    row, column = np.arange(0, height, down), np.arange(0, width, along)
    first = (row[:, None] * row_step + column * message.point_step).ravel()
    data = np.frombuffer(message.data, np.uint8)
    few = data[first[:, None] + np.arange(message.point_step)].view(kind)[:, 0]
    points = np.column_stack([few[name].astype(np.float64) for name in "xyz"])
    near = (np.abs(points) <= FAR).all(axis=1)  # and they are numbers
    return ThinCloud(message.header.frame_id, points[near], count)


def _point(message: PointCloud2) -> npt.DTypeLike:
    """Where a point has its coordinates."""
    fields = {field.name: field for field in message.fields}
    order = ">" if message.is_bigendian else "<"
    formats, offsets = [], []
    for name in "xyz":
        field = fields.get(name)
        kind = _TYPES.get(field.datatype) if field is not None else None
        if field is None or kind is None:
            raise CloudError(f"cloud field {name}", sorted(fields), "must be float32 or float64")
        if field.offset + int(kind[1]) > message.point_step:
            words = f"does not fit into point_step {message.point_step}"
            raise CloudError(f"cloud field {name}", f"offset {field.offset}", words)
        formats.append(order + kind)
        offsets.append(field.offset)
    return np.dtype(
        {
            "names": ["x", "y", "z"],
            "formats": formats,
            "offsets": offsets,
            "itemsize": message.point_step,
        }
    )


def moved(points: Array, T: pin.SE3) -> Array:
    """Points (n, 3) at T."""
    return np.asarray(points @ T.rotation.T + T.translation)
