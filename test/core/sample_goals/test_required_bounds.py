"""What required terms are at most in cells: never less than at any pose of them."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.problems import problem_of

from benchmarks.cases import Case
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.terms import term_ends
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.sample_goals.remainder import Cause
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.search.cell_layout import halved_cells
from placement_planner_ros.core.search.pruning import Ruling
from placement_planner_ros.core.types import LEVEL
from placement_planner_ros.core.wishes.settings import WishSettings

SLOW = ("near", "turn", "high", "stance")
NEAR = (0.4, 0.1, 0.05, 0.5, 0.5, 0.5, 0.5)


@pytest.fixture(scope="module")
def table():
    return problem_of(Case("table", "small_crayons_box", "maximize_clearance"))[0]


@pytest.fixture(scope="module")
def sloping(table):
    """Where it rises by 6 cm in a metre to the left."""
    x, y = np.meshgrid(np.arange(0.2, 0.7, 0.004), np.arange(-0.3, 0.3, 0.004))
    points = np.column_stack([x.ravel(), y.ravel(), 0.06 * y.ravel()])
    return replace(table, environment=Environment.from_points(points, table.volume))


def planner_of(problem, required, at_least):
    wishes = WishSettings(required=required, at_least=at_least, near_pose=NEAR)
    settings = PlannerSettings(wishes=wishes)
    context = settings.context(problem.environment, problem.volume, problem.body)
    objective = make_objective("maximize_clearance", context)
    return PlacementPlanner(problem, objective, settings, np.random.default_rng(0))


@pytest.mark.parametrize("ground", ["table", "sloping"])
def test_no_pose_of_a_cell_has_more(ground, request):
    problem = request.getfixturevalue(ground)
    planner = planner_of(problem, SLOW, (-9.0,) * 4)
    search, rng = planner._search, np.random.default_rng(1)
    assert (ground == "sloping") == any(r.slope != LEVEL for r in search.hierarchy.regions)
    cells = search.hierarchy.sets.cells
    some = [cells]
    for _ in range(4):
        cells = halved_cells(cells[rng.permutation(len(cells))[:20]])
        some.append(cells)
    cells = np.concatenate(some)
    cells = cells[rng.permutation(len(cells))[:400]]
    ranges, terms = planner._bounds.ranges(cells), search.poses.required.terms_asked
    most = {name: term_ends(term, ranges)[1] for name, term, _ in terms}
    close = dict.fromkeys(SLOW, 0)
    for k, cell in enumerate(cells):
        share = rng.choice([0.0, 1.0, 0.5, 0.3], (12, 3))
        at = cell["low"] + share * (cell["high"] - cell["low"])
        draws = search.hierarchy.sets.draws(np.full(12, cell["set"]), at)
        _, T = search.poses.verdicts(draws.face, draws.contact, draws.angle, draws.slope)
        for name, term, _ in terms:
            values = term.values(T)
            assert values.max() <= most[name][k] + 1e-9
            close[name] += values.max() > most[name][k] - 0.02
    assert all(number > 5 for name, number in close.items() if ground == "table"), close


@pytest.mark.parametrize(
    ("name", "least"),
    [("high", 0.5), ("near", 0.01), ("turn", 0.01), ("stance", 1.4), ("edge", 0.25)],
)
def test_where_no_pose_reaches_it_the_search_ends_and_says_so(table, name, least):
    planner = planner_of(table, (name,), (least,))
    assert list(planner.run(lambda: planner.statistics.samples >= 5000)) == []
    assert planner.statistics.samples < 1000
    assert planner.cause is Cause.NO_SOLUTION
    rulings = set(planner._remainder.rulings)
    assert Ruling.BREAKS_RULE in rulings
    assert rulings <= {Ruling.BREAKS_RULE, Ruling.UNSUPPORTED}
    assert "every pose on the placement regions is against a rule" in planner.exhausted
    assert [each.parameter for each in planner.explain().remedies] == ["required"]
