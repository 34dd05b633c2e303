"""The requests of docs/wishes.md: all can be set, some are solved, some cannot be had."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from by_hand.verify_cases import case_checker
from checker import SolutionChecker, check_asked
from helpers.wishes import requests

from placement_planner_ros.core.objective.by_name import term_names
from placement_planner_ros.core.sample_goals.remainder import Cause
from placement_planner_ros.ros.node_words import in_node_words
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.scenes import scene_by_name

ALL = requests()


def by_words(words):
    return next(request for request in ALL if words in request.words)


def test_there_are_thirty_and_ten_and_all_can_be_set():
    assert [bool(request.drop) for request in ALL] == [False] * 30 + [True] * 10
    for request in ALL:
        request.parameters.planner_settings.wishes.require_consistent()
        assert scene_by_name(request.scene)
        assert object_by_name(request.thing)
        assert set(request.freed.values) < set(request.values) or not request.drop
    used = {name for request in ALL for name in request.parameters["objective_terms"]}
    assert used == set(term_names())


@pytest.mark.parametrize("words", ["label to the left", "Near the sink"])
def test_what_is_published_keeps_what_was_asked(words):
    request = by_words(words)
    planner = request.planner(0)
    placements = list(planner.run(lambda: planner.statistics.samples >= 1500))
    assert len(placements) >= 1
    judge = case_checker(asdict(request.case))
    task = replace(judge.task, asked=request.asked)
    checker = SolutionChecker(task, judge.tolerances)
    for placement in placements:
        T, value = placement.T_world_object.homogeneous, placement.objective
        assert check_asked(task, T, value, checker.clearance_bounds, checker.tolerances) == []
    # and the checker would tell: turned by a right angle, or with another value
    turned = T.copy()
    turned[:3, :3] = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) @ T[:3, :3]
    worse = turned if request.asked.front is not None else T
    found = check_asked(task, worse, value + 3.0, checker.clearance_bounds, checker.tolerances)
    assert len(found) == 1


@pytest.mark.parametrize(
    ("words", "cause"), [("On its corner", Cause.NO_FACE), ("keep out of all", Cause.NO_REGION)]
)
def test_what_cannot_be_had_names_the_rule_without_which_it_can(words, cause):
    request = by_words(words)
    planner = request.planner(0)
    assert planner.cause is cause
    assert request.drop in in_node_words(planner.exhausted)
    freed = request.freed.planner(0)
    assert next(freed.run(lambda: freed.statistics.samples >= 1500))
