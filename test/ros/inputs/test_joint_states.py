import numpy as np
import pytest
from helpers.home import HOME

from placement_planner_ros.core.errors import JointStateError
from placement_planner_ros.ros.inputs.joint_states import (
    JointsStaleError,
    JointStates,
    RobotMovingError,
)
from placement_planner_ros.scenes.yumi import load_yumi

REST_SPEED = 0.02


@pytest.fixture(scope="module")
def yumi():
    return load_yumi()


def full(joints, now, **changes):
    values = {**HOME, **changes}
    joints.update(list(values), list(values.values()), now)


def resting(joints, yumi, now=10.0):
    return joints.resting(yumi, yumi.joint_names, {}, now, timeout=1.0, rest_speed=REST_SPEED)


def at(joints, names, stamp, now, timeout, **assumed):
    return joints.at(names, stamp, now, timeout, REST_SPEED, assumed)


def test_values_of_several_publishers_are_merged(yumi):
    joints = JointStates()
    arms = [n for n in HOME if "gripper" not in n]
    hands = [n for n in HOME if "gripper" in n]
    joints.update(arms, [HOME[n] for n in arms], 9.9)
    with pytest.raises(JointStateError, match="gripper_l_joint"):
        resting(joints, yumi)
    joints.update(hands, [HOME[n] for n in hands], 9.8)
    np.testing.assert_array_equal(resting(joints, yumi), yumi.configuration(HOME))


def test_one_old_joint_makes_the_state_stale(yumi):
    joints = JointStates()
    full(joints, 8.9)
    names = [n for n in HOME if n != "yumi_joint_3_r"]
    joints.update(names, [HOME[n] for n in names], 9.9)
    with pytest.raises(JointsStaleError, match="yumi_joint_3_r") as error:
        resting(joints, yumi)
    assert error.value.code == "JOINTS_STALE"
    assert "yumi_joint_4_r" not in str(error.value)


def test_a_joint_that_moved_long_ago_is_at_rest(yumi):
    joints = JointStates()
    full(joints, 9.0)
    for now in (9.4, 9.6, 9.8, 9.9):
        full(joints, now, yumi_joint_1_l=0.05)
    assert resting(joints, yumi)[yumi.index("yumi_joint_1_l")] == 0.05


def test_what_is_wrong_with_one_joint_keeps_no_other_from_being_taken(yumi):
    joints = JointStates()
    full(joints, 9.0)
    names = ["yumi_joint_1_l", "yumi_joint_2_l", "yumi_joint_3_l", "yumi_joint_2_l"]
    with pytest.raises(JointStateError, match=r"not finite.*\['yumi_joint_1_l'\].*finite"):
        joints.update(names[:3], [np.nan, 0.2, 0.3], 9.9)
    with pytest.raises(JointStateError, match=r"twice.*\['yumi_joint_2_l'\]"):
        joints.update(names[1:], [0.7, 0.4, 0.8], 9.91)
    with pytest.raises(JointStateError, match=r"not finite.*\['yumi_joint_2_l'\]"):
        joints.update(names[1:], [np.nan, 0.5, 0.8], 9.92)
    with pytest.raises(JointStateError, match="4 names, 3 positions"):
        joints.update(names, [0.9, 0.9, 0.9], 9.93)
    known = joints.positions()
    assert known["yumi_joint_1_l"] == HOME["yumi_joint_1_l"]
    assert known["yumi_joint_2_l"] == 0.2
    assert known["yumi_joint_3_l"] == 0.5
    # The joint that is wrong grows old by itself.
    others = [n for n in HOME if n != "yumi_joint_1_l"]
    joints.update(others, [known[n] for n in others], 9.95)
    with pytest.raises(JointStateError, match="finite"):
        joints.update(["yumi_joint_1_l", *others], [np.nan, *(known[n] for n in others)], 10.2)
    with pytest.raises(JointsStaleError, match="yumi_joint_1_l") as error:
        resting(joints, yumi, now=10.5)
    assert "yumi_joint_2_l" not in str(error.value)


def test_what_is_assumed_of_a_joint_holds_until_somebody_publishes_it():
    joints = JointStates()
    joints.update(["a"], [0.2], 1.0)
    assert at(joints, ["a", "b"], None, 1.0, 1.0, a=0.7, b=0.5) == {"a": 0.2, "b": 0.5}


def test_where_joints_were_is_told_or_why_not():
    joints = JointStates()
    with pytest.raises(JointStateError, match=r"missing.*'b'"):
        at(joints, ["b"], None, 0.0, 1.0)
    for i in range(100):
        joints.update(["a", "b"], [0.01 * i, 0.0], i * 0.01, 100.0 + i * 0.01)
    for stamp in (None, 99.0, 100.5, 101.0):
        with pytest.raises(RobotMovingError, match="'a'"):
            at(joints, ["a", "b"], stamp, 1.0, 1.0)
        assert at(joints, ["b"], stamp, 1.0, 1.0) == {"b": 0.0}
    for i in range(100, 200):
        joints.update(["a", "b"], [1.0, 0.0], i * 0.01, 100.0 + i * 0.01)
    assert at(joints, ["a", "b"], 101.1, 2.0, 1.0) == {"a": 1.0, "b": 0.0}
    with pytest.raises(RobotMovingError, match="'a'"):
        at(joints, ["a", "b"], 100.9, 2.0, 1.0)
    with pytest.raises(JointsStaleError, match="'b'"):
        at(joints, ["b"], 101.1, 5.0, 1.0)


def test_a_joint_without_end_stops_rests_where_its_values_wrap(yumi):
    joints = JointStates()
    joints.keep(list(HOME), continuous=["yumi_joint_6_l"])
    for k, value in enumerate((np.pi - 1e-4, -np.pi + 1e-4, 17.3 * np.pi - np.pi * 0.3)):
        full(joints, 9.7 + 0.1 * k, yumi_joint_6_l=value)
    q = resting(joints, yumi)
    assert q[yumi.index("yumi_joint_6_l")] == 17.0 * np.pi, "in the turns that are reported"
    assert joints.moving(["yumi_joint_6_l"], REST_SPEED) == []
    other = JointStates()
    other.keep(list(HOME))
    full(other, 9.8, yumi_joint_6_l=np.pi - 1e-4)
    full(other, 9.9, yumi_joint_6_l=-np.pi + 1e-4)
    with pytest.raises(RobotMovingError, match="yumi_joint_6_l"):
        resting(other, yumi)
