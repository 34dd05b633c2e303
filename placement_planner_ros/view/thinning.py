"""A cloud as the page shows it: few of its points, read without looking at the others."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from sensor_msgs.msg import PointCloud2

from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.structured_points import structured_points

MOST_POINTS = 30_000
"""Points of one cloud that are shown."""


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


def thinned_cloud(message: PointCloud2, most: int = MOST_POINTS) -> ThinCloud:
    """At most `most` points: every k-th row and column of an organised cloud, else every k-th.

    The node reads all points of its clouds; this is for looking only, and loads nothing that has to
    be compiled.

    Raises:
        CloudError: the message is no cloud.
    """
    height, width, count = message.height, message.width, message.height * message.width
    if count == 0:
        return ThinCloud(message.header.frame_id, np.zeros((0, 3)), 0)
    # as far apart along rows as across them, as long as there are rows enough
    down = min(math.ceil(math.sqrt(count / most)), height)
    along = math.ceil(width / max(1, most // math.ceil(height / down)))
    few = structured_points(message)[::down, ::along]
    points = np.column_stack([few[name].ravel().astype(np.float64) for name in "xyz"])
    # what was not measured is no point
    finite = np.isfinite(points).all(axis=1)
    return ThinCloud(message.header.frame_id, points[finite], count)


def moved_points(points: Array, T: pin.SE3) -> Array:
    """Points (n, 3) at T."""
    return np.asarray(points @ T.rotation.T + T.translation)
