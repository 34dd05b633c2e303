"""Joints without end stops: any number of turns at the start, the shorter way round from there."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.problems import problem_of

from benchmarks.cases import Case
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.scenes.yumi import yumi_arm
from placement_planner_ros.share import PACKAGE, share_path

ENDLESS = ("yumi_joint_1_l", "yumi_joint_4_l", "yumi_joint_6_l")


@pytest.fixture(scope="module")
def problem():
    """The bundled case of the table for its left arm, three joints of which turn endlessly."""
    case = Case("table", "small_crayons_box", "maximize_clearance")
    original = problem_of(case)[0]
    text = share_path("urdf", "yumi.urdf").read_text(encoding="utf-8")
    for joint in ENDLESS:
        text = text.replace(
            f'<joint name="{joint}" type="revolute">', f'<joint name="{joint}" type="continuous">'
        )
    srdf = share_path("urdf", "yumi.srdf").read_text(encoding="utf-8")
    robot = Robot.from_urdf(text, {PACKAGE: share_path("urdf").parent}, srdf)
    assert robot.continuous == frozenset(ENDLESS)
    left = original.arms[0]
    arm = yumi_arm(robot, "left", left.grasps)
    return replace(original, robot=robot, arms=(arm,))


def placements(problem, turns):
    """What is found from q_0 with whole turns more in the endless joints."""
    q = problem.q_start + 2 * np.pi * np.array(turns)
    planner = PlacementPlanner(
        replace(problem, q_start=q),
        lambda x: float(x.translation[0]),
        PlannerSettings(),
        np.random.default_rng(0),
    )
    return q, list(planner.run(lambda: planner.statistics.samples >= 1500))


def turns_of(robot, values):
    turns = np.zeros(len(robot.joint_names))
    for joint, value in zip(ENDLESS, values, strict=True):
        turns[robot.index(joint)] = value
    return turns


def test_a_plan_is_the_same_from_any_number_of_turns_and_goes_on_from_them(problem):
    robot, arm = problem.robot, problem.arms[0]
    _, plain = placements(problem, turns_of(robot, (0, 0, 0)))
    turns = turns_of(robot, (3, -64, 1))
    q, turned = placements(problem, turns)
    assert len(plain) == len(turned) >= 1
    for before, after in zip(plain, turned, strict=True):
        by = 2 * np.pi * turns[arm.q_index]
        np.testing.assert_allclose(after.trajectory.positions[0], q[arm.q_index], atol=1e-10)
        for way, other in (
            (after.trajectory.positions, before.trajectory.positions),
            (after.retreat.positions, before.retreat.positions),
            (after.goal.approach, before.goal.approach),
        ):
            np.testing.assert_allclose(way, other + by, atol=1e-9)
        np.testing.assert_allclose(after.trajectory.times, before.trajectory.times, atol=1e-9)
        end = after.trajectory.positions[-1] - q[arm.q_index]
        endless = np.isin(arm.joints, ENDLESS)
        assert np.abs(end[endless]).max() <= np.pi + 0.5


def test_joints_that_turn_twice_around_take_the_shorter_way_within_their_limits(problem):
    arm = replace(problem.arms[0], turnable=("yumi_joint_4_l",))
    k = arm.joints.index("yumi_joint_4_l")
    wide = np.array(arm.upper)
    wide[k] = 2.0 * np.pi
    arm = replace(arm, lower=-wide, upper=wide)
    q = np.zeros(arm.dof)
    q[k] = 1.5 * np.pi
    Q = np.tile(q, (3, 1))
    Q[:, k] = [-0.9 * np.pi, -0.1 * np.pi, -1.9 * np.pi]
    found = arm.nearest_turns(Q, q)[:, k]
    # 1.1π and 1.9π are within ±2π; 2.1π is not, though it is nearer than 0.1π
    np.testing.assert_allclose(found, [1.1 * np.pi, 1.9 * np.pi, 0.1 * np.pi])


def test_whole_turns_are_no_way_and_are_taken_off(problem):
    robot = problem.robot
    q = problem.q_start + 2 * np.pi * turns_of(robot, (3, -64, 1))
    np.testing.assert_allclose(robot.unwound(q), robot.unwound(problem.q_start), atol=1e-9)
    assert np.abs(robot.unwound(q)[[robot.index(j) for j in ENDLESS]]).max() <= np.pi + 1e-9
    assert robot.apart(q, problem.q_start).max() < 1e-9
    other = np.array(q)
    other[robot.index("yumi_joint_2_l")] += 2 * np.pi
    assert robot.apart(q, other).max() == pytest.approx(2 * np.pi)
    near_wrap = np.array(problem.q_start)
    near_wrap[robot.index(ENDLESS[0])] = np.pi - 0.001
    beyond = np.array(near_wrap)
    beyond[robot.index(ENDLESS[0])] = -np.pi + 0.001
    assert robot.apart(near_wrap, beyond).max() == pytest.approx(0.002)
