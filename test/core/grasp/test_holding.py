"""The straight way down: a motion on which the object strays from it is not published."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from helpers.problems import problem_of

from benchmarks.cases import Case
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings

CASE = Case("table", "toy_table", "maximize_clearance")


@pytest.fixture(scope="module")
def planned():
    """A planner, a goal it reached, and who holds the object there."""
    problem, objective = problem_of(CASE)
    planner = PlacementPlanner(problem, objective, PlannerSettings(), np.random.default_rng(1))
    goal = next(planner.run(lambda: planner.statistics.samples > 5000)).goal
    return planner, goal, planner.holdings[goal.arm, goal.grasp]


def way_down(goal, holding, change):
    """(k, dof) the goal's approach with `change` (SE3, at the object) made to its middle."""
    q, way = goal.q, [goal.q]
    heights = np.linspace(0.0, 0.05, 11)[1:]
    for height in heights:
        pose = pin.SE3(goal.T_world_object)
        pose.translation = pose.translation + np.array([0.0, 0.0, height])
        share = np.sin(np.pi * height / heights[-1])
        moved = pin.exp6(share * pin.log6(change).vector)
        pose = pin.SE3(moved.rotation @ pose.rotation, pose.translation + moved.translation)
        q = holding.follow(pose, q)
        assert q is not None
        way.append(q)
    return np.array(way[::-1])


def chords(way):
    """(m, 6, dof) control points of the straight joint motions between (m + 1, dof) waypoints."""
    return np.array([np.linspace(a, b, 6) for a, b in pairwise(way)])


SIDEWAYS = [
    pin.SE3(np.eye(3), np.array([0.004, 0.0, 0.0])),
    pin.SE3(np.eye(3), np.array([0.0, -0.004, 0.0])),
    pin.SE3(pin.utils.rotate("x", 0.15), np.zeros(3)),
    pin.SE3(pin.utils.rotate("z", -0.15), np.zeros(3)),
]


def test_the_object_comes_straight_down_as_planned(planned):
    _, goal, holding = planned
    x = goal.T_world_object
    assert holding.comes_straight_down(chords(goal.approach), x)
    assert holding.comes_straight_down(chords(way_down(goal, holding, pin.SE3.Identity())), x)


def test_nor_where_it_goes_below_its_pose(planned):
    _, goal, holding = planned
    below = pin.SE3(goal.T_world_object)
    below.translation = below.translation - np.array([0.0, 0.0, 0.004])
    q = holding.follow(below, goal.q)
    assert not holding.comes_straight_down(chords([goal.q, q]), goal.T_world_object)


def test_a_motion_that_strays_is_not_published(planned):
    planner, goal, holding = planned

    def made(approach):
        path = np.array([approach[0], approach[0]])
        timed = replace(goal, approach=approach)
        return planner._trajectories.make(path, timed, holding, lambda: False)

    assert made(goal.approach) is not None
    assert made(way_down(goal, holding, pin.SE3.Identity())) is not None
    for change in SIDEWAYS:
        assert made(way_down(goal, holding, change)) is None
