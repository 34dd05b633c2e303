"""Boxes to keep out of: as obstacles, taken out of regions, and in what is published."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from by_hand.verify_cases import case_checker
from checker import Solution, SolutionChecker, Tolerances
from helpers.problems import problem_of

from benchmarks.cases import Case
from placement_planner_ros.core.errors import StartError
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.scene.keep_out import cut, kept_out
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.types import Verdict

TABLE = Case("table", "small_crayons_box", "maximize_clearance")
HALF = (0.1, 0.0, -0.05, 0.75, 0.6, 0.6)
"""The left half of the table."""


@pytest.fixture(scope="module")
def table():
    return problem_of(TABLE)


def planner_of(made, keep_out, **settings):
    problem, objective = made
    chosen = PlannerSettings(keep_out=keep_out, **settings)
    return PlacementPlanner(problem, objective, chosen, np.random.default_rng(0))


def test_the_surface_of_a_box_is_closed_and_carries_nothing(table):
    obstacles = table[0].environment.obstacles
    box = np.array([[[0.2, -0.1, -0.05], [0.4, 0.2, 0.3]]])
    low, high = obstacles.bounds
    made = kept_out(obstacles, box, low - 0.3, high + 0.3)
    new = made.barred
    assert new.sum() == len(made) - len(obstacles) > 0
    assert (made.tops()[new] == np.inf).all()
    assert (made.tops()[~new] == obstacles.upper[:, 2]).all()
    # any segment from the middle of the box to outside meets a box of the shell
    rng = np.random.default_rng(0)
    middle = box[0].mean(axis=0)
    for direction in rng.normal(size=(50, 3)):
        reach = np.min(0.5 * (box[0, 1] - box[0, 0]) / np.abs(direction))
        point = middle + direction * reach * (1.0 - 1e-6)
        assert ((made.lower[new] <= point) & (made.upper[new] >= point)).all(axis=1).any()


def test_regions_lose_what_lies_in_a_box():
    region = Region(np.array([[0.0, 0.0, 0.4, 0.4]]), 0.0)
    (left,) = cut((region,), np.array([[[0.1, 0.1, -0.1], [0.2, 0.3, 0.1]]]))
    assert left.area == pytest.approx(0.16 - 0.02)
    points = np.array([left.sample(np.random.default_rng(k)) for k in range(200)])
    inside = (points[:, :2] > [0.1, 0.1]) & (points[:, :2] < [0.2, 0.3])
    assert not inside.all(axis=1).any()
    assert cut((region,), np.array([[[-1.0, -1.0, 0.1], [1.0, 1.0, 0.2]]])) == (region,)
    assert cut((region,), np.array([[[-1.0, -1.0, -0.1], [1.0, 1.0, 0.2]]])) == ()


def test_what_is_published_keeps_the_margin_from_it_all_the_way(table):
    planner = planner_of(table, HALF)
    placements = list(planner.run(lambda: planner.statistics.samples >= 1500))
    assert len(placements) >= 1
    judge = case_checker(asdict(TABLE))
    task = replace(judge.task, keep_out=np.array(HALF).reshape(1, 2, 3))
    checker = SolutionChecker(task, Tolerances(acceleration_limit=5.0))
    arms = {arm.name: arm for arm in table[0].arms}
    for placement in {placements[0], placements[-1]}:
        solution = Solution.of(placement, arms[placement.arm])
        assert checker.check(solution) == []


def test_without_the_rule_the_checker_and_the_search_disagree(table):
    """The same solution is refused once the box lies where the object stands."""
    planner = planner_of(table, ())
    placement = next(planner.run(lambda: False))
    x, y, z = placement.T_world_object.translation
    judge = case_checker(asdict(TABLE))
    box = np.array([[[x - 0.01, y - 0.01, z - 0.01], [x + 0.01, y + 0.01, z + 0.01]]])
    checker = SolutionChecker(replace(judge.task, keep_out=box))

    arm = {arm.name: arm for arm in table[0].arms}[placement.arm]
    assert any("margin: object" in found for found in checker.check(Solution.of(placement, arm)))
    other = planner_of(table, tuple(box.ravel().tolist()))
    poses = other._search.poses
    assert not poses.free(placement.T_world_object, placement.goal.contact)


def test_an_object_wholly_inside_a_box_is_not_free(table):
    planner = planner_of(table, ())
    placement = next(planner.run(lambda: False))
    at = placement.T_world_object.translation
    box = np.concatenate([at - 0.4, at + 0.4])
    environment = table[0].environment.keeping_out(box.reshape(1, 2, 3), at - 5.0, at + 5.0)
    assert environment.regions != table[0].environment.regions
    poses = planner._search.poses
    other = type(poses)(
        replace(table[0], environment=environment),
        planner._settings.collision,
        planner._settings.footing,
        0.02,
    )
    goal = placement.goal
    assert not other.free(placement.T_world_object, goal.contact)
    angles, contacts = np.zeros(1), at[None]
    assert other.verdicts(np.array([goal.face]), contacts, angles)[0][0] != Verdict.FEASIBLE


def test_a_start_inside_is_refused_whether_or_not_its_sides_are_near(table):
    problem, _ = table
    for box in ((-5.0, -5.0, -5.0, 5.0, 5.0, 5.0), (0.2, -0.6, 0.0, 0.9, 0.6, 0.9)):
        with pytest.raises(StartError, match="keep_out"):
            planner_of(table, box)
    assert problem.environment.keep_out.shape == (0, 2, 3)
