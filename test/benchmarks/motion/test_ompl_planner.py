"""The goal-set search as OMPL sees it."""

from itertools import pairwise

import numpy as np
import pytest

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.motion.birrt import GoalSetRRTSettings

ob = pytest.importorskip("ompl.base")
og = pytest.importorskip("ompl.geometric")

from benchmarks.motion.ompl_planner import GoalSetPlanner  # noqa: E402


def wall_is_missed(a, b):
    """The wall x = 5 has its gap at y > 9."""
    if (a[0] - 5.0) * (b[0] - 5.0) > 0.0:
        return True
    return bool(a[1] + (5.0 - a[0]) / (b[0] - a[0]) * (b[1] - a[1]) > 9.0)


class Wall(ob.MotionValidator):
    """Counts the motions it is asked for."""

    def __init__(self, si):
        super().__init__(si)
        self.asked = 0

    def checkMotion(self, a, b, last_valid=None):
        self.asked += 1
        return wall_is_missed(a, b)


def make_space():
    space = ob.RealVectorStateSpace(2)
    bounds = ob.RealVectorBounds(2)
    bounds.setLow(0.0)
    bounds.setHigh(10.0)
    space.setBounds(bounds)
    si = ob.SpaceInformation(space)
    wall = Wall(si)
    si.setMotionValidator(wall)
    si.setStateValidityChecker(lambda state: True)
    si.setup()
    return space, si, wall


def state(space, values):
    result = space.allocState()
    for i, x in enumerate(values):
        result[i] = x
    return result


def make_planner(si, seed=0):
    return GoalSetPlanner(si, GoalSetRRTSettings(max_step=1.0), np.random.default_rng(seed))


def values(path):
    return np.array([[s[0], s[1]] for s in path.getStates()])


def test_simple_setup_drives_it():
    space, si, wall = make_space()
    setup = og.SimpleSetup(si)
    setup.setStartAndGoalStates(state(space, [1.0, 1.0]), state(space, [9.0, 1.0]))
    planner = make_planner(si)
    setup.setPlanner(planner)
    assert setup.solve(20.0).getStatus() == ob.PlannerStatus.EXACT_SOLUTION
    path = values(setup.getSolutionPath())
    np.testing.assert_array_equal(path[[0, -1]], [[1.0, 1.0], [9.0, 1.0]])
    assert all(wall_is_missed(a, b) for a, b in pairwise(path))
    assert wall.asked > 0
    setup.clear()
    assert planner.search is None
    assert setup.solve(20.0).getStatus() == ob.PlannerStatus.EXACT_SOLUTION


def test_goal_states_are_reached_one_after_the_other():
    space, si, _ = make_space()
    goals = ob.GoalStates(si)
    ends = [[9.0, 1.0], [9.0, 5.0], [1.0, 5.0]]
    for q in ends:
        goals.addState(state(space, q))
    problem = ob.ProblemDefinition(si)
    problem.addStartState(state(space, [1.0, 1.0]))
    problem.setGoal(goals)
    planner = make_planner(si)
    planner.setProblemDefinition(problem)
    planner.setup()
    reached = []
    while planner.solve(20.0).getStatus() == ob.PlannerStatus.EXACT_SOLUTION:
        reached.append(values(problem.getSolutionPath())[-1].tolist())
        if len(reached) == 2:
            planner.search.retire_goal(1)
    assert [1.0, 5.0] in reached
    assert problem.getSolutionCount() == len(reached) >= 2


def test_missing_states_are_told():
    space, si, _ = make_space()
    problem = ob.ProblemDefinition(si)
    problem.setGoalState(state(space, [9.0, 1.0]))
    planner = make_planner(si)
    planner.setProblemDefinition(problem)
    assert planner.solve(1.0).getStatus() == ob.PlannerStatus.INVALID_START


def test_other_spaces_are_refused():
    si = ob.SpaceInformation(ob.SO2StateSpace())
    with pytest.raises(ParameterError, match="si"):
        make_planner(si)
