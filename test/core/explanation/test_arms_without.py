"""Rules that leave only poses which no arm reaches are named, where that is seen to be so."""

import math
from dataclasses import replace

import numpy as np
import pytest
from wishes import Request

from placement_planner_ros.core.carry.settings import CarrySettings
from placement_planner_ros.core.explanation import arms_without
from placement_planner_ros.core.explanation.arms_without import reached_without
from placement_planner_ros.core.explanation.other_rules import without_each
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.wishes.settings import TurnSettings

ON_THE_SHELF = {
    "object.up": [0.0, 0.0, 1.0],
    "object.front": [0.0, 1.0, 0.0],
    "object.front_tolerance": 0.1,
    "require_terms": ["high"],
    "require_at_least": [0.25],
}
ON_ITS_SIDE = {
    "object.up": [1.0, 0.0, 0.0],
    "object.up_tolerance": 0.4,
    "object.front": [0.0, 0.0, 1.0],
    "object.front_tolerance": 0.2,
}
SEEN = "without it an arm is seen to reach poses"


@pytest.mark.parametrize(
    ("scene", "thing", "values", "rules"),
    [
        (
            "cabinet_high_clutter",
            "small_crayons_box",
            ON_THE_SHELF,
            ["object.front", "require_terms"],
        ),
        ("table", "drill", ON_ITS_SIDE, ["object.up"]),
    ],
)
def test_rules_that_leave_arms_nothing_are_named_and_without_any_there_is_a_placement(
    scene, thing, values, rules
):
    request = Request("", scene, thing, "", values)
    planner = request.planner(0)
    assert not list(planner.run(lambda: planner.statistics.samples >= 1000))
    remedies = planner.explain().remedies
    assert [each.parameter for each in remedies[: len(rules)]] == rules
    assert [SEEN in each.words for each in remedies] == [
        each.parameter in rules for each in remedies
    ]
    for rule in rules:
        freed = replace(request, drop=rule).freed.planner(0)
        assert next(freed.run(lambda of=freed: of.statistics.samples >= 20_000))


def test_no_rule_is_named_where_arms_reach_what_keeps_it(monkeypatch):
    """However early a search ended; and none where nothing is reached without it either."""
    request = Request("", "table", "small_crayons_box", "", {"object.up": [0.0, 0.0, 1.0]})
    assert reached_without(request.planner(0)._search) == ()
    nowhere = Request("", "table", "drill", "", ON_ITS_SIDE)
    monkeypatch.setattr(arms_without, "_reached", lambda without, search: False)
    assert reached_without(nowhere.planner(0)._search) == ()


def test_without_a_limit_on_the_tilt_arms_and_rests_have_none():
    request = Request("", "table", "wine_glass", "", {})
    problem = request.planner(0)._search.problem
    settings = PlannerSettings(
        turns=TurnSettings(up=(0.0, 0.0, 1.0), up_tolerance=2.0, front=(1.0, 0.0, 0.0)),
        carry=CarrySettings(max_tilt=math.radians(100.0)),
        keep_out=(5.0, 5.0, 5.0, 6.0, 6.0, 6.0),
    )
    planner = PlacementPlanner(problem, lambda x: 0.0, settings, np.random.default_rng(0))
    search = planner._search
    assert search.poses.turns.settings.up_tolerance < 2.0
    found = {each.rule: each for each in without_each(search)}
    assert list(found) == ["keep_out", "object.front", "object.up", "carry.max_tilt"]
    tilting = found["carry.max_tilt"]
    assert tilting.settings.tilt is found["object.up"].settings.tilt is None
    assert tilting.poses.turns.settings == settings.turns
    assert found["object.up"].poses.turns.settings.up == ()
    assert found["object.front"].settings is search.settings
    assert not len(found["keep_out"].problem.environment.keep_out)
    holdings = arms_without._holdings(tilting, search)
    assert all(holding.upright is None for of_arm in holdings for holding in of_arm)
    assert arms_without._holdings(found["object.front"], search)[0] is search.finder.holdings
