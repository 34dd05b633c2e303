"""SampleGoals: the check that failed first, goals that are as drawn, how far estimates are off."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from helpers.pose_sets import placement_pose
from helpers.problems import problem_of

from benchmarks.cases import Case
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.sample_goals.goals import Wanted, _contact_of
from placement_planner_ros.core.scene.regions import RegionPoints
from placement_planner_ros.core.search.sampler import Draws
from placement_planner_ros.core.types import Verdict

SAMPLES = 6000


def free_poses(problem, finder, rng):
    """(n, 4, 4) uniform poses at which the object stands stable and free."""
    regions = problem.environment.regions
    area = np.array([region.area for region in regions])
    chosen = rng.choice(len(area), size=SAMPLES, p=area / area.sum())
    contacts = RegionPoints(regions).sample(chosen, rng)
    faces = rng.integers(len(problem.body.faces), size=SAMPLES)
    angles = rng.uniform(0.0, 2.0 * np.pi, SAMPLES)
    verdicts, T = finder._poses.verdicts(faces, contacts, angles)
    return T[verdicts == Verdict.FEASIBLE]


@pytest.mark.parametrize(
    ("scene", "thing"),
    [
        ("cabinet_low_clutter", "small_crayons_box"),
        ("cabinet_high_clutter", "wine_glass"),
        ("table", "small_crayons_box"),
    ],
)
def test_estimates_are_off_by_millimetres(scene, thing):
    """With the objects of which they are off the most: so much better a pose may be passed over."""
    problem, _ = problem_of(Case(scene, thing, "maximize_clearance"))
    context = ObjectiveContext(problem.environment, problem.volume, problem.body)
    for name in ("maximize_clearance", "minimize_clearance"):
        objective = make_objective(name, context)
        planner = PlacementPlanner(problem, objective, PlannerSettings(), np.random.default_rng(0))
        finder = planner.sampler._checker
        T = free_poses(problem, finder, np.random.default_rng(1))
        off = np.abs(finder._values(T, -np.inf) - objective.values(T))
        assert len(T) > 500
        assert 0.0 < off.max() < 0.002


TABLE = Case("table", "small_crayons_box", "maximize_clearance")


def never():
    return False


@pytest.fixture(scope="module")
def made():
    """Problem, objective, a planner that samples uniformly, and some of its draws."""
    problem, objective = problem_of(TABLE)
    settings = PlannerSettings()
    settings = replace(settings, sampler="uniform", uniform=replace(settings.uniform, batch=400))
    planner = PlacementPlanner(problem, objective, settings, np.random.default_rng(0))
    return problem, objective, planner, planner.sampler._draw(-np.inf)


@pytest.fixture(scope="module")
def checked(made):
    _, _, planner, draws = made
    return planner.sampler._checker.check_batch(draws, -np.inf, 10_000, never)


def rows(draws, first, last=None):
    part = slice(first, last)
    names = "arm", "grasp", "face", "contact", "angle", "slope"
    return Draws(*(getattr(draws, name)[part] for name in names))


def test_goals_are_what_was_drawn(made, checked):
    problem, objective, planner, draws = made
    at = np.flatnonzero(checked.verdicts == Verdict.FEASIBLE)
    assert len(at) == len(checked.goals) > 5
    goals = {goal.objective: goal for goal in checked.goals}
    for row in at:
        goal = goals[checked.values[row]]
        face = int(draws.face[row])
        expected = placement_pose(problem.body.faces[face], draws.contact[row], draws.angle[row])
        assert goal.T_world_object.isApprox(expected, 1e-9)
        assert goal.face == face
        assert goal.contact_height == draws.contact[row, 2]
        assert goal.arm == problem.arms[draws.arm[row]].name
        assert goal.grasp == draws.grasp[row]
        assert goal.objective == pytest.approx(objective(expected))
        reached = planner.holdings[goal.arm, goal.grasp].object_pose(goal.q)
        assert np.abs(reached.homogeneous - expected.homogeneous).max() < 1e-3


def test_a_batch_ends_with_the_last_goal_that_is_wanted(made, checked):
    _, _, planner, draws = made
    for wanted in (1, 3):
        outcome = planner.sampler._checker.check_batch(draws, -np.inf, wanted, never)
        assert len(outcome.goals) == (outcome.verdicts == Verdict.FEASIBLE).sum() == wanted
        tried = outcome.usable & (outcome.verdicts > Verdict.NOT_BETTER)
        assert tried.sum() < (checked.usable & (checked.verdicts > Verdict.NOT_BETTER)).sum()
        assert (outcome.values[checked.verdicts < Verdict.NOT_BETTER] == -np.inf).all()
    stopped = planner.sampler._checker.check_batch(draws, -np.inf, 1, lambda: True)
    assert (stopped.verdicts[stopped.usable] <= Verdict.NOT_BETTER).all()
    assert not stopped.goals


def test_poses_are_reached_for_in_the_order_of_their_draws(made, checked):
    _, _, planner, draws = made
    outcome = planner.sampler._checker.check_batch(draws, -np.inf, 1, never)
    last = int(np.flatnonzero(outcome.verdicts == Verdict.FEASIBLE)[0])
    better = np.flatnonzero(checked.usable)
    tried = np.flatnonzero(outcome.usable & (outcome.verdicts > Verdict.NOT_BETTER))
    assert tried.tolist() == better[better <= last].tolist()


def test_what_no_hand_can_place_is_not_reached_for(made):
    """Free poses of which the tip alone decides are told apart at once, and rightly."""
    problem, _, planner, _ = made
    finder, told = planner.sampler._checker, []
    for draws in (planner.sampler._draw(-np.inf) for _ in range(30)):
        verdicts, T = finder._poses.verdicts(draws.face, draws.contact, draws.angle)
        free = np.flatnonzero(verdicts == Verdict.FEASIBLE)
        firsts = finder._first_verdicts(draws, free, T, free >= 0).max(axis=1)
        # Of what is no better it is told, as of any, whether one of all hands can.
        anyone = replace(draws, arm=np.full_like(draws.arm, -1))
        both = [finder._first_verdicts(anyone, free, T, b).max(1) for b in (free < 0, free >= 0)]
        assert both[0].tolist() == both[1].tolist()
        for row in free[firsts[free] != Verdict.FEASIBLE]:
            if told.count(firsts[row]) < 40:
                told.append(firsts[row])
                holding = planner.holdings[problem.arms[draws.arm[row]].name, draws.grasp[row]]
                wanted = Wanted(_contact_of(draws, row), pin.SE3(T[row]), 0.0)
                assert isinstance(*finder._tries(holding, wanted, -np.inf), Verdict)
    assert {int(Verdict.NO_IK), *range(Verdict.ARM_COLLIDING, Verdict.NO_RETREAT)} == set(told)


def test_only_what_beats_the_best_value_is_reached_for(made, checked):
    _, _, planner, draws = made
    values = checked.values[checked.values > -np.inf]
    assert len(values) > 30
    for best in (*np.quantile(values, [0.3, 0.7]), values.max()):
        outcome = planner.sampler._checker.check_batch(draws, float(best), 10_000, never)
        assert ((outcome.verdicts > Verdict.NOT_BETTER) == (checked.values > best)).all()
        assert all(goal.objective > best for goal in outcome.goals)
        cheap = checked.verdicts < Verdict.NOT_BETTER
        assert (outcome.verdicts[cheap] == checked.verdicts[cheap]).all()
