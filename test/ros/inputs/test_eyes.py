"""Where clouds were seen from, and which way their frames' axes point."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.fakes import FRAME, TABLE
from std_msgs.msg import Header

from placement_planner_ros.ros.inputs.frames import is_eye, turned_axes
from placement_planner_ros.ros.inputs.point_cloud import message_from_points, points_from_message


@pytest.mark.parametrize(
    ("frame", "height", "eye"),
    [
        ("camera_color_optical_frame", 480, True),
        ("camera_color_optical_frame", 1, False),
        ("camera_link", 480, False),
        ("lidar", 1, True),
        ("map", 480, False),
    ],
)
def test_an_eye_is_declared_or_the_optical_frame_of_an_organised_cloud(frame, height, eye):
    assert is_eye(frame, height, {"sensor_frames": ["lidar"]}) is eye


def seen_by(T, optical):
    """(n, 3) points before a camera at T, whose axes are an optical frame's or a body's."""
    rng = np.random.default_rng(0)
    ahead, right, down = rng.uniform(0.5, 2.0, 500), *rng.uniform(-0.4, 0.4, (2, 500))
    own = [right, down, ahead] if optical else [ahead, -right, -down]
    return np.column_stack(own) @ T.rotation.T + T.translation


def test_axes_of_a_body_in_an_optical_frame_are_told():
    T = pin.SE3(pin.utils.rotate("x", -2.0) @ pin.utils.rotate("z", 0.3), np.array([1.0, 0, 1.0]))
    assert "REP 103" in turned_axes("camera_optical_frame", seen_by(T, False), T)
    assert turned_axes("camera_optical_frame", seen_by(T, True), T) == ""
    assert turned_axes("camera_link", seen_by(T, False), T) == ""


def test_pixels_without_a_measurement_are_no_points():
    grid = np.zeros((2, 3, 3))
    grid[0, 1] = [0.1, 0.0, 0.5]
    points = points_from_message(message_from_points(grid, Header(frame_id="camera")))
    assert np.allclose(points, [[0.1, 0.0, 0.5]])


@pytest.mark.parametrize("mode", ["latest", "merge"])
def test_the_same_points_in_another_frame_are_the_same_cloud(bench, mode):
    b = bench(**{"cloud.mode": mode, "frame_prefix": "cell/"})
    b.feed()
    inputs, link = b.node._inputs, "yumi_link_1_l"
    inputs.robot.wait()
    robot = inputs.robot.robot
    T = robot.link_pose(robot.configuration(inputs.joints.positions()), link)
    own = (TABLE - T.translation) @ T.rotation
    known = []
    for points, frame in ((TABLE, FRAME), (own, link), (own, f"cell/{link}")):
        inputs.clouds.clear()
        before = inputs.clouds.updates
        again = lambda p=points, f=frame: b.cloud(p, f)  # noqa: E731
        b.joint_state()
        again()
        b.wait(lambda n=before: inputs.clouds.updates > n, again=again)
        b.wait(lambda: np.allclose(inputs.clouds.latest()["points"].points, TABLE, atol=1e-6))
        known.append(inputs.clouds.latest()["points"])
        expected = len(TABLE) if mode == "merge" else 0
        b.wait(lambda n=expected: len(inputs.clouds.merged) == n)
    assert all(cloud.origin is None for cloud in known)
