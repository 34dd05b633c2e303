"""The markers of a run's target volume."""

import numpy as np
from builtin_interfaces.msg import Time

from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.ros.outputs.markers import scene_markers


def test_every_box_of_the_volume_is_drawn():
    lower = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.2], [0.5, 0.0, 0.0]])
    upper = lower + np.array([[0.5, 0.4, 0.3], [0.2, 0.2, 0.1], [0.1, 0.4, 0.3]])
    drawn = scene_markers("map", Time(), TargetVolume(lower, upper), [])
    boxes = [marker for marker in drawn if marker.ns == "target_volume"]
    assert len({(marker.ns, marker.id) for marker in drawn}) == len(drawn)
    for low, high, marker in zip(lower, upper, boxes, strict=True):
        at, size = marker.pose.position, marker.scale
        np.testing.assert_allclose([at.x, at.y, at.z], (low + high) / 2)
        np.testing.assert_allclose([size.x, size.y, size.z], high - low)
