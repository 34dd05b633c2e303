"""What start says of the robot as it stands, against what the search would find."""

import re
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from helpers.problems import problem_of

from benchmarks.cases import Case
from placement_planner_ros.core.collision.arm import ArmCollision, CollisionSettings
from placement_planner_ros.core.collision.attached_object import AttachedObject
from placement_planner_ros.core.errors import GraspError, StartError
from placement_planner_ros.core.grasp.start_state_check import StartRules, faults_at_start
from placement_planner_ros.core.robot.arm import MovingArm

SETTINGS = CollisionSettings()


@pytest.fixture(scope="module")
def problem():
    return problem_of(Case("table", "small_crayons_box", "maximize_clearance"))[0]


def faults(problem, arms=None, q=None, environment=None):
    q = problem.q_start if q is None else q
    rules = StartRules(SETTINGS, environment)
    return faults_at_start(problem.robot, arms or problem.arms, q, problem.body, rules)


def test_a_robot_that_can_begin_has_no_fault(problem):
    assert faults(problem) == ()


@pytest.mark.parametrize("known", [False, True])
def test_it_judges_as_the_search_does(problem, known):
    arm = replace(problem.arms[0], grasps=problem.arms[0].grasps[:1])
    moving = MovingArm(problem.robot, arm, problem.q_start)
    environment = problem.environment if known else None
    held, obstacles = AttachedObject(problem.body, 0), problem.environment.obstacles
    collision = ArmCollision(moving, held, obstacles, SETTINGS)
    judge = collision if known else collision.with_pairs(lambda a, b: True, environment=False)
    rng = np.random.default_rng(1)
    found, in_cloud, uncertain = [], 0, 0
    for _ in range(300):
        q = problem.q_start.copy()
        q[arm.q_index] = rng.uniform(arm.lower, arm.upper)
        try:
            said = faults(problem, (arm,), q, environment)
        except StartError as error:
            found.append(False)
            in_cloud += "with the surroundings" in str(error)
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
    with pytest.raises(StartError, match=r"left: in self-collision: \w+ meets \w+") as caught:
        faults(problem, q=q)
    met = re.findall(r"(\w+) meets (\w+), their shapes (0\.\d{4}) m", str(caught.value))
    assert met
    for first, second, deep in met:
        line = f'<disable_collisions link1="{first}" link2="{second}" reason="User"/>'
        assert line in caught.value.remedy, "what to add to the SRDF"
        assert float(deep) > 0.0
    named = {frozenset(each[:2]) for each in met}
    allowed = {*problem.robot.allowed_pairs, *(tuple(sorted(p)) for p in named)}
    assert len(allowed) == len(problem.robot.allowed_pairs) + len(named)


def test_how_far_a_joint_is_beyond_which_limit_is_told(problem):
    left = problem.arms[0]
    q = problem.q_start.copy()
    q[left.q_index[1]] = left.upper[1] + 0.0321
    (said,) = faults(problem, q=q)
    assert f"joint {left.joints[1]} = {q[left.q_index[1]]:.6g} is 0.0321 beyond its" in said


def test_a_margin_too_wide_for_where_the_robot_stands_is_named(problem):
    arms, rng = problem.arms[:1], np.random.default_rng(2)
    q, environment = problem.q_start.copy(), problem.environment
    wide = StartRules(replace(SETTINGS, collision_margin=0.1), environment)
    refusal = None
    while refusal is None:  # to where the arm is near something, but free
        q[arms[0].q_index] = rng.uniform(arms[0].lower, arms[0].upper)
        with suppress(StartError):
            faults(problem, arms, q, environment)
            try:
                faults_at_start(problem.robot, arms, q, problem.body, wide)
            except StartError as error:
                refusal = error
    assert "nearer than collision_margin = 0.1 m" in str(refusal)
    assert "lower collision_margin" in refusal.remedy
    assert "disable_collisions" not in refusal.remedy


def test_one_arm_beyond_its_limits_is_a_note_and_all_of_them_a_fault(problem):
    left, right = problem.arms
    q = problem.q_start.copy()
    q[left.q_index[0]] = left.lower[0] - 0.1
    (said,) = faults(problem, q=q)
    assert said.startswith(f"left: beyond the joint limits: joint {left.joints[0]} = ")
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
    assert "`grasps[0]` of arm left" in said
    assert "lies in" in said
    with pytest.raises(GraspError, match=r"touch_links.*`scale`"):
        faults(problem, (replace(bare, grasps=(in_palm,)),))
