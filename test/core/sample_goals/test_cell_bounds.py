"""Bounds of cells against sampled poses, and against every column of the map and every arm."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.cells import cells_across, some_pose_stands, unsupported_by
from helpers.tilts import slope_of, tilted_problem

from benchmarks.cases import Case
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.types import LEVEL, TargetVolume

FOOTING = PlannerSettings().footing
TILTS = {"level": (0.0, 0.0), "steep": (14.0, -2.0)}


@pytest.fixture(scope="module", params=TILTS.values(), ids=TILTS.keys())
def made(request):
    degrees, azimuth = request.param
    scene = "table" if degrees else "cabinet_low_clutter"
    case = Case(scene, "large_crayons_box", "maximize_clearance")
    problem, _ = tilted_problem(case, degrees, azimuth, np.random.default_rng(0), max_slope=0.26)
    planner = PlacementPlanner(problem, lambda T: 0.0, PlannerSettings(), np.random.default_rng(0))
    if degrees:
        slopes = {region.slope for region in problem.environment.regions}
        assert slope_of(degrees, azimuth) == pytest.approx(min(slopes - {LEVEL}), abs=1e-3)
    return problem, planner


@pytest.fixture(scope="module")
def cells(made):
    problem, _ = made
    regions, faces = problem.environment.regions, len(problem.body.faces)
    return cells_across(regions, faces, np.random.default_rng(1), 1500, [0.0, 0.005, 0.05, 0.3])


@pytest.mark.parametrize("margin", [0.0, 0.015])
def test_no_cell_with_a_stable_pose_is_unsupported_whatever_the_edge_margin(made, cells, margin):
    problem, planner = made
    sets, cells = cells
    settings = planner._settings.collision
    poses = PoseConstraints(
        problem, settings, replace(PlannerSettings(), edge_margin=margin).footing, 0.0
    )
    unsupported = unsupported_by(poses, sets, cells)
    stable = some_pose_stands(poses, sets, cells)
    assert not (stable & unsupported).any()
    assert stable.sum() > 30
    assert unsupported.sum() > 50


def test_no_cell_with_a_pose_in_any_of_several_boxes_is_ruled_out(made, cells):
    problem, planner = made
    sets, cells = cells
    low, high = problem.volume.lower, problem.volume.upper
    size = 0.3 * (high - low)
    heights = np.array([low[2], 0.5 * (low[2] + high[2])])
    lower = np.array([low, low + np.array([0.2, 0.5, 0.0]), [*(low[:2] + 0.1), heights[1]]])
    upper = lower + size
    upper[:2, 2] = heights[1]
    several = replace(problem, volume=TargetVolume(lower, upper))
    poses = PoseConstraints(several, planner._settings.collision, FOOTING, 0.0)
    unsupported = unsupported_by(poses, sets, cells)
    everywhere = PoseConstraints(problem, planner._settings.collision, FOOTING, 0.0)
    one = unsupported_by(everywhere, sets, cells)
    assert not (one & ~unsupported).any()
    assert (unsupported & ~one).sum() > 100
    stable = some_pose_stands(poses, sets, cells)
    assert not (stable & unsupported).any()
    assert stable.sum() > 20
