"""Cells that are ruled out hold nothing, and a search of which nothing is left says so and why."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.search.cell_layout import LOWER, UPPER, halved, whole_cells
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.search.pruning import Cause, Remainder, Ruling
from placement_planner_ros.core.types import TargetVolume, Verdict
from placement_planner_ros.experiments.cases import Case, make_problem
from placement_planner_ros.experiments.yardstick.placement_grid import (
    GridResolution,
    grid_placements,
)

CASE = Case("cabinet_low_clutter", "large_crayons_box", "maximize_clearance")


@pytest.fixture(scope="module")
def cabinet():
    return make_problem(CASE, np.random.default_rng(0))


def hierarchy(problem) -> AfrHierarchy:
    return AfrHierarchy(
        [1], len(problem.body.faces), problem.environment.regions, PlannerSettings().hierarchy
    )


def random_cells(problem, rng: np.random.Generator) -> np.ndarray:
    """Cells of every size: each whole one, and one branch of its parts per cell down to leaves."""
    level = whole_cells(hierarchy(problem))
    cells = [level]
    for _ in range(6):
        parts = halved(level).reshape(len(level), 8, -1)
        level = parts[np.arange(len(level)), rng.integers(8, size=len(level))]
        cells.append(level)
    return np.concatenate(cells)


def poses_in(cells: np.ndarray, rng: np.random.Generator, of_each: int):
    """Faces, contacts and angles of random poses, as many of each cell, its corners among them."""
    low, high = cells[:, None, LOWER], cells[:, None, UPPER]
    share = rng.random((len(cells), of_each, 3))
    share[:, : of_each // 2] = share[:, : of_each // 2].round()
    place = low + share * (high - low)
    faces = np.repeat(cells[:, 0].astype(np.int64), of_each)
    z = np.repeat(cells[:, 1], of_each)
    flat = place.reshape(-1, 3)
    return faces, np.column_stack([flat[:, :2], z]), flat[:, 2]


def planner_of(problem, objective, prune=True) -> PlacementPlanner:
    settings = PlannerSettings()
    settings = replace(settings, optimistic=replace(settings.optimistic, prune=prune))
    return PlacementPlanner(problem, objective, settings, np.random.default_rng(0))


@pytest.fixture(scope="module")
def sampled(cabinet):
    """Random cells, and random poses of each of them."""
    problem, _ = cabinet
    rng = np.random.default_rng(0)
    cells = random_cells(problem, rng)
    return cells, poses_in(cells, rng, 16)


def test_no_pose_of_a_cell_out_of_reach_is_reachable(cabinet, sampled):
    problem, objective = cabinet
    cells, poses = sampled
    planner = planner_of(problem, objective)
    rulings = planner._bounds.rulings(cells)
    assert set(rulings) == set(Ruling)
    _, T = planner.sampler._checker._poses.verdicts(*poses)
    T = T.reshape(len(cells), -1, 4, 4)
    reached = np.zeros(T.shape[:2], dtype=bool)
    for holding in planner.holdings.values():
        tips = T @ holding.arm.grasps[holding.grasp].inverse().homogeneous
        flat = holding._ik.reachable_batch(tips.reshape(-1, 4, 4))
        reached |= flat.reshape(reached.shape)
    assert reached.any()
    assert not reached[rulings == Ruling.OUT_OF_REACH].any()
    small = slice(-len(whole_cells(hierarchy(problem))), None)
    beyond = ~reached[small].any(axis=1)
    assert (rulings[small][beyond] == Ruling.OUT_OF_REACH).mean() > 0.5  # the bound is not idle


def test_no_pose_of_an_unsupported_cell_is_stable(cabinet, sampled):
    problem, objective = cabinet
    cells, poses = sampled
    planner = planner_of(problem, objective)
    rulings = planner._bounds.rulings(cells)
    verdicts, _ = planner.sampler._checker._poses.verdicts(*poses)
    stable = verdicts.reshape(len(cells), -1) > Verdict.UNSTABLE
    assert stable.any()
    assert not stable[rulings == Ruling.UNSUPPORTED].any()
    small = slice(-len(whole_cells(hierarchy(problem))), None)
    never = ~stable[small].any(axis=1) & (rulings[small] != Ruling.OUT_OF_REACH)
    assert (rulings[small][never] == Ruling.UNSUPPORTED).mean() > 0.5


def test_no_stable_and_free_pose_of_a_grid_lies_in_an_unsupported_cell(cabinet):
    problem, objective = cabinet
    planner = planner_of(problem, objective)
    resolution = GridResolution(0.03, math.radians(30.0))
    found = grid_placements(problem, resolution, PlannerSettings())
    assert len(found.face) > 100
    level = whole_cells(hierarchy(problem))
    out = []
    for _ in range(3):
        rulings = planner._bounds.rulings(level)
        out.append(level[rulings == Ruling.UNSUPPORTED])
        level = halved(level[rulings == Ruling.OPEN])
    cells = np.concatenate(out)
    assert len(cells) > 100
    place = np.column_stack([found.contact[:, :2], found.angle + 1e-9])  # on no cell's border
    for face, z in {*zip(cells[:, 0], cells[:, 1], strict=True)}:
        here = cells[(cells[:, :2] == (face, z)).all(axis=1)]
        x = place[(found.face == face) & (found.contact[:, 2] == z)][:, None]
        assert not ((here[:, LOWER] < x) & (x < here[:, UPPER])).all(axis=-1).any()


def around(volume):
    return volume.lower - 0.3, volume.upper + 0.5


def moved_away(problem, shift):
    """The same problem with V and all that is in it elsewhere."""
    volume = TargetVolume(problem.volume.lower + shift, problem.volume.upper + shift)
    x, y = (np.arange(a, b, 0.005) for a, b in np.column_stack([volume.lower, volume.upper])[:2])
    points = np.array([*itertools.product(x, y, [volume.lower[2] + 0.03])])
    environment = Environment.from_points(points, volume, bounds=around(volume))
    return replace(problem, volume=volume, environment=environment)


def planned(problem, prune=True, samples=2000):
    context = ObjectiveContext(problem.environment, problem.volume, problem.body)
    planner = planner_of(problem, make_objective("maximize_clearance", context), prune)
    return planner, list(planner.run(lambda: planner.statistics.samples >= samples))


def test_a_volume_out_of_reach_ends_the_search_at_once_and_says_why(cabinet):
    far = moved_away(cabinet[0], np.array([2.0, 0.0, 0.0]))
    planner, placements = planned(far)
    assert placements == []
    assert "out of reach of every arm" in planner.exhausted
    assert "move target_volume closer" in planner.exhausted
    assert "support" not in planner.exhausted
    assert planner.cause is Cause.OUT_OF_REACH
    assert planner.statistics.samples <= planner._settings.optimistic.samples_per_call


def test_a_surface_too_small_for_every_face_ends_the_search_and_says_why(cabinet):
    problem, _ = cabinet
    middle = 0.5 * (problem.volume.lower + problem.volume.upper)
    x, y = (np.arange(m - 0.03, m + 0.03, 0.004) for m in middle[:2])
    points = np.array([*itertools.product(x, y, [middle[2]])])
    environment = Environment.from_points(points, problem.volume, bounds=around(problem.volume))
    small = replace(problem, environment=environment)
    assert environment.regions
    planner, placements = planned(small)
    assert placements == []
    assert "without support" in planner.exhausted
    assert "larger surfaces" in planner.exhausted
    assert planner.cause is Cause.UNSUPPORTED


@pytest.mark.parametrize("prune", [True, False])
def test_what_is_ruled_out_need_not_be_left_out_of_the_search(cabinet, prune):
    planner, placements = planned(cabinet[0], prune, 3500)
    assert placements
    assert planner.exhausted == ""
    assert planner.cause is None


class Bounds:
    """Rules out some faces altogether."""

    def __init__(self, *closed: int) -> None:
        self.closed = closed
        self.asked = 0

    def rulings(self, cells):
        self.asked += 1
        return np.where(np.isin(cells[:, 0], self.closed), Ruling.UNSUPPORTED, Ruling.OPEN)


def test_what_is_left_is_sought_until_a_leaf_is_found_that_may_hold_a_goal(cabinet):
    bounds = Bounds(0)
    remainder = Remainder(hierarchy(cabinet[0]), bounds)
    assert not remainder.empty()
    asked = bounds.asked
    assert 1 < asked < 100
    assert not remainder.empty()
    assert bounds.asked == asked


def test_nothing_is_left_once_every_face_is_ruled_out(cabinet):
    remainder = Remainder(hierarchy(cabinet[0]), Bounds(*range(10)))
    assert any(remainder.empty() for _ in range(1000))
    assert "without support" in remainder.why_empty()


@pytest.mark.parametrize(
    ("rulings", "cause"),
    [
        ({Ruling.OUT_OF_REACH}, Cause.OUT_OF_REACH),
        ({Ruling.UNSUPPORTED}, Cause.UNSUPPORTED),
        ({Ruling.UNSUPPORTED, Ruling.OUT_OF_REACH}, Cause.NO_SOLUTION),
        (set(), Cause.NO_SOLUTION),
    ],
    ids=str,
)
def test_one_cause_has_its_code_and_several_have_none(cabinet, rulings, cause):
    remainder = Remainder(hierarchy(cabinet[0]), Bounds())
    remainder.rulings |= rulings
    assert remainder.cause is cause
