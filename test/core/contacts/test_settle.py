"""Released where the planner says, an object stays: judged by a physics engine."""

import numpy as np
import pinocchio as pin
import pytest

pytest.importorskip("mujoco")

from by_hand.settle_cases import FRICTIONS, MOVED, TILTED
from helpers.problems import problem_of
from helpers.settle import settle_placed

from benchmarks.cases import Case
from benchmarks.household import object_by_name
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.scenes.scenes import scene_by_name

CASES = (
    Case("table", "wine_glass", "maximize_clearance"),
    Case("table", "small_crayons_box", "minimize_clearance", "cameras"),
    Case("cabinet_low_clutter", "toy_table", "minimize_clearance"),
    Case("table", "banana", "maximize_clearance"),
)


def released(scene, name, T_world_object, friction=0.6):
    held, solids = object_by_name(name), scene_by_name(scene).parts
    return settle_placed(solids, held, T_world_object, friction=friction)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_what_is_placed_stays_where_it_is(case):
    problem, objective = problem_of(case)
    planner = PlacementPlanner(problem, objective, PlannerSettings(), np.random.default_rng(0))
    placements = list(planner.run(lambda: planner.statistics.samples >= 1500))
    assert placements
    for placement in placements[-1:]:
        for friction in FRICTIONS:
            result = released(case.scene, case.object, placement.T_world_object, friction)
            assert result.moved < MOVED
            assert result.tilted < TILTED


def lying(degrees=0.0, x=0.45, y=-0.05, z=0.0355):
    """A small crayons box on the table, turned about its long axis."""
    turned = pin.exp3(np.array([np.deg2rad(degrees), 0.0, 0.0]))
    return pin.SE3(turned, np.array([x, y, z]))


@pytest.mark.parametrize(
    "pose",
    [lying(degrees=25.0, z=0.045), lying(z=0.06), lying(x=0.72)],
    ids=["leaning", "in the air", "over the edge"],
)
def test_what_is_not_placed_well_does_not_stay(pose):
    result = released("table", "small_crayons_box", pose)
    assert result.moved > MOVED or result.tilted > TILTED
