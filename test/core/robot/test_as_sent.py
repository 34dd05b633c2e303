"""Descriptions as people's machines send them: what they mean is what urdfdom and MoveIt say."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.robots import joint, link, urdf

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.robot.joint_limits import JointLimit
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.ros.inputs.joint_limits_file import parse_joint_limits

BOX = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
MIMIC = '<mimic joint="gone"/>'
TURN = [0.3, -0.5, 0.2, 0.8]
"""x y z w, not of length 1."""


def turned(version, *, everywhere=False):
    """A description whose joint and shape are turned by the quaternion, or by its angles."""
    R = pin.Quaternion(np.array(TURN) / np.linalg.norm(TURN)).toRotationMatrix()
    quaternion = f'xyz="0.1 0.2 0.3" quat_xyzw="{" ".join(map(str, TURN))}"'
    angles = f'xyz="0.1 0.2 0.3" rpy="{" ".join(map(repr, pin.rpy.matrixToRpy(R).tolist()))}"'
    origin = angles if everywhere else quaternion
    shape = f'<collision><origin {origin}/><geometry><box size="1 2 3"/></geometry></collision>'
    moving = joint("j", "a", "b", origin=origin)
    return urdf(link("a"), link("b", shape), moving, version=version)


def test_a_quaternion_turns_joints_and_shapes_alike():
    told, same = Robot.from_urdf(turned("1.1")), Robot.from_urdf(turned("1.1", everywhere=True))
    q = np.array([0.4])
    (T_told,), (T_same,) = told.geometry_poses(q), same.geometry_poses(q)
    np.testing.assert_allclose(T_told.homogeneous, T_same.homogeneous, atol=1e-12)
    of_urdfdom = pin.buildModelFromXML(turned("1.1"))
    data = of_urdfdom.createData()
    pin.framesForwardKinematics(of_urdfdom, data, q)
    T_link = data.oMf[of_urdfdom.getFrameId("b")]
    np.testing.assert_allclose(told.link_pose(q, "b").homogeneous, T_link.homogeneous, atol=1e-12)


def test_a_quaternion_of_urdf_1_0_is_none_and_that_is_said():
    robot = Robot.from_urdf(turned("1.0"))
    np.testing.assert_array_equal(robot.geometry_poses(np.zeros(1))[0].rotation, np.eye(3))
    assert any("quat_xyzw" in words for words in robot.warnings)


@pytest.mark.parametrize("origin", ['rpy="0 0 1" quat_xyzw="0 0 0 1"', 'quat_xyzw="0 0 0 0"'])
def test_a_rotation_that_nobody_can_know_is_refused(origin):
    moving = joint("j", "a", "b", origin=origin)
    with pytest.raises(RobotError, match="quat_xyzw"):
        Robot.from_urdf(urdf(link("a"), link("b"), moving, version="1.1"))


def soft(attributes, kind="revolute", limits=None, limit='lower="-1" upper="1" velocity="2"'):
    """The robot of a joint with a safety controller."""
    more = f'<safety_controller k_velocity="9" {attributes}/>'
    moving = joint("j", "a", "b", kind, limit=f'<limit effort="1" {limit}/>', more=more)
    return Robot.from_urdf(urdf(link("a"), link("b"), moving), joint_limits=limits)


@pytest.mark.parametrize(
    ("attributes", "given", "expected"),
    [
        ('soft_lower_limit="-0.5" soft_upper_limit="0.7"', {}, (-0.5, 0.7)),
        ('soft_lower_limit="-3" soft_upper_limit="0.7"', {}, (-1.0, 0.7)),
        ('soft_upper_limit="0.7"', {}, (0.0, 0.7)),
        ("", {}, (-1.0, 1.0)),
        ('soft_lower_limit="-3" soft_upper_limit="2"', {"kind": "continuous"}, None),
        (
            'soft_lower_limit="-3" soft_upper_limit="2"',
            {"limit": 'lower="-inf" upper="inf" velocity="1"'},
            (-3.0, 2.0),
        ),
        ('soft_lower_limit="-0.5" soft_upper_limit="0.7"', {"limits": (-0.2, 0.9)}, (-0.2, 0.7)),
    ],
)
def test_soft_limits_are_limits_as_for_moveit(attributes, given, expected):
    if "limits" in given:
        given = {"limits": {"j": JointLimit(*given["limits"])}}
    robot = soft(attributes, **given)
    if expected is None:
        assert robot.continuous == {"j"}
    else:
        assert (robot.lower[0], robot.upper[0]) == expected
        assert robot.continuous == frozenset()
    assert not any("safety_controller" in words for words in robot.warnings)


@pytest.mark.parametrize(
    "attributes",
    [
        'soft_lower_limit="${low}" soft_upper_limit="1"',
        'soft_lower_limit="0" soft_upper_limit="0"',
        'soft_lower_limit="2" soft_upper_limit="3"',
        'soft_lower_limit="nan" soft_upper_limit="3"',
    ],
)
def test_soft_limits_that_make_no_sense_are_told_and_ignored(attributes):
    robot = soft(attributes)
    assert (robot.lower[0], robot.upper[0]) == (-1.0, 1.0)
    assert any("joint j" in words and "ignored" in words for words in robot.warnings)


@pytest.mark.parametrize(
    ("urdf_rates", "given", "velocity", "acceleration"),
    [
        ('velocity="2" acceleration="3" deceleration="2.5" jerk="1"', {}, 2.0, 2.5),
        ('velocity="2" acceleration="3"', {"max_acceleration": 1.5}, 2.0, 1.5),
        ('velocity="2" acceleration="1"', {"max_acceleration": 1.5, "max_velocity": 1}, 1.0, 1.0),
        ('velocity="2"', {"max_acceleration": 4, "max_deceleration": -0.5}, 2.0, 0.5),
        ('velocity="2" acceleration="0"', {"max_velocity": "!degrees 90"}, np.pi / 2, 5.0),
    ],
)
def test_the_lowest_rate_counts_of_all_that_are_stated(urdf_rates, given, velocity, acceleration):
    lines = "".join(f"    {name}: {value}\n" for name, value in given.items())
    limits = parse_joint_limits(f"joint_limits:\n  j:\n{lines}" if given else "")
    robot = soft("", limits=limits, limit=f'lower="-1" upper="1" {urdf_rates}')
    assert robot.velocity_limits[0] == pytest.approx(velocity)
    assert robot.acceleration_limits[0] == pytest.approx(acceleration)


def test_angles_of_moveit_files_may_be_in_degrees():
    text = "j: {min_position: !degrees -90, max_position: !radians 0.5}"
    assert parse_joint_limits(text) == {"j": JointLimit(pytest.approx(-np.pi / 2), 0.5)}
    for bad in ("j: {max_position: !degrees ninety}", "j: {max_position: !miles 3}", "j: {"):
        with pytest.raises(RobotError, match="`joint_limits`"):
            parse_joint_limits(bad)


@pytest.mark.parametrize(
    "stray",
    [
        "<gazebo><sensor:plugin x:y='1'/></gazebo>",
        "<xacro:property name='a' value='1'/>",
        "<unknown/>",
        "=======",
    ],
)
def test_what_urdfdom_does_not_know_is_ignored(stray):
    text = urdf(link("a", BOX), stray, link("b", BOX), joint("j", "a", "b"))
    assert list(pin.buildModelFromXML(text).names[1:]) == ["j"], "as urdfdom reads it"
    robot = Robot.from_urdf(text)
    assert (robot.joint_names, robot.geometry_links) == (("j",), ("a", "b"))
    assert any("xacro" in words for words in robot.warnings) == ("xacro" in stray)


def test_a_joint_that_mimics_nothing_known_is_one_by_itself_and_that_is_said():
    robot = Robot.from_urdf(urdf(link("a"), link("b"), joint("j", "a", "b", more=MIMIC)))
    assert robot.mimics == {}
    assert any("gone" in words and "j" in words for words in robot.warnings)


def test_the_line_of_a_merge_conflict_is_named():
    text = urdf(link("a"), "\n<<<<<<< HEAD\n", link("b"), "\n=======\n", joint("j", "a", "b"))
    with pytest.raises(RobotError, match=r"line 2 = '<<<<<<< HEAD'.*not XML"):
        Robot.from_urdf(text)
