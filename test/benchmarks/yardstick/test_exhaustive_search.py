"""The exhaustive search on a plane: it finds the best that is reached, and tells what is left."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from benchmarks.yardstick.exhaustive_search import RefinedGrid
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.search.hierarchy import AfrHierarchy, HierarchySettings
from placement_planner_ros.core.search.sampler import Outcome
from placement_planner_ros.core.types import Goal, Verdict

BEST_AT = np.array([0.05, 0.05])


class Plane:
    """An object of 2 cm on a plane; free where y < 0.3."""

    problem = SimpleNamespace(
        body=SimpleNamespace(vertices=np.array([[0.0] * 3, [0.02, 0.0, 0.0]]))
    )

    def verdicts(self, faces, contacts, angles, slopes):
        T = np.tile(np.eye(4), (len(faces), 1, 1))
        T[:, :3, 3] = contacts
        free = contacts[:, 1] < 0.3
        return np.where(free, Verdict.FEASIBLE, Verdict.COLLIDING).astype(np.int64), T


class Reach:
    """The second arm alone reaches what is beyond x = 0.1."""

    def __init__(self):
        self.tried = []

    def check_batch(self, draws, best, goals, should_stop):
        arm, contact = int(draws.arm[0]), draws.contact[0]
        self.tried.append((arm, *contact[:2]))
        value = value_at(contact)
        if arm == 0 or contact[0] < 0.1:
            return Outcome(np.array([Verdict.NO_IK]), np.array([value]), [])
        goal = Goal("b", 0, 0, pin.SE3.Identity(), 0.0, np.zeros((1, 7)), value)
        return Outcome(np.array([Verdict.FEASIBLE]), np.array([value]), [goal])


def value_at(place):
    return -float(np.hypot(*(place[:2] - BEST_AT)))


class Away:
    """ξ is minus the distance from `BEST_AT`."""

    def values(self, T):
        return -np.hypot(*(T[:, :2, 3] - BEST_AT).T)


def test_it_finds_the_best_that_is_reached_with_every_arm_and_tells_what_is_left():
    region = Region(np.array([[0.0, 0.0, 0.4, 0.4]]), 0.0)
    afr, checker = AfrHierarchy([1, 1], 1, [region], HierarchySettings()), Reach()
    grid, best = RefinedGrid(afr, checker, Plane(), Away()), -np.inf
    for _ in range(2000):
        goals = grid.sample_goals(best, lambda: False)
        best = max([best, *(goal.objective for goal in goals)])
        if grid.finished(best):
            break
    assert grid.finished(best)
    assert best == pytest.approx(-0.05, abs=0.01)
    assert grid.unreached == pytest.approx(0.0, abs=0.01)
    places = {(x, y) for _, x, y in checker.tried}
    assert {(arm, *place) for place in places for arm in (0, 1)} == set(checker.tried)
