"""What start says of the robot as it stands, against what the search would find."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from placement_planner_ros.core.collision.arm import ArmCollision, CollisionSettings
from placement_planner_ros.core.collision.load import Held
from placement_planner_ros.core.errors import GraspError, StartError
from placement_planner_ros.core.grasp.at_start import faults_at_start
from placement_planner_ros.core.robot.moving_arm import MovingArm
from placement_planner_ros.experiments.cases import Case, make_problem

SETTINGS = CollisionSettings()


@pytest.fixture(scope="module")
def problem():
    case = Case("table", "small_crayons_box", "maximize_clearance")
    return make_problem(case, np.random.default_rng(0))[0]


def faults(problem, arms=None, q=None, obstacles=None):
    q = problem.q_start if q is None else q
    return faults_at_start(
        problem.robot, arms or problem.arms, q, problem.body, SETTINGS, obstacles
    )


def test_a_robot_that_can_begin_has_no_fault(problem):
    assert faults(problem) == ()


@pytest.mark.parametrize("known", [False, True])
def test_it_judges_as_the_search_does(problem, known):
    arm = replace(problem.arms[0], grasps=problem.arms[0].grasps[:1])
    moving = MovingArm(problem.robot, arm, problem.q_start)
    obstacles = problem.environment.obstacles
    collision = ArmCollision(moving, Held(problem.body, 0), obstacles, SETTINGS)
    judge = collision if known else collision.with_pairs(lambda a, b: True, environment=False)
    rng = np.random.default_rng(1)
    found, in_cloud, uncertain = [], 0, 0
    for _ in range(300):
        q = problem.q_start.copy()
        q[arm.q_index] = rng.uniform(arm.lower, arm.upper)
        try:
            said = faults(problem, (arm,), q, obstacles if known else None)
        except StartError as error:
            found.append(False)
            in_cloud += "with the clouds" in str(error)
        else:
            assert said == ()
            found.append(True)
        free = judge.free(q[arm.q_index])
        assert found[-1] or not free
        uncertain += found[-1] and not free
    assert 20 < sum(found) < 280
    assert (in_cloud > 5) == known
    assert uncertain <= 6


def test_a_robot_that_meets_itself_is_refused_with_the_links(problem):
    q = problem.q_start.copy()
    for arm in problem.arms:
        q[arm.q_index] = 0.0
    with pytest.raises(StartError, match=r"left: in self-collision: \w+ meets \w+"):
        faults(problem, q=q)


def test_one_arm_beyond_its_limits_is_a_note_and_all_of_them_a_fault(problem):
    left, right = problem.arms
    q = problem.q_start.copy()
    q[left.q_index[0]] = left.lower[0] - 0.1
    (said,) = faults(problem, q=q)
    assert said.startswith(f"left: beyond the joint limits: {left.joints[0]} = ")
    q[right.q_index[0]] = right.lower[0] - 0.1
    with pytest.raises(StartError) as caught:
        faults(problem, q=q)
    assert left.joints[0] in str(caught.value)
    assert right.joints[0] in str(caught.value)


def test_a_bad_grasp_among_others_is_a_note_and_all_of_them_a_fault(problem):
    left = problem.arms[0]
    in_palm = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.02]))
    bare = replace(left, touch_links=())
    (said,) = faults(problem, (replace(bare, grasps=(in_palm,)), problem.arms[1]))
    assert "left.grasps[0]" in said
    assert "lies in" in said
    with pytest.raises(GraspError, match="touch_links"):
        faults(problem, (replace(bare, grasps=(in_palm,)),))
