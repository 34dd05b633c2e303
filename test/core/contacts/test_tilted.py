"""Placements on a table off level: right by the checker, and they stay where they are put."""

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from checker import Solution, check_stance, surface_normal
from helpers.tasks import yumi_checker, yumi_task
from helpers.tilts import slope_of, tilted_problem, tilted_solids

from benchmarks.cases import Case
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.types import upright
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.scenes import scene_by_name

SCENE = scene_by_name("table")
RUNS = [
    (Case("table", "large_crayons_box", "maximize_clearance"), 3.0, 0.4),
    (Case("table", "small_crayons_box", "minimize_clearance"), 5.0, 2.2),
    (Case("table", "wine_glass", "maximize_clearance"), 2.0, -1.5),
]


@cache
def found(case, degrees, azimuth):
    """Placements of a search, and what checks them."""
    problem, objective = tilted_problem(case, degrees, azimuth, np.random.default_rng(0))
    planner = PlacementPlanner(problem, objective, PlannerSettings(), np.random.default_rng(0))
    placements = list(planner.run(lambda: planner.statistics.samples >= 4000))
    world = replace(SCENE, parts=tilted_solids(SCENE, degrees, azimuth))
    measured = problem.environment.measured
    task = yumi_task(
        world,
        object_by_name(case.object),
        case.objective,
        measured=np.array([measured.lower, measured.upper]),
    )
    # docs/limits.md: walls that lean are many runs of points, whose ends count as few
    return problem, placements, yumi_checker(task, objective=0.05)


@pytest.mark.parametrize(("case", "degrees", "azimuth"), RUNS, ids=str)
def test_what_is_published_is_right(case, degrees, azimuth):
    problem, placements, checker = found(case, degrees, azimuth)
    arms = {arm.name: arm for arm in problem.arms}
    assert len(placements) >= 2
    for previous, placement in [(None, placements[0]), tuple(placements[-2:])]:
        solution = Solution.of(placement, arms[placement.arm])
        assert checker.check(solution, previous.objective if previous else None) == []
    # they stand along the table's normal, not along gravity
    normal = upright(slope_of(degrees, azimuth))[:, 2]
    T = placements[-1].T_world_object.homogeneous
    assert surface_normal(checker.task, T, checker.tolerances) == pytest.approx(normal, abs=1e-6)
    assert placements[-1].goal.slope == pytest.approx(slope_of(degrees, azimuth), abs=1e-3)


def test_a_level_object_on_a_tilted_table_is_refused():
    """And one that is turned a little, or that hovers, or stands on no table at all."""
    _, placements, checker = found(*RUNS[0])
    T = placements[-1].T_world_object
    assert check_stance(checker.task, T.homogeneous, checker.tolerances) == []
    up = upright(slope_of(*RUNS[0][1:]))
    for wrong in (
        pin.SE3(up.T @ T.rotation, T.translation),
        pin.SE3(pin.exp3(np.array([0.03, 0.0, 0.0])) @ T.rotation, T.translation),
        pin.SE3(T.rotation, T.translation + 0.006 * up[:, 2]),
        pin.SE3(T.rotation, T.translation + 0.6 * up[:, 0]),
    ):
        said = check_stance(checker.task, wrong.homogeneous, checker.tolerances)
        assert any(words.startswith("stance:") for words in said)


@pytest.mark.parametrize(("case", "degrees", "azimuth"), RUNS, ids=str)
def test_what_is_placed_stays_where_it_is(case, degrees, azimuth):
    pytest.importorskip("mujoco")
    from helpers.settle import settle_placed

    _, placements, checker = found(case, degrees, azimuth)
    held = object_by_name(case.object)
    for placement in placements:
        result = settle_placed(checker.task.solids, held, placement.T_world_object)
        assert result.moved < 0.005
        assert result.tilted < np.deg2rad(2.0)
