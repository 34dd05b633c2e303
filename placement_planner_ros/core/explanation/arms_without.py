"""Which rules leave arms nothing that they reach: without each, some poses are tried, to see."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.explanation.other_rules import Without, standing, without_each
from placement_planner_ros.core.explanation.search import Search
from placement_planner_ros.core.grasp.feasible_grasps import usable_holdings
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.remembering import remembered_with
from placement_planner_ros.core.sample_goals.goals import GoalFinder

_TRIES = 1500
"""Of arms and grasps to reach poses, without each rule."""
_SEEDS = 16
"""Of the inverse kinematics at each."""


@remembered_with("search")
def reached_without(search: Search) -> tuple[str, ...]:
    """The rules, by their parameters, without any one of which an arm is seen to reach a pose that
    keeps all others, with its approach and retreat, where none is seen to with it."""
    without = list(without_each(search))
    as_asked = Without("", search.problem, search.settings, search.poses)
    if not without or _reached(as_asked, search):
        return ()
    return tuple(each.rule for each in without if _reached(each, search))


def _reached(without: Without, search: Search) -> bool:
    finder = GoalFinder(
        without.poses, _holdings(without, search), _alike, _SEEDS, np.random.default_rng(0)
    )
    tries = finder.rejections.tries
    for draws in standing(without.poses, search):
        if finder.check_batch(draws, -np.inf, 1, lambda: bool(tries.sum() >= _TRIES)).goals:
            return True
        if tries.sum() >= _TRIES:
            break
    return False


def _holdings(without: Without, search: Search) -> Sequence[Sequence[Holding]]:
    """Those of the search, made anew where the rule is one on arms, too."""
    if without.problem is search.problem and without.settings is search.settings:
        return [search.finder.holdings]
    return usable_holdings(without.problem, without.settings)[0]


def _alike(T_world_object: pin.SE3) -> float:
    """An objective to which all poses are alike."""
    return 0.0
