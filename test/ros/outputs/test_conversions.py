import numpy as np

from placement_planner_ros.core.types import Trajectory
from placement_planner_ros.ros.outputs.conversions import (
    trajectory_message,
    with_all_joints,
)
from placement_planner_ros.scenes.yumi import HOME, load_yumi

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


def test_all_joints_are_held_where_the_robot_is():
    robot = load_yumi()
    q = robot.configuration(HOME)
    complete = with_all_joints(TRAJECTORY, robot, q)
    assert set(complete.joints) == set(HOME)
    for i, name in enumerate(complete.joints):
        if name in TRAJECTORY.joints:
            column = TRAJECTORY.joints.index(name)
            np.testing.assert_array_equal(complete.positions[:, i], TRAJECTORY.positions[:, column])
        else:
            assert (complete.positions[:, i] == q[robot.index(name)]).all()
            assert (complete.velocities[:, i] == 0.0).all()
