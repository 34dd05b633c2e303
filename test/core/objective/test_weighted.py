"""Terms by geometry, their sum, what it leaves out, and what is required."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.problems import problem_of

from benchmarks.cases import Case
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.objective.by_name import make_objective, make_term
from placement_planner_ros.core.objective.objective import moved_pose, objective_gradient
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.types import Verdict
from placement_planner_ros.core.wishes.settings import WishSettings

TABLE = Case("table", "small_crayons_box", "maximize_clearance")
NEAR = (0.4, 0.1, 0.05, 0.0, 0.0, 0.0, 1.0)
ALL = ("clearance", "near", "turn", "high", "edge", "aligned", "stance", "toward_front")
WEIGHTS = (1.0, 0.5, 0.2, -0.3, 1.0, 0.4, 0.3, 0.1)


@pytest.fixture(scope="module")
def table():
    problem, _ = problem_of(TABLE)
    return problem


@pytest.fixture(scope="module")
def standing(table):
    """(n, 4, 4) free poses that stand, and the planner they were drawn by."""
    planner = planner_of(table, WishSettings(), "maximize_clearance")
    drawn = planner._search.hierarchy.sets.draws(*planner.sampler._uniform.draw(3000))
    poses = planner._search.poses
    verdicts, T = poses.verdicts(drawn.face, drawn.contact, drawn.angle)
    return T[verdicts == Verdict.FEASIBLE]


def planner_of(problem, wishes, objective="weighted", **settings):
    chosen = PlannerSettings(wishes=wishes, **settings)
    context = chosen.context(problem.environment, problem.volume, problem.body)
    made = make_objective(objective, context)
    return PlacementPlanner(problem, made, chosen, np.random.default_rng(0))


def context_of(problem, **wishes):
    chosen = PlannerSettings(wishes=WishSettings(near_pose=NEAR, **wishes))
    return chosen.context(problem.environment, problem.volume, problem.body)


def term(problem, name):
    return make_term(name, context_of(problem))


def test_each_term_is_what_it_says(table, standing):
    vertices = standing[:, :3, :3] @ table.body.vertices.T + standing[:, :3, 3:]
    near = np.linalg.norm(standing[:, :3, 3] - NEAR[:3], axis=1)
    assert term(table, "near").values(standing) == pytest.approx(-near)
    turns = [np.linalg.norm(pin.log3(T[:3, :3])) for T in standing]
    assert term(table, "turn").values(standing) == pytest.approx(-np.array(turns), abs=1e-6)
    assert term(table, "high").values(standing) == pytest.approx(vertices[:, 2].min(axis=1))
    # a box on its side of half width w, with its centre at height h, tips at atan(w / h)
    half = np.sort(np.ptp(vertices, axis=2)[:, 2] / 2)
    size = np.ptp(table.body.vertices, axis=0) / 2
    expected = []
    for T in standing:
        up = int(np.abs(T[2, :3]).argmax())
        expected.append(np.arctan2(np.delete(size, up).min(), size[up]))
    assert half.min() > 0.0
    assert term(table, "stance").values(standing) == pytest.approx(np.array(expected), abs=1e-3)


def test_edge_is_the_distance_from_where_the_table_ends(table, standing):
    """Of objects on the table itself, whose outline is x 0.139 to 0.695, y -0.426 to 0.474."""
    on = standing[np.abs(term(table, "high").values(standing)) < 0.004]
    vertices = on[:, :3, :3] @ table.body.vertices.T + on[:, :3, 3:]
    low, high = vertices[:, :2].min(axis=2), vertices[:, :2].max(axis=2)
    ends = np.array([[0.139, -0.426], [0.695, 0.474]])
    away = np.minimum(low - ends[0], ends[1] - high).min(axis=1)
    values = term(table, "edge").values(on)
    near = away < 0.15
    assert near.sum() > 20
    assert np.abs(values - np.minimum(away, 0.2))[near].max() < 0.006
    assert values.max() <= 0.2


def test_the_sum_its_gradient_and_what_it_leaves_out(table, standing):
    context = context_of(table, terms=ALL, weights=WEIGHTS)
    weighted = make_objective("weighted", context)
    some = standing[:150]
    by_hand = sum(
        weight * term(table, name).values(some) / term(table, name).scale
        for name, weight in zip(ALL, WEIGHTS, strict=True)
    )
    values = weighted.values(some)
    assert values == pytest.approx(by_hand)
    weighted.values_above(standing, -np.inf)  # learns how good estimates are
    best = float(np.quantile(values, 0.9))
    above = weighted.values_above(some, best)
    assert above[values > best] == pytest.approx(values[values > best])
    assert (above[values <= best] <= best + 1e-9).all()
    assert (above >= values - 1e-9).all()
    smooth = make_objective(
        "weighted", context_of(table, terms=("clearance", "near", "turn", "high"))
    )
    for T in some[:5]:
        x = pin.SE3(T)
        steps = [1e-4, 1e-4, 1e-4]
        differences = [
            (smooth(moved_pose(x, s * e)) - smooth(moved_pose(x, -s * e))) / (2.0 * s)
            for s, e in zip(steps, np.eye(3), strict=True)
        ]
        assert objective_gradient(smooth, x) == pytest.approx(differences, rel=0.2, abs=0.3)


@pytest.mark.parametrize("sampler", ["optimistic", "mcts"])
def test_what_is_required_is_kept_by_whatever_is_published(table, sampler):
    at_least = (-0.08, 0.05) if sampler == "optimistic" else (-0.15, 0.03)
    at = (0.45, -0.05, 0.0, 0.0, 0.0, 0.0, 1.0)
    wishes = WishSettings(required=("near", "edge"), at_least=at_least, near_pose=at)
    planner = planner_of(table, wishes, "maximize_clearance", sampler=sampler)
    placements = list(planner.run(lambda: planner.statistics.samples >= 4000))
    assert len(placements) >= 1
    for placement in placements:
        terms = dict(placement.terms)
        assert terms["near"] >= at_least[0]
        assert terms["edge"] >= at_least[1]
    assert planner.statistics.rejected["breaks_rule"] > 0


def test_bad_combinations_are_refused(table):
    with pytest.raises(ParameterError, match="`terms`"):
        planner_of(table, WishSettings())
    with pytest.raises(ParameterError, match="near_pose"):
        planner_of(table, WishSettings(terms=("near",)))
    with pytest.raises(ParameterError, match="`at_least`"):
        planner_of(table, WishSettings(required=("high",)), "maximize_clearance")
