"""The markers of a run's target volume, of what is kept out of, and of what was placed before."""

import numpy as np
from std_msgs.msg import Header

from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.ros.outputs.markers import scene_markers

MAP = Header(frame_id="map")


def test_every_box_of_the_volume_and_to_keep_out_of_is_drawn():
    lower = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.2], [0.5, 0.0, 0.0]])
    upper = lower + np.array([[0.5, 0.4, 0.3], [0.2, 0.2, 0.1], [0.1, 0.4, 0.3]])
    keep_out = np.stack([lower[:2] - 1.0, upper[:2]], axis=1)
    drawn = scene_markers(MAP, TargetVolume(lower, upper), keep_out, [], [])
    assert len({(marker.ns, marker.id) for marker in drawn}) == len(drawn)
    for name, corners in (
        ("target_volume", np.stack([lower, upper], axis=1)),
        ("keep_out", keep_out),
    ):
        boxes = [marker for marker in drawn if marker.ns == name]
        for (low, high), marker in zip(corners, boxes, strict=True):
            at, size = marker.pose.position, marker.scale
            np.testing.assert_allclose([at.x, at.y, at.z], (low + high) / 2)
            np.testing.assert_allclose([size.x, size.y, size.z], high - low)
