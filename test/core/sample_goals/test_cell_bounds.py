"""Bounds of cells against sampled poses, and against every column of the map and every arm."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.tilts import slope_of, tilted_problem

from benchmarks.cases import Case
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.sample_goals.placed_cells import PlacedCells
from placement_planner_ros.core.sample_goals.support_bounds import SupportBound
from placement_planner_ros.core.search.cell_layout import LOWER, UPPER, PoseSets, sets_of
from placement_planner_ros.core.types import LEVEL, TargetVolume, Verdict

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


def every_set(regions, faces):
    """Of each face on each region."""
    rows = [(face, k, 0.0, 2.0 * np.pi) for k in range(len(regions)) for face in range(faces)]
    return PoseSets(regions, rows)


@pytest.fixture(scope="module")
def cells(made):
    """Of all sizes, on the regions and across their borders."""
    problem, _ = made
    rng = np.random.default_rng(1)
    regions, faces = problem.environment.regions, len(problem.body.faces)
    sets, rows = every_set(regions, faces), []
    for _ in range(1500):
        number = rng.integers(len(regions))
        region = regions[number]
        size = rng.choice([0.0, 0.005, 0.05, 0.3], 2) * rng.random(2)
        turn = rng.choice([0.0, 0.05, 0.5, 2.0 * np.pi])
        low = region.sample(rng)[:2] - rng.random(2) * size - rng.choice([0.0, 0.1]) * rng.random(2)
        start = rng.uniform(0.0, 2.0 * np.pi)
        low, size = np.array([*low, start]), np.array([*size, turn])
        box = np.column_stack([low, low + size]).ravel()
        rows.append([number * faces + rng.integers(faces), *box])
    return sets, np.array(rows)


@pytest.mark.parametrize("margin", [0.0, 0.015])
def test_no_cell_with_a_stable_pose_is_unsupported_whatever_the_edge_margin(made, cells, margin):
    problem, planner = made
    sets, cells = cells
    settings = planner._settings.collision
    poses = PoseConstraints(
        problem, settings, replace(PlannerSettings(), edge_margin=margin).footing, 0.0
    )
    unsupported = SupportBound(poses).unsupported(PlacedCells(sets, cells))
    rng = np.random.default_rng(4)
    times = 40
    at = np.repeat(cells, times, axis=0)
    places = at[:, LOWER] + rng.random((len(at), 3)) * (at[:, UPPER] - at[:, LOWER])
    draws = sets.draws(sets_of(at), places)
    verdicts, _ = poses.verdicts(draws.face, draws.contact, draws.angle, draws.slope)
    stable = (verdicts > Verdict.UNSTABLE).reshape(-1, times).any(axis=1)
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
    unsupported = SupportBound(poses).unsupported(PlacedCells(sets, cells))
    everywhere = PoseConstraints(problem, planner._settings.collision, FOOTING, 0.0)
    one = SupportBound(everywhere).unsupported(PlacedCells(sets, cells))
    assert not (one & ~unsupported).any()
    assert (unsupported & ~one).sum() > 100
    rng, times = np.random.default_rng(4), 40
    at = np.repeat(cells, times, axis=0)
    places = at[:, LOWER] + rng.random((len(at), 3)) * (at[:, UPPER] - at[:, LOWER])
    draws = sets.draws(sets_of(at), places)
    verdicts, _ = poses.verdicts(draws.face, draws.contact, draws.angle, draws.slope)
    stable = (verdicts > Verdict.UNSTABLE).reshape(-1, times).any(axis=1)
    assert not (stable & unsupported).any()
    assert stable.sum() > 20
