"""Algorithm 1 on the bundled robot: every placement it yields is judged by the checker."""

import gc
import itertools
import weakref
from dataclasses import asdict, replace
from unittest import mock

import numpy as np
import pinocchio as pin
import pytest
from by_hand.verify_cases import case_checker, load_solution
from helpers.problems import problem_of

from benchmarks.cases import Case
from benchmarks.record import save_solution
from placement_planner_ros.core.errors import GraspError, ParameterError, RobotError
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.search.optimistic import OptimisticSettings
from placement_planner_ros.core.search.sampler import SamplerSettings
from placement_planner_ros.core.types import Verdict

TABLE = Case("table", "small_crayons_box", "maximize_clearance")
CABINET = Case("cabinet_low_clutter", "wine_glass", "minimize_clearance")


def plan(case=TABLE, seed=0, samples=1500, objective=None, **settings):
    problem, own = problem_of(case, seed)
    chosen = replace(PlannerSettings(), **settings)
    planner = PlacementPlanner(problem, objective or own, chosen, np.random.default_rng(seed))
    budget = lambda: planner.statistics.samples >= samples  # noqa: E731
    return planner, list(planner.run(budget))


@pytest.mark.parametrize("case", [TABLE, CABINET], ids=str)
def test_every_placement_passes_the_independent_checker(case, tmp_path):
    planner, placements = plan(case, samples=4000)
    assert len(placements) >= 2
    checker = case_checker(asdict(case))
    arms = {arm.name: arm.touch_links for arm in problem_of(case)[0].arms}
    previous = None
    for placement in placements:
        save_solution(tmp_path / "solution.npz", case, 0, placement)
        _, solution = load_solution(tmp_path / "solution.npz", arms)
        assert checker.check(solution, previous) == []
        previous = placement.objective
    assert planner.statistics.solutions == len(placements)
    assert planner.statistics.best == placements[-1].objective


@pytest.mark.parametrize(
    "settings",
    [{"sampler": "mcts"}, {"sampler": "uniform", "local_optimization": False}],
    ids=["mcts", "uniform without local optimisation"],
)
def test_the_paper_s_search_and_the_ablations_plan_too(settings):
    _, placements = plan(**settings)
    assert placements
    objectives = [p.objective for p in placements]
    assert all(b > a for a, b in itertools.pairwise(objectives))


def test_each_placement_is_better_by_what_counts():
    step = 0.01
    _, placements = plan(samples=8000, min_improvement=step)
    published = [placement.objective for placement in placements]
    assert len(published) >= 3
    assert all(b > a + step for a, b in itertools.pairwise(published))


def test_the_same_seed_and_budget_give_the_same_placements():
    first, second = (plan(samples=800)[1] for _ in range(2))
    assert [p.objective for p in first] == [p.objective for p in second]
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a.trajectory.positions, b.trajectory.positions)
    other = plan(samples=800, seed=1)[1]
    assert [p.objective for p in first] != [p.objective for p in other]


def test_what_a_run_planned_with_goes_with_it():
    """Else memory grows by an environment a run until cycles are looked for."""
    planner, _ = plan(support_region="largest")
    gone = weakref.ref(planner._poses.problem.environment)
    gc.disable()
    del planner
    kept = gone()
    gc.enable()
    assert kept is None


def test_a_black_box_objective_steers_where_things_go():
    def to_the_left(T: pin.SE3) -> float:
        return float(T.translation[1])

    _, placements = plan(objective=to_the_left, samples=3000)
    assert placements[-1].T_world_object.translation[1] > 0.25


def test_it_stops_when_told_before_any_sample():
    problem, objective = problem_of(TABLE)
    planner = PlacementPlanner(problem, objective, PlannerSettings(), np.random.default_rng(0))
    assert list(planner.run(lambda: True)) == []
    assert planner.statistics.samples == 0
    assert "no sample" in planner.explain().cause


def test_plans_stay_a_little_within_the_joint_limits():
    problem, objective = problem_of(TABLE)
    planner = PlacementPlanner(problem, objective, PlannerSettings(), np.random.default_rng(0))
    for holding in planner.holdings.values():
        real = next(arm for arm in problem.arms if arm.name == holding.arm.name)
        assert (holding.chain.lower >= real.lower + 0.9e-3).all()
        assert (holding.chain.upper <= real.upper - 0.9e-3).all()
    q = problem.q_start.copy()
    arm = problem.arms[0]
    q[arm.q_index[4]] = arm.upper[4]
    at_limit = replace(problem, q_start=q, arms=(arm,))
    planner = PlacementPlanner(at_limit, objective, PlannerSettings(), np.random.default_rng(0))
    budget = lambda: planner.statistics.samples >= 300  # noqa: E731
    for placement in planner.run(budget):
        assert np.array_equal(placement.trajectory.positions[0], q[arm.q_index])


def test_the_first_placement_comes_before_its_local_optimisation():
    # few iterations, so that no other goal is reached meanwhile
    rare = {"motion_iterations": 5, "optimistic": OptimisticSettings(uniform_first=2000)}
    with_it, without = (
        plan(seed=1, samples=4000, **rare, local_optimization=on)[1] for on in (True, False)
    )
    assert with_it[0].objective == without[0].objective
    assert with_it[1].goal.arm == with_it[0].goal.arm
    assert without[1].objective != with_it[1].objective > with_it[0].objective


def test_a_grasp_that_cannot_be_is_left_out_and_named():
    problem, objective = problem_of(TABLE)
    inside_the_wrist = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.05]))
    left, right = problem.arms

    def planner(*arms):
        changed = replace(problem, arms=arms)
        return PlacementPlanner(changed, objective, PlannerSettings(), np.random.default_rng(0))

    (words,) = planner(replace(left, grasps=(inside_the_wrist, *left.grasps)), right).unusable
    assert "`grasps[0]` of arm left" in words
    with pytest.raises(GraspError, match=r"`grasps\[0\]` of arm left"):
        planner(replace(left, grasps=(inside_the_wrist,)))


def test_without_any_grasp_a_problem_is_refused():
    problem, _ = problem_of(TABLE)
    arms = tuple(replace(arm, grasps=()) for arm in problem.arms)
    with pytest.raises(RobotError, match="at least one arm with a grasp"):
        replace(problem, arms=arms)


def test_wrong_settings_are_refused():
    with pytest.raises(ParameterError, match="choose one of optimistic, mcts, uniform"):
        PlannerSettings(sampler="ucb1")
    with pytest.raises(ParameterError, match="motion_iterations"):
        PlannerSettings(motion_iterations=0)


def test_it_stops_between_the_poses_of_a_batch():
    """Told to stop while it seeks configurations, it seeks no more."""
    problem, objective = problem_of(TABLE)
    planner = PlacementPlanner(problem, objective, PlannerSettings(), np.random.default_rng(0))
    asked = 0

    def should_stop() -> bool:
        nonlocal asked
        asked += 1
        return asked > 20

    with mock.patch.object(Holding, "configurations", return_value=Verdict.NO_IK) as sought:
        assert planner.sampler.sample_goals(-np.inf, should_stop) == []
    assert 0 < sought.call_count <= 20
    assert 0 < planner.statistics.samples < SamplerSettings().samples_per_call
