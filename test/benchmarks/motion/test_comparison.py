"""`python -m benchmarks motion` on a problem of the bundled robot; joint space as OMPL sees it."""

import gc
import itertools
import weakref

import numpy as np
import pinocchio as pin
import pytest
from ompl import geometric as og

from benchmarks.motion.comparison import Workbench, compare_planners
from benchmarks.motion.ompl_planner import GoalSetPlanner
from benchmarks.motion.ompl_space import EdgeSpace
from benchmarks.motion.problems import MotionProblem, Primitive
from placement_planner_ros.core.motion.birrt import GoalSetRRTSettings
from placement_planner_ros.scenes.yumi import HOME, START_CONFIGURATION, load_yumi, yumi_arm


def wall_is_missed(a, b):
    """The wall x = 5 has its gap at y > 9."""
    if (a[0] - 5.0) * (b[0] - 5.0) > 0.0:
        return True
    return bool(a[1] + (5.0 - a[0]) / (b[0] - a[0]) * (b[1] - a[1]) > 9.0)


def square(edge_free):
    return EdgeSpace(np.zeros(2), np.full(2, 10.0), edge_free)


def goal_set_planner(information):
    return GoalSetPlanner(information, GoalSetRRTSettings(max_step=1.0), np.random.default_rng(0))


@pytest.mark.parametrize("make", [goal_set_planner, og.RRTConnect])
def test_planners_of_ompl_ask_the_edge_test_and_reach_any_of_the_goals(make):
    asked = []

    def edge_free(a, b):
        asked.append((a.copy(), b.copy()))
        return wall_is_missed(a, b)

    space = square(edge_free)
    goals = [[9.0, 1.0], [9.0, 5.0]]
    if make is goal_set_planner:  # RRTConnect would stay with the first
        goals.insert(0, [5.0, 2.0])  # lies in the wall
    path = space.planner(make, np.array([1.0, 1.0]), [np.array(q) for q in goals])(60.0)
    assert path[0].tolist() == [1.0, 1.0]
    assert path[-1].tolist() in goals[-2:]
    assert all(wall_is_missed(a, b) for a, b in itertools.pairwise(path))
    assert space.edges == len(asked) > 0


@pytest.mark.parametrize("make", [goal_set_planner, og.RRTConnect])
def test_planners_of_ompl_end_when_told(make):
    space = square(lambda a, b: False)
    solve = space.planner(make, np.array([1.0, 1.0]), [np.array([9.0, 1.0])])
    assert solve(lambda: space.edges >= 20) is None
    assert space.edges >= 20


def test_ompl_does_not_keep_the_edge_test_alive():
    class Test:
        def __call__(self, a, b):
            return True

    test = Test()
    gone = weakref.ref(test)
    space = square(test)
    assert len(space.simplified(np.array([[1.0, 1.0], [2.0, 5.0], [3.0, 1.0]]))) >= 2
    del space, test
    gc.collect()
    assert gone() is None


@pytest.fixture(scope="module")
def problem():
    robot = load_yumi()
    arm = yumi_arm(robot, "left")
    away = Primitive(
        "post", "box", (0.05, 0.05, 0.6), pin.SE3(np.eye(3), np.array([0.3, 0.3, 0.2]))
    )
    q_goal = robot.configuration(HOME)[arm.q_index]
    q_start = robot.configuration(START_CONFIGURATION)
    return MotionProblem("yumi/post", robot, arm, q_start, q_goal, (away,), ())


def test_the_search_and_the_planner_of_ompl_over_it_find_the_same_path(problem):
    bench = Workbench(problem)
    for seed in range(2):
        own, by_ompl = bench.goal_set_rrt(seed), bench.goal_set_planner(seed)
        np.testing.assert_array_equal(by_ompl.path, own.path)
        assert by_ompl.edges == own.edges > 1


def test_the_comparison_tells_every_planner_and_both_ways_of_shortening(problem):
    told = []
    assert compare_planners([problem], range(2), 1, 60.0, told.append)
    assert "[1/1, 0 s left] yumi/post" in told[0]
    rows = [line.split(" | ") for line in told[1].splitlines()[2:]]
    assert [row[0].removeprefix("| ") for row in rows] == [
        "goal-set RRT",
        "the same as a planner of OMPL",
        "OMPL RRTConnect",
        f"the same, {GoalSetRRTSettings().max_step:g} rad steps",
    ]
    assert all(row[1] == "2 of 2" for row in rows)
    assert "simplifyMax" in told[2]


def test_a_problem_that_is_not_solved_is_told_and_counted(problem):
    told = []
    assert not compare_planners([problem], [0], 1, 0.0, told.append)
    assert told[0].count("FAILED") >= 2
    assert "0 of 1" in told[1]
