"""Arms of four and five joints place: everything they publish is right by the exact checker."""

import itertools

import numpy as np
import pytest
from checker import Solution, SolutionChecker
from helpers import few_joints

from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import workspace
from placement_planner_ros.core.robot.arm import follow_masters
from placement_planner_ros.core.search.optimistic import OptimisticSettings
from placement_planner_ros.core.search.pruning import Ruling

HELD = dict.fromkeys(few_joints.ARMS[:-1], few_joints.FROM_ABOVE)
HELD |= dict.fromkeys(("five", "four aside"), few_joints.FROM_ASIDE)
TELESCOPE = "telescope"
MANY = OptimisticSettings(batch=150)


@pytest.fixture(scope="module")
def table():
    scene = few_joints.table()
    return scene, few_joints.environment_of(scene)


def planner_of(table, name, grasp=None, objective=None, **settings):
    problem, clearance, task = few_joints.made(name, HELD[name] if grasp is None else grasp, *table)
    rng = np.random.default_rng(1)
    planner = PlacementPlanner(problem, objective or clearance, PlannerSettings(**settings), rng)
    return planner, task


def face_angle(planner, goal):
    """θ of T(R_z(θ), c) · fT_o, and c."""
    face = planner._search.problem.body.faces[goal.face]
    T = goal.T_world_object * face.T_face_object.inverse()
    assert T.rotation[:, 2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    return float(np.arctan2(T.rotation[1, 0], T.rotation[0, 0])), T.translation


@pytest.mark.parametrize("name", HELD)
def test_what_is_published_is_right_and_in_no_cell_that_is_ruled_out(table, name):
    sampler = "mcts" if name == "four" else "optimistic"
    planner, task = planner_of(table, name, sampler=sampler)
    judge = SolutionChecker(task)
    arm = planner._search.problem.arms[0]
    previous = None
    for placement in itertools.islice(planner.run(lambda: planner.statistics.samples >= 600), 2):
        assert judge.check(Solution.of(placement, arm), previous) == []
        previous = placement.objective
        angle, contact = face_angle(planner, placement.goal)
        sets = planner._search.hierarchy.sets
        of = (sets.face == placement.goal.face) & (abs(sets.z - contact[2]) < 1e-6)
        cell = sets.cells[np.flatnonzero(of)[:1]]
        cell["low"] = cell["high"] = [*contact[:2], angle % (2.0 * np.pi)]
        assert planner._bounds.rulings(cell)[0] == Ruling.OPEN
    assert previous is not None
    assert planner.exhausted == ""


def test_sections_that_slide_together_are_planned_timed_and_published_as_one(table):
    problem, objective, task = few_joints.made(TELESCOPE, few_joints.FROM_ASIDE, *table)
    rng = np.random.default_rng(3)
    planner = PlacementPlanner(problem, objective, PlannerSettings(optimistic=MANY), rng)
    judge, (arm,) = SolutionChecker(task), problem.arms
    previous = None
    for placement in itertools.islice(planner.run(lambda: planner.statistics.samples >= 3000), 3):
        assert judge.check(Solution.of(placement, arm), previous) == []
        previous = placement.objective
        for way in (placement.trajectory, placement.retreat):
            moved = way.positions, way.velocities, way.accelerations
            first = [of_all[:, arm.joints.index("slide_0")] for of_all in moved]
            assert np.ptp(first[0]) > 0.0
            for name, factor, offset in (("1", 0.9, 0.005), ("2", 1.0, 0.0), ("3", 0.9, 0.005)):
                column = arm.joints.index(f"slide_{name}")
                for of_all, leads, more in zip(moved, first, (offset, 0.0, 0.0), strict=True):
                    np.testing.assert_allclose(of_all[:, column], factor * leads + more, atol=1e-9)
    assert previous is not None, planner.explain()


@pytest.mark.parametrize("name", [*HELD, TELESCOPE])
def test_all_that_moves_stays_in_the_workspace(table, name):
    problem, _, _ = few_joints.made(name, HELD.get(name, few_joints.FROM_ASIDE), *table)
    robot, (arm,) = problem.robot, problem.arms
    lower, upper = workspace(robot, (arm,), problem.q_start, problem.body, problem.volume)
    if name.startswith("gantry"):  # of 12 m of rail, and little besides
        assert (upper - lower)[1] < 6.0 < 12.0 < (upper - lower)[0]
    rng, q = np.random.default_rng(0), np.array(problem.q_start)
    carried = set(robot.model.subtrees[robot.model.getJointId(arm.joints[0])])
    for values in follow_masters(arm.ties, rng.uniform(arm.lower, arm.upper, (300, arm.dof))):
        q[arm.q_index] = values
        for thing, T in zip(robot.geometry.geometryObjects, robot.geometry_poses(q), strict=True):
            if thing.parentJoint in carried:
                ends = [thing.geometry.aabb_local.min_, thing.geometry.aabb_local.max_]
                corners = [T.act(np.choose(at, ends)) for at in np.ndindex(2, 2, 2)]
                assert ((corners >= lower) & (corners <= upper)).all()
