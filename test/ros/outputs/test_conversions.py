import numpy as np

from placement_planner_ros.core.types import Trajectory
from placement_planner_ros.ros.outputs.conversions import trajectory_message

TRAJECTORY = Trajectory(
    ("yumi_joint_1_l", "yumi_joint_2_l"),
    np.array([0.0, 0.1 + 0.2, 2.9999999999]),
    np.array([[0.0, 1.0], [0.5, 1.5], [1.0, 2.0]]),
    np.array([[0.0, 0.0], [0.1, 0.2], [0.0, 0.0]]),
    np.array([[0.3, 0.4], [0.0, 0.0], [-0.3, -0.4]]),
)


def test_a_trajectory_message_holds_every_column():
    message = trajectory_message(TRAJECTORY, "3/2")
    assert message.header.frame_id == "3/2"
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (0, 0)
    assert message.joint_names == ["yumi_joint_1_l", "yumi_joint_2_l"]
    for name in ("positions", "velocities", "accelerations"):
        got = [list(getattr(point, name)) for point in message.points]
        np.testing.assert_array_equal(got, getattr(TRAJECTORY, name))
    times = [p.time_from_start.sec + p.time_from_start.nanosec * 1e-9 for p in message.points]
    np.testing.assert_allclose(times, TRAJECTORY.times, atol=1e-9)
