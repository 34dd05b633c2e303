import numpy as np
import pytest

from placement_planner_ros.core.errors import JointStateError
from placement_planner_ros.ros.inputs.joint_states import (
    JointsStaleError,
    JointStates,
    RobotMovingError,
)
from placement_planner_ros.scenes.yumi import HOME, load_yumi


@pytest.fixture(scope="module")
def yumi():
    return load_yumi()


def full(joints, now, **changes):
    values = {**HOME, **changes}
    joints.update(list(values), list(values.values()), [], now)


def resting(joints, yumi, now=10.0):
    return joints.resting(yumi, now, timeout=1.0, tolerance=0.01)


def test_values_of_several_publishers_are_merged(yumi):
    joints = JointStates()
    arms = [n for n in HOME if "gripper" not in n]
    hands = [n for n in HOME if "gripper" in n]
    joints.update(arms, [HOME[n] for n in arms], [], 9.9)
    with pytest.raises(JointStateError, match="gripper_l_joint"):
        resting(joints, yumi)
    joints.update(hands, [HOME[n] for n in hands], [], 9.8)
    np.testing.assert_array_equal(resting(joints, yumi), yumi.configuration(HOME))


def test_the_newest_value_counts(yumi):
    joints = JointStates()
    full(joints, 5.0)
    full(joints, 9.5, yumi_joint_5_l=0.4)
    assert resting(joints, yumi)[yumi.index("yumi_joint_5_l")] == 0.4


def test_one_old_joint_makes_the_state_stale(yumi):
    joints = JointStates()
    full(joints, 8.9)
    names = [n for n in HOME if n != "yumi_joint_3_r"]
    joints.update(names, [HOME[n] for n in names], [], 9.9)
    with pytest.raises(JointsStaleError, match="yumi_joint_3_r") as error:
        resting(joints, yumi)
    assert error.value.code == "JOINTS_STALE"
    assert "yumi_joint_4_r" not in str(error.value)


def test_a_changing_position_is_motion(yumi):
    joints = JointStates()
    full(joints, 9.8)
    full(joints, 9.9, yumi_joint_1_l=0.05)
    with pytest.raises(RobotMovingError, match="yumi_joint_1_l"):
        resting(joints, yumi)


def test_a_joint_that_moved_long_ago_is_at_rest(yumi):
    joints = JointStates()
    full(joints, 9.0)
    for now in (9.4, 9.6, 9.8, 9.9):
        full(joints, now, yumi_joint_1_l=0.05)
    assert resting(joints, yumi)[yumi.index("yumi_joint_1_l")] == 0.05


def test_a_reported_velocity_is_motion(yumi):
    joints = JointStates()
    joints.update(list(HOME), list(HOME.values()), [0.0] * (len(HOME) - 1) + [0.3], 9.9)
    with pytest.raises(RobotMovingError, match=list(HOME)[-1]):
        resting(joints, yumi)


def test_malformed_messages_change_nothing(yumi):
    joints = JointStates()
    full(joints, 9.9)
    with pytest.raises(JointStateError, match="1 names, 2 positions"):
        joints.update(["yumi_joint_1_l"], [0.1, 0.2], [], 9.95)
    with pytest.raises(JointStateError, match="yumi_joint_1_l"):
        joints.update(["yumi_joint_2_l", "yumi_joint_1_l"], [1.0, float("nan")], [], 9.95)
    np.testing.assert_array_equal(resting(joints, yumi), yumi.configuration(HOME))
