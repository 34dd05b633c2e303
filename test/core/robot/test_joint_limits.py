"""What MoveIt states of joints, what is assumed without, and what is said of it."""

import numpy as np
import pytest

from placement_planner_ros.core.errors import ParameterError, RobotError
from placement_planner_ros.core.robot.announcement import announce_arm
from placement_planner_ros.core.robot.joint_limits import JointLimit, read_joint_limits
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.timing.trajectory_maker import TimingSettings


def joint(name, parent, child, kind="revolute", limit='lower="-2" upper="2" velocity="1"'):
    limit = f'<limit {limit} effort="1"/>' if limit else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="0 0 1"/>{limit}</joint>'
    )


FOOT = """<link name="foot">
  <collision><geometry><sphere radius="0.1"/></geometry></collision></link>"""


def tower(limits=None, more=""):
    """A lift that carries an arm of two joints and a head, and a hand with a finger."""
    links = FOOT + "".join(f'<link name="{n}"/>' for n in "abchf")
    return Robot.from_urdf(
        f'<robot name="tower">{links}'
        + joint("lift", "foot", "a", "prismatic", 'lower="0" upper="0.4" velocity="0.1"')
        + joint("swing", "a", "b")
        + joint("spin", "b", "c", "continuous", "")
        + joint("head", "a", "h")
        + joint("finger", "c", "f", "prismatic", 'lower="0" upper="0.1" velocity="0.1"')
        + f"{more}</robot>",
        joint_limits=limits,
    )


def test_the_narrower_limit_counts_and_accelerations_are_taken():
    robot = tower(
        {
            "swing": JointLimit(-1.0, 3.0, 5.0, 7.0),
            "spin": JointLimit(velocity=0.3),
            "head": JointLimit(velocity=0.2),
            "ghost": JointLimit(),
        }
    )
    i = robot.index("swing")
    assert (robot.lower[i], robot.upper[i]) == (-1.0, 2.0)
    assert robot.velocity_limits[i] == 1.0
    assert robot.acceleration_limits[i] == 7.0
    assert robot.velocity_limits[robot.index("spin")] == 0.3
    assert robot.velocity_limits[robot.index("head")] == 0.2
    assert any("ghost" in warning for warning in robot.warnings)
    assert robot.continuous == {"spin"}


def test_a_range_makes_an_endless_joint_a_limited_one():
    robot = tower({"spin": JointLimit(-1.0, 1.0)})
    assert robot.continuous == frozenset()
    assert robot.upper[robot.index("spin")] == 1.0
    with pytest.raises(RobotError, match=r"joint swing = .*`joint_limits`"):
        tower({"swing": JointLimit(2.5, 3.0)})


def test_what_nobody_states_is_assumed_by_the_kind_of_joint():
    robot = tower({"swing": JointLimit(acceleration=3.0)})
    assert {joint: what for joint, what in robot.assumed.items() if what} == {
        "lift": ("acceleration",),
        "spin": ("velocity", "acceleration"),
        "head": ("acceleration",),
        "finger": ("acceleration",),
    }
    np.testing.assert_array_equal(robot.velocity_limits, [0.1, 1.0, 1.0, 1.0, 0.1])
    arm = robot.arm("arm", "c")
    np.testing.assert_array_equal(arm.acceleration, [0.5, 3.0, 5.0])


def test_limits_that_are_set_count_instead_of_what_is_stated_or_assumed():
    arm = tower({"swing": JointLimit(acceleration=3.0)}).arm("arm", "c")
    np.testing.assert_array_equal(TimingSettings().accelerations(arm), [0.5, 3.0, 5.0])
    of_all = TimingSettings(acceleration_limits=(2.0,)).accelerations(arm)
    np.testing.assert_array_equal(of_all, [2.0, 2.0, 2.0])
    each = TimingSettings(acceleration_limits=(1.0, 2.0, 9.0)).accelerations(arm)
    np.testing.assert_array_equal(each, [1.0, 2.0, 9.0])
    with pytest.raises(ParameterError, match="give one value, or 3 for arm arm"):
        TimingSettings(acceleration_limits=(1.0, 2.0)).accelerations(arm)


@pytest.mark.parametrize("levels", [(), ("joint_limits",), ("a", "joint_limits")])
def test_moveit_files_are_read_with_and_without_the_levels_around(levels):
    given = {"j": {"max_acceleration": 2, "has_velocity_limits": False, "max_velocity": 1.0}}
    for level in reversed(levels):
        given = {("robot_description_planning" if level == "a" else level): given}
    assert read_joint_limits(given) == {"j": JointLimit(acceleration=2.0)}
    assert read_joint_limits(None) == {}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("text", "joint_limits"),
        ([1], "joint_limits"),
        ({"joint_limits": {"j": "fast"}}, "j = 'fast'"),
        ({"j": {"max_velocity": "fast"}}, r"j\.max_velocity = 'fast'"),
        ({"j": {"max_velocity": True}}, r"j\.max_velocity = True"),
        ({"j": {"max_velocity": 0.0}}, r"j\.max_velocity = 0"),
        ({"j": {"max_acceleration": float("inf")}}, r"j\.max_acceleration = inf"),
    ],
)
def test_other_files_are_refused_with_the_place(given, message):
    with pytest.raises(RobotError, match=message):
        read_joint_limits(given)


def test_a_torso_is_announced_with_what_it_moves_and_the_way_to_leave_it_out():
    robot = tower()
    arm = robot.arm("arm", "c")
    torso, limits = announce_arm(robot, arm, derived=True, accelerations=True)
    assert "lift, which moves head too" in torso
    assert "arm.joints: [swing, spin]" in torso
    assert "a controller of all 3 joints" in torso
    same, without = announce_arm(robot, arm, derived=True, accelerations=False)
    assert same == torso
    assert "velocity limit 1 rad/s of spin" in limits
    assert "velocity limit 1 rad/s of spin" in without
    assert "acceleration limit 0.5 m/s^2 of lift" in limits
    assert "acceleration limit" not in without


def test_joints_that_move_together_have_limits_that_fit_each_other():
    """A lift of two stages: what the second does is the first's; a head that rises with both."""
    links = FOOT + "".join(f'<link name="{n}"/>' for n in "abcd")
    stages = joint("first", "foot", "a", "prismatic", 'lower="0" upper="0.4" velocity="0.1"')
    second = joint("second", "a", "b", "prismatic", 'lower="0" upper="0.15" velocity="0.1"')
    follows = '<mimic joint="first" multiplier="0.5" offset="0.01"/></joint>'
    second = second.replace("</joint>", follows)
    head = joint("head", "foot", "d", "prismatic").replace("</joint>", follows)
    text = f'<robot name="lift">{links}{stages}{second}{joint("swing", "b", "c")}{head}</robot>'
    robot = Robot.from_urdf(text)
    arm = robot.arm("arm", "c")
    assert arm.joints == ("first", "second", "swing")
    np.testing.assert_allclose(arm.upper[:2], [0.28, 0.15])
    np.testing.assert_allclose(arm.lower[:2], [0.0, 0.01])
    np.testing.assert_array_equal(arm.ties, [[1, 0, 0.5, 0.01]])
    assert robot.arm("arm", "c", joints=["swing"]).joints == ("swing",)
    with pytest.raises(RobotError, match=r"second.*mimics first.*\['swing'\]"):
        robot.arm("arm", "c", joints=["first", "swing"])
    seen = Robot.from_urdf(text.replace('<link name="d"/>', FOOT.replace("foot", "d")))
    with pytest.raises(RobotError, match=r"head.*mimics first.*\['swing'\]"):
        seen.arm("arm", "c")
