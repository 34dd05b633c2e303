"""SampleGoals: the check that failed first, goals that are as drawn, what estimates may cost."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from helpers.problems import problem_of

from benchmarks.cases import Case
from placement_planner_ros.core.constraints import placement_pose
from placement_planner_ros.core.grasp.holding import Holding, PlacingMotion
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.sample_goals.goals import GoalFinder, Wanted
from placement_planner_ros.core.scene.region_points import RegionPoints
from placement_planner_ros.core.search.sampler import Draws
from placement_planner_ros.core.types import LEVEL, Verdict

SAMPLES = 6000
BLOCK = 64


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
def test_estimates_hardly_ever_skip_a_better_pose_and_save_most_of_the_work(scene, thing):
    """With the objects of which estimates are off the most; ξ_best is taken to be at quantiles."""
    problem, _ = problem_of(Case(scene, thing, "maximize_clearance"))
    context = ObjectiveContext(problem.environment, problem.volume, problem.body)
    better = skipped = computed = asked = 0
    for name in ("maximize_clearance", "minimize_clearance"):
        objective = make_objective(name, context)
        planner = PlacementPlanner(problem, objective, PlannerSettings(), np.random.default_rng(0))
        T = free_poses(problem, planner.sampler._checker, np.random.default_rng(1))
        exact = objective.values(T)
        for seed, share in enumerate((0.5, 0.8, 0.95)):
            bound = float(np.quantile(exact, share))
            planner = PlacementPlanner(
                problem, objective, PlannerSettings(), np.random.default_rng(0)
            )
            finder = planner.sampler._checker
            order = np.random.default_rng(seed).permutation(len(T))
            for first in range(0, len(T), BLOCK):
                rows = order[first : first + BLOCK]
                values = finder._values(T[rows], bound)
                hot = exact[rows] > bound
                better += int(hot.sum())
                skipped += int((hot & (values <= bound)).sum())
                assert np.array_equal(values[values > bound], exact[rows][values > bound])
                computed += int((values == exact[rows]).sum())
                asked += len(rows)
    assert better > 1000
    assert skipped <= 1e-3 * better
    assert computed < 0.5 * asked


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
    return problem, objective, planner, planner.sampler._draw(400, -np.inf)


@pytest.fixture(scope="module")
def checked(made):
    _, _, planner, draws = made
    return planner.sampler._checker.check_batch(draws, -np.inf, 10_000, never)


def rows(draws, first, last=None):
    part = slice(first, last)
    return Draws(*(getattr(draws, n)[part] for n in ("arm", "grasp", "face", "contact", "angle")))


def test_goals_are_what_was_drawn(made, checked):
    problem, objective, planner, draws = made
    at = np.flatnonzero(checked.verdicts == Verdict.FEASIBLE)
    assert len(at) == len(checked.goals) > 5
    for row, goal in zip(at, checked.goals, strict=True):
        face = int(draws.face[row])
        expected = placement_pose(problem.body.faces[face], draws.contact[row], draws.angle[row])
        assert goal.T_world_object.isApprox(expected, 1e-9)
        assert goal.face == face
        assert goal.contact_height == draws.contact[row, 2]
        assert goal.arm == problem.arms[draws.arm[row]].name
        assert goal.grasp == draws.grasp[row]
        assert goal.objective == checked.values[row] == pytest.approx(objective(expected))
        reached = planner.holdings[goal.arm, goal.grasp].object_pose(goal.q)
        assert np.abs(reached.homogeneous - expected.homogeneous).max() < 1e-3


def test_a_batch_ends_with_the_last_goal_that_is_wanted(made, checked):
    _, _, planner, draws = made
    at = np.flatnonzero(checked.verdicts == Verdict.FEASIBLE)
    for wanted in (1, 3):
        outcome = planner.sampler._checker.check_batch(draws, -np.inf, wanted, never)
        assert len(outcome.goals) == (outcome.verdicts == Verdict.FEASIBLE).sum() == wanted
        assert outcome.verdicts[-1] == Verdict.FEASIBLE
        assert len(outcome.verdicts) == len(outcome.values)
        # Seeds of the inverse kinematics differ, so that a goal may be missed, but not by much.
        assert len(outcome.verdicts) <= at[wanted + 3] + 1


def test_only_what_beats_the_best_value_is_reached_for(made, checked):
    _, _, planner, draws = made
    values = checked.values[checked.values > -np.inf]
    assert len(values) > 30
    for best in (*np.quantile(values, [0.3, 0.7]), values.max()):
        outcome = planner.sampler._checker.check_batch(draws, float(best), 10_000, never)
        judged = outcome.verdicts > Verdict.NOT_BETTER
        assert (judged == (checked.values > best)).all()
        assert all(goal.objective > best for goal in outcome.goals)
        cheap = checked.verdicts < Verdict.NOT_BETTER
        assert (outcome.verdicts[cheap] == checked.verdicts[cheap]).all()


def test_where_no_arm_is_drawn_the_furthest_that_any_gets_is_the_verdict(made, monkeypatch):
    """The others are asked until one succeeds."""
    _, _, planner, draws = made
    finder = planner.sampler._checker
    anyone = np.full(400, -1)
    free = replace(draws, arm=anyone, grasp=anyone)
    asked = []
    answers = {}

    def reach(holding, x, *_):
        asked.append((holding.arm.name, holding.grasp))
        return answers[holding.arm.name, holding.grasp]

    monkeypatch.setattr(finder, "_reach_goal", reach)
    names = list(planner.holdings)
    assert len(names) >= 2
    x = pin.SE3.Identity()
    for furthest in names:
        answers.update(dict.fromkeys(names, Verdict.NO_IK))
        answers[furthest] = Verdict.NO_RETREAT
        for _ in range(5):
            asked.clear()
            assert finder._reach_any(free, 0, x, 0.0, -np.inf, never) is Verdict.NO_RETREAT
            assert sorted(asked) == sorted(names)
    drawn = rows(draws, 0, 1)
    asked.clear()
    finder._reach_any(drawn, 0, x, 0.0, -np.inf, never)
    holding = finder.holdings[finder._first[drawn.arm[0]] + drawn.grasp[0]]
    assert asked == [(holding.arm.name, holding.grasp)]


@pytest.mark.parametrize(
    ("answers", "tried"),
    [
        ([Verdict.ARM_COLLIDING] * 3 + [None], 4),
        ([Verdict.NO_RELEASE] * 3 + [None], 4),
        ([Verdict.NO_APPROACH, None], 2),
        ([Verdict.NO_APPROACH, Verdict.NO_RELEASE, Verdict.NO_RETREAT, None], 3),
        ([Verdict.NO_RETREAT] * 4, 2),
        ([Verdict.NO_RETREAT, Verdict.NO_RELEASE], 2),
    ],
)
def test_costly_checks_are_tried_at_two_configurations_and_cheap_ones_at_all(made, answers, tried):
    finder = made[2].sampler._checker
    asked = []

    def placing_motion(q, *_):
        asked.append(int(q[0]))
        answer = answers[len(asked) - 1]
        return PlacingMotion(np.array([q, q]), None) if answer is None else answer

    holding = SimpleNamespace(
        arm=SimpleNamespace(name="arm"),
        grasp=0,
        configurations=lambda *_: np.arange(len(answers), dtype=float)[:, None],
        placing_motion=placing_motion,
    )
    wanted = Wanted(0, pin.SE3.Identity(), 0.0, LEVEL, 1.0)
    reached = finder._reach_goal(holding, wanted, True)
    assert asked == list(range(tried))
    if answers[tried - 1] is None:
        assert reached.q.tolist() == [tried - 1]
    else:
        assert reached is max(answers[:tried])


def test_calls_end_where_they_are_told_to(made, checked, monkeypatch):
    """What was checked by then counts, with the goals among it; the rest was never drawn."""
    _, _, planner, draws = made
    finder = planner.sampler._checker
    reach, reached = finder._reach_any, []

    def watched(*arguments, **options):
        answer = reach(*arguments, **options)
        reached.append(answer)
        return answer

    monkeypatch.setattr(finder, "_reach_any", watched)
    worth = np.flatnonzero(checked.values > -np.inf)
    for tried in (0, 1, 12):
        reached.clear()
        stop = lambda tried=tried: len(reached) >= tried  # noqa: E731
        outcome = finder.check_batch(draws, -np.inf, 10_000, stop)
        assert len(outcome.verdicts) == len(outcome.values) == worth[tried]
        assert len(outcome.goals) == (outcome.verdicts == Verdict.FEASIBLE).sum()
        assert (outcome.values == checked.values[: worth[tried]]).all()
        reached.clear()
        outcome = finder.check_all(draws, -np.inf, 10_000, stop)
        assert len(outcome.verdicts) == len(outcome.values) == len(outcome.terms) == tried
    first = int(np.flatnonzero(checked.verdicts == Verdict.FEASIBLE)[1])
    around = rows(draws, first - 5)
    for wanted in (1, 2):
        outcome = finder.check_all(around, -np.inf, wanted, never)
        assert len(outcome.goals) == (outcome.verdicts == Verdict.FEASIBLE).sum() == wanted
        assert outcome.verdicts[-1] == Verdict.FEASIBLE
        assert outcome.values[-1] == outcome.goals[-1].objective


def test_inverse_kinematics_comes_before_the_hand_only_where_every_check_is_made(
    made, checked, monkeypatch
):
    """The authors' reward asks whether a pose is reached, whatever the hand meets there."""
    _, _, planner, draws = made
    finder = planner.sampler._checker
    few, asked = rows(draws, 0, 60), []
    configurations = Holding.configurations

    def watched(self, x, seeds, rng, hand_first):
        asked.append(hand_first)
        return configurations(self, x, seeds, rng, hand_first)

    monkeypatch.setattr(Holding, "configurations", watched)
    finder.check_batch(few, -np.inf, 10_000, never)
    assert asked == [True] * (checked.values[:60] > -np.inf).sum()
    asked.clear()
    finder.check_all(few, -np.inf, 10_000, never)
    assert asked == [False] * 60


def test_estimates_are_doubted_by_what_they_were_off_by_at_most(made):
    """The first poses tell; later ones are computed where the estimate may be that far too low."""

    class Estimated:
        asked = 0

        def __call__(self, T):
            return float(T.translation[0])

        def values(self, T):
            self.asked += len(T)
            return T[:, 0, 3].copy()

        def estimates(self, T):
            return T[:, 0, 3] + np.where(T[:, 1, 3] > 0.5, 0.1, -0.1)

    rng = np.random.default_rng(0)
    objective = Estimated()
    finder = GoalFinder(made[2].sampler._checker._poses, [], objective, 1, rng)
    T = np.tile(np.eye(4), (64, 1, 1))
    for first in range(4):
        T[:, :2, 3] = rng.random((64, 2))
        if first == 0:
            T[:, 1, 3] *= 0.5  # all too low, by as much as some are too high later
        before = objective.asked
        values = finder._values(T, 0.7)
        computed = first < 2 or objective.estimates(T) + 0.15 > 0.7
        assert (values == np.where(computed, T[:, 0, 3], objective.estimates(T))).all()
        assert objective.asked - before == (64 if first < 2 else computed.sum())
    assert 0 < computed.sum() < 64
    before = objective.asked
    assert (finder._values(T, 2.0) == objective.estimates(T)).all()
    assert objective.asked == before


def test_every_check_of_a_sample_is_made_for_the_authors_reward(made, checked):
    _, _, planner, draws = made
    few = rows(draws, 0, 40)
    outcome = planner.sampler._checker.check_all(few, -np.inf, 10_000, never)
    assert len(outcome.terms) == 40
    for row, (reached, arm_free, free, stable) in enumerate(outcome.terms):
        verdict = outcome.verdicts[row]
        cheap = checked.verdicts[row]
        finder = planner.sampler._checker
        face, contact = int(few.face[row]), few.contact[row]
        x = placement_pose(finder._body.faces[face], contact, float(few.angle[row]))
        assert free == finder._poses.free(x, contact[2])
        assert stable == finder._poses.stable(x, face)
        assert (verdict < Verdict.NOT_BETTER) == (cheap < Verdict.NOT_BETTER)
        if cheap < Verdict.NOT_BETTER:
            assert verdict == cheap
        assert stable or verdict <= Verdict.UNSTABLE
        assert free or verdict <= Verdict.COLLIDING
        assert reached or not arm_free
        assert verdict != Verdict.FEASIBLE or (reached and arm_free and free and stable)
        if verdict == Verdict.NO_IK:
            assert not reached
    assert outcome.values == pytest.approx(
        [
            planner.sampler._checker._objective(
                placement_pose(
                    planner.sampler._checker._body.faces[int(few.face[k])],
                    few.contact[k],
                    float(few.angle[k]),
                )
            )
            for k in range(40)
        ]
    )
