"""The gap is never less than what can still be had: bounds of cells against poses, and runs."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.problems import problem_of
from helpers.tilts import tilted_problem

from benchmarks.cases import Case
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.clearance import thinned_points
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.search.cell_layout import bisected_cells
from placement_planner_ros.core.search.pruning import Ruling
from placement_planner_ros.core.search.uniform import UniformPoses
from placement_planner_ros.core.types import TargetVolume, Verdict
from placement_planner_ros.core.wishes.settings import WishSettings

WISHES = WishSettings(
    terms=("clearance", "near", "turn", "high", "edge"),
    weights=(1.0, 0.5, -0.2, 0.3, -0.4),
    near_pose=(0.4, 0.1, 0.05, 0.5, 0.5, 0.5, 0.5),
)
OBJECTIVES = ("maximize_clearance", "minimize_clearance", "weighted")


def planner_of(problem, objective, **settings) -> PlacementPlanner:
    made = PlannerSettings(wishes=WISHES, **settings)
    context = made.context(problem.environment, problem.volume, problem.body)
    return PlacementPlanner(
        problem, make_objective(objective, context), made, np.random.default_rng(0)
    )


@pytest.fixture(scope="module", params=["cabinet", "slope"])
def problem(request):
    if request.param == "cabinet":
        return problem_of(Case("cabinet_high_clutter", "small_crayons_box", OBJECTIVES[0]))[0]
    case = Case("table", "large_crayons_box", OBJECTIVES[0])
    return tilted_problem(case, 10.0, 30.0, np.random.default_rng(0), max_slope=0.26)[0]


@pytest.fixture(scope="module")
def cells(problem):
    """Of every size, and poses of each: (n,), (n, 12, 4, 4), and which of them are free."""
    planner, rng = planner_of(problem, OBJECTIVES[0]), np.random.default_rng(2)
    sets = planner._search.hierarchy.sets
    level = sets.cells[rng.permutation(len(sets))[:60]]
    found = [level]
    for _ in range(20):
        halves = bisected_cells(level, planner._bounds.turn_radius).reshape(-1, 2)
        level = halves[np.arange(len(level)), rng.integers(2, size=len(level))]
        found.append(level)
    cells = np.concatenate(found)
    share = rng.random((len(cells), 12, 3))
    share[:, :5] = share[:, :5].round()
    low, high = cells["low"][:, None], cells["high"][:, None]
    places = (low + share * (high - low)).reshape(-1, 3)
    draws = sets.draws(np.repeat(cells["set"], 12), places)
    verdicts, T = planner._poses.verdicts(draws.face, draws.contact, draws.angle, draws.slope)
    return cells, T.reshape(len(cells), 12, 4, 4), verdicts.reshape(len(cells), 12)


@pytest.mark.parametrize("name", OBJECTIVES)
def test_no_pose_of_a_cell_exceeds_its_bound(problem, cells, name):
    planner = planner_of(problem, name)
    assert planner._bounds.bounded
    values = planner._objective.values(cells[1].reshape(-1, 4, 4)).reshape(len(cells[0]), -1)
    most = planner._bounds.most(cells[0])
    assert (values.max(axis=1) <= most).all()
    rough = planner._bounds.most(cells[0], rough=True)
    assert (values.max(axis=1) <= rough + 0.02).all(), "estimates are off by 20 mm at most"
    small = slice(-60, None)  # of some millimetres and degrees
    assert name == "weighted" or np.median(most[small] - values[small].max(axis=1)) < 0.02


@pytest.mark.parametrize("shape", [(1, 1, 300), (300, 1, 1), (2, 80, 1), (12, 12, 12), (3, 3, 3)])
def test_few_of_the_points_are_so_many_and_spread(shape):
    points = 0.005 * np.indices(shape).reshape(3, -1).T
    some, size = thinned_points(points, 40), 0.005 * np.array(shape)
    assert min(len(points), 40) <= len(some) <= max(len(points) // 2, 40)
    assert (np.abs(some.mean(axis=0) - points.mean(axis=0)) <= 0.05 * size).all()
    assert (np.abs(some.std(axis=0) - points.std(axis=0)) <= 0.1 * size).all()


def test_a_cell_in_which_all_collides_holds_no_free_pose(problem, cells):
    planner = planner_of(problem, OBJECTIVES[0])
    ruled = planner._bounds.rulings(cells[0]) == Ruling.COLLIDING
    assert not (cells[2][ruled] > Verdict.COLLIDING).any()
    overlapping = planner._bounds._overlap.overlapping(planner._bounds.ranges(cells[0]))
    assert not (cells[2][overlapping] > Verdict.COLLIDING).any()
    assert overlapping.sum() > 5


@pytest.fixture(scope="module")
def small():
    """Part of a level board, 14 cm wide, with a post beside its middle."""
    problem, _ = problem_of(Case("table", "small_crayons_box", OBJECTIVES[0]))
    x, y = np.meshgrid(np.arange(0.3, 0.55, 0.004), np.arange(-0.15, 0.1, 0.004))
    board = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    x, z = np.meshgrid(np.arange(0.0, 2.0 * np.pi, 0.3), np.arange(0.0, 0.2, 0.004))
    post = np.column_stack(
        [0.40 + 0.01 * np.cos(x.ravel()), -0.02 + 0.01 * np.sin(x.ravel()), z.ravel()]
    )
    volume = TargetVolume([0.35, -0.1, -0.02], [0.49, 0.04, 0.05])
    environment = Environment.from_points(np.vstack([board, post]), volume)
    return replace(problem, environment=environment, volume=volume)


def curve_of(planner, samples):
    """ξ_best and the gap, after each of the first calls for samples."""
    found = []

    def enough():
        if planner.statistics.gap is not None:
            found.append((planner.statistics.best, planner.statistics.gap))
        return planner.statistics.samples >= samples

    return list(planner.run(enough)), found


@pytest.mark.parametrize("name", OBJECTIVES)
def test_the_gap_falls_and_is_never_less_than_what_can_be_had(small, name):
    planner = planner_of(small, name)
    poses, rng = planner._poses, np.random.default_rng(7)
    placements, found = curve_of(planner, 20_000)
    sets = planner._search.hierarchy.sets
    draws = sets.draws(*UniformPoses(planner._search.hierarchy, rng).draw(20_000))
    verdicts, T = poses.verdicts(draws.face, draws.contact, draws.angle, draws.slope)
    free = planner._objective.values(T[verdicts == Verdict.FEASIBLE])
    assert len(free) > 100
    best, gap = np.array(found).T
    assert (best + gap >= free.max()).all()
    assert (best + gap >= placements[-1].objective).all()
    for one in placements:
        assert one.gap is None or one.objective + one.gap >= free.max()
    assert (np.diff(gap) <= 1e-12).all()
    assert gap[-1] < 0.8 * gap[0]
    assert name == "weighted" or gap[-1] < 0.05
    late = planner_of(small, name)._remainder
    late.narrow(-1.0, 10**8)  # tried before the first placement: little is judged at once for them
    assert 0 < len(late._open) < 100


def test_a_run_ends_where_nothing_can_be_better(small):
    """On one level, what counts is the height alone."""
    wishes = WishSettings(terms=("high",))
    settings = PlannerSettings(wishes=wishes)
    context = settings.context(small.environment, small.volume, small.body)
    objective = make_objective("weighted", context)
    planner = PlacementPlanner(small, objective, settings, np.random.default_rng(0))
    assert list(planner.run(lambda: planner.statistics.samples >= 20_000))
    assert planner.exhausted.startswith("no placement can be better by more than")
    assert planner.statistics.samples < 20_000
    assert planner.statistics.gap == settings.min_improvement


def test_a_black_box_has_no_gap(small):
    planner = PlacementPlanner(
        small, lambda T: float(T.translation[0]), PlannerSettings(), np.random.default_rng(0)
    )
    placements = list(planner.run(lambda: planner.statistics.samples >= 1000))
    assert placements[-1].gap is None
    assert planner.statistics.gap is None
    assert planner.exhausted == ""
