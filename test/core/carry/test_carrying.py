"""What is carried stays upright and is not jerked, all the way, by the checker's own sums."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from checker import RobotModel, Solution, Tolerances, check_carrying, check_limits, way_of_object
from helpers import few_joints
from helpers.problems import problem_of
from helpers.tasks import yumi_task

from benchmarks.cases import Case
from placement_planner_ros.core.carry.settings import CarrySettings, TiltLimit
from placement_planner_ros.core.carry.tilt import TiltConstraint
from placement_planner_ros.core.errors import StartError
from placement_planner_ros.core.grasp.start_state_check import StartRules, faults_at_start
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.wishes.settings import TurnSettings
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.scenes.yumi import start_configuration

CASE = Case("table", "wine_glass", "maximize_clearance")
UP = (0.0, 0.0, 1.0)
LIMIT = np.radians(10.0)
GENTLE = 0.8


def settings_of(max_tilt=LIMIT, max_acceleration=GENTLE, **others):
    carry = CarrySettings(max_tilt=max_tilt, max_acceleration=max_acceleration)
    return PlannerSettings(carry=carry, turns=TurnSettings(up=UP), **others)


def upright_start(problem, arm, degrees):
    """q_0 (nq,) with what that arm holds so far from upright, near the problem's own."""
    chain = Chain.from_robot(problem.robot, arm, problem.q_start)
    limit = TiltLimit(np.array(UP), np.radians(degrees))
    q = np.array(problem.q_start)
    near = TiltConstraint(chain, arm.grasps[0].rotation, limit).project(q[arm.q_index])
    assert near is not None
    q[arm.q_index] = near
    return q


@pytest.fixture(scope="module")
def glass():
    """The table, the glass in the right hand and nearly upright; and what checks it."""
    problem, objective = problem_of(CASE)
    right = problem.arms[1]
    arm = replace(right, grasps=right.grasps[1:2])
    q = upright_start(problem, arm, 5.0)
    problem = replace(problem, arms=(arm,), q_start=q)
    start = start_configuration(CASE.object)
    start |= dict(zip(arm.joints, q[arm.q_index].tolist(), strict=True))
    scene, held = scene_by_name(CASE.scene), object_by_name(CASE.object)
    task = yumi_task(scene, held, CASE.objective, q_start=start, up=np.array(UP))
    return problem, objective, Judge(task)


class Judge:
    """What of the checker is about the way of the object; all of it takes twenty seconds."""

    def __init__(self, task):
        self.task = replace(task, max_tilt=LIMIT, max_acceleration=GENTLE)
        self.robot = RobotModel.read(task.urdf, task.srdf, task.package_dirs)
        self.q = self.robot.configuration(task.q_start)
        strength = PlannerSettings().timing.acceleration_limits[0]
        self.tolerances = Tolerances(acceleration_limit=strength)

    def faults(self, placement, arm):
        solution = Solution.of(placement, arm)
        return [
            *check_limits(self.robot, solution.trajectory, self.tolerances),
            *check_carrying(self.robot, self.task, solution, self.q, self.tolerances),
        ]

    def way(self, placement, arm):
        return way_of_object(self.robot, self.task, Solution.of(placement, arm), self.q)


def found(problem, objective, settings, number):
    planner = PlacementPlanner(problem, objective, settings, np.random.default_rng(0))
    search = planner.run(lambda: planner.statistics.samples >= 3000)
    return list(itertools.islice(search, number))


def test_what_is_published_keeps_both_limits(glass):
    problem, objective, judge = glass
    arm = problem.arms[0]
    placements = found(problem, objective, settings_of(), 2)
    assert len(placements) == 2
    for placement in placements:
        assert judge.faults(placement, arm) == []
        way = judge.way(placement, arm)
        assert 0.2 * LIMIT < way.tilt <= LIMIT
        assert 0.8 * GENTLE < way.acceleration <= GENTLE
        np.testing.assert_array_equal(placement.trajectory.velocities[-1], 0.0)


def test_a_start_that_leans_more_is_refused_with_the_angle(glass):
    problem, objective, _ = glass
    settings = settings_of(np.radians(2.0))
    tilt = settings.tilt
    with pytest.raises(StartError, match=r"(?s)`up` is [2-5]\.\d° .*`max_tilt` 2\.0°"):
        PlacementPlanner(problem, objective, settings, np.random.default_rng(0))
    collision = settings.collision
    args = problem.robot, problem.arms, problem.q_start, problem.body
    with pytest.raises(StartError, match=r"(?s)`up` is [2-5]\.\d° .*`max_tilt` 2\.0°"):
        faults_at_start(*args, StartRules(collision, tilt=tilt))
    assert faults_at_start(*args, StartRules(collision)) == ()


def test_of_several_grasps_those_that_lean_more_are_left_out(glass):
    problem, objective, _ = glass
    turned = problem.arms[0].grasps[0].copy()
    turned.rotation = turned.rotation @ np.diag([1.0, -1.0, -1.0])
    arm = replace(problem.arms[0], grasps=(*problem.arms[0].grasps, turned))
    planner = PlacementPlanner(
        replace(problem, arms=(arm,)), objective, settings_of(), np.random.default_rng(0)
    )
    assert list(planner.holdings) == [("right", 0)]
    (words,) = planner.unusable
    assert "right with grasp 1: `up` is 17" in words


def test_the_limit_is_named_where_it_leaves_no_way(glass):
    """Told to stop as soon as there is a goal."""
    problem, objective, _ = glass
    q = upright_start(problem, problem.arms[0], 0.05)
    tight = settings_of(np.radians(0.1), 0.0)
    planner = PlacementPlanner(
        replace(problem, q_start=q), objective, tight, np.random.default_rng(0)
    )
    assert not list(planner.run(lambda: planner.motion.goals > 0))
    told = planner.explain()
    assert "no motion to any of them" in told.cause
    (remedy,) = [each for each in told.remedies if each.parameter == "max_tilt"]
    assert "0.002 rad are set" in remedy.words


@pytest.mark.parametrize(
    ("name", "grasp"), [("five", few_joints.FROM_ASIDE), ("scara", few_joints.FROM_ABOVE)]
)
def test_arms_of_few_joints_keep_both_limits(name, grasp):
    scene = few_joints.table()
    problem, objective, task = few_joints.made(name, grasp, scene, few_joints.environment_of(scene))
    arm = problem.arms[0]
    chain = Chain.from_robot(problem.robot, arm, problem.q_start)
    at_start = chain.forward(problem.q_start[arm.q_index])[:3, :3] @ grasp.rotation
    up = at_start[2].round()  # of the object's axes the one that points up
    carry = CarrySettings(max_tilt=LIMIT, max_acceleration=GENTLE)
    settings = PlannerSettings(carry=carry, turns=TurnSettings(up=tuple(up.tolist())))
    placements = found(problem, objective, settings, 1)
    assert Judge(replace(task, up=up)).faults(placements[0], arm) == []
