"""Cells that are ruled out hold nothing, and a search of which nothing is left says so and why."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from helpers.problems import problem_of

from benchmarks.cases import Case
from benchmarks.yardstick.placement_grid import (
    GridResolution,
    grid_placements,
)
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.sample_goals.placed_cells import PlacedCells
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.search.cell_layout import (
    LOWER,
    UPPER,
    X,
    areas,
    halved,
    whole_cells,
)
from placement_planner_ros.core.search.hierarchy import AfrHierarchy, HierarchySettings
from placement_planner_ros.core.search.pruning import Cause, Remainder, Ruling
from placement_planner_ros.core.types import TargetVolume, Verdict

CASE = Case("cabinet_low_clutter", "large_crayons_box", "maximize_clearance")


@pytest.fixture(scope="module")
def cabinet():
    return problem_of(CASE)


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


def tip_poses(robot, q_rest, arm, Q):
    """T_world_tip (SE3) at each of Q (n, dof), by pinocchio."""
    data, tip, q = robot.model.createData(), robot.frame_id(arm.tip_frame), q_rest.copy()
    for x in Q:
        q[arm.q_index] = x
        pin.forwardKinematics(robot.model, data, q)
        yield pin.SE3(pin.updateFramePlacement(robot.model, data, tip))


def cell_around(face, contact, angle, rng):
    """A cell of random size that holds that contact and angle, somewhere."""
    size = rng.choice([0.0, 0.03, 0.3]) * rng.random(2)
    turn = rng.choice([0.0, 0.1, 1.0, 1.0]) * rng.uniform(0.0, 2.0 * np.pi)
    low = np.array([*contact[:2], angle]) - rng.random(3) * [*size, turn]
    cell = np.array([face, contact[2], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    cell[LOWER], cell[UPPER] = low, low + np.array([*size, turn])
    return cell


def test_no_cell_is_out_of_reach_that_some_configuration_reaches(cabinet):
    """Objects as pinocchio puts them, each on a face of its own, with the arms stretched out."""
    problem, objective = cabinet
    rng = np.random.default_rng(4)
    faces, cells, away = [], [], []
    for arm in problem.arms:
        Q = rng.uniform(arm.lower + 0.002, arm.upper - 0.002, (4000, arm.dof))
        tips = list(tip_poses(problem.robot, problem.q_start, arm, Q))
        shoulder = problem.robot.link_pose(problem.q_start, "yumi_body").translation
        far = np.argsort([-np.linalg.norm(T.translation - shoulder) for T in tips])
        for k in (*far[:200], *rng.integers(len(tips), size=100)):
            T = tips[k] * arm.grasps[k % len(arm.grasps)]
            contact, angle = T.act(rng.uniform(-0.1, 0.1, 3)), rng.uniform(0.0, 2.0 * np.pi)
            placed = pin.SE3(pin.utils.rotate("z", angle), contact)
            faces.append(replace(problem.body.faces[0], T_face_object=placed.inverse() * T))
            cells.append(cell_around(len(faces) - 1, contact, angle, rng))
            outward = contact[:2] - shoulder[:2]
            at = np.array([*(contact[:2] + outward / np.linalg.norm(outward)), angle])
            away.append(cells[-1].copy())
            away[-1][LOWER] = away[-1][UPPER] = at
    standing = replace(problem, body=replace(problem.body, faces=tuple(faces)))
    reach = planner_of(standing, objective)._bounds._reach  # at heights where nothing else is known
    assert len(cells) == 600
    assert not reach.out_of_reach(PlacedCells(np.array(cells))).any()
    # A metre further out there is nothing but the bound to tell.
    assert reach.out_of_reach(PlacedCells(np.array(away))).mean() > 0.9


def test_cells_are_out_of_reach_where_no_configuration_takes_the_tip(cabinet, sampled):
    """The bound is not idle: it rules out most of what lies beyond all tips ever sampled."""
    problem, objective = cabinet
    cells, poses = sampled
    cells, shift = cells.copy(), 0.3  # further away than they are
    cells[:, [X, X + 1]] += shift
    planner = planner_of(problem, objective)
    rulings = planner._bounds.rulings(cells)
    assert set(rulings) == set(Ruling) - {Ruling.BREAKS_RULE}
    _, T = planner.sampler._checker._poses.verdicts(*poses)
    T = T.reshape(len(cells), -1, 4, 4)
    T[..., 0, 3] += shift
    beyond = np.ones(T.shape[:2], dtype=bool)
    rng = np.random.default_rng(5)
    for holding in planner.holdings.values():
        arm = holding.arm
        shoulder = holding.chain.joint_frames(arm.lower)[0][:3, 3]
        Q = rng.uniform(arm.lower, arm.upper, (1000, arm.dof))
        tips = tip_poses(problem.robot, problem.q_start, arm, Q)
        reach = max(np.linalg.norm(tip.translation - shoulder) for tip in tips)
        wanted = T @ arm.grasps[holding.grasp].inverse().homogeneous
        beyond &= np.linalg.norm(wanted[..., :3, 3] - shoulder, axis=-1) > reach
    small = slice(-len(whole_cells(hierarchy(problem))), None)
    never = beyond[small].all(axis=1)
    assert never.sum() > 10
    assert (rulings[small][never] == Ruling.OUT_OF_REACH).mean() > 0.5


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


def stepped(problem, lower, step):
    """The same problem on a table at height `lower` whose further half is higher by `step`."""
    volume = TargetVolume([0.25, -0.15, lower - 0.05], [0.6, 0.15, lower + 0.2])
    x, y = (a.ravel() for a in np.meshgrid(*[np.arange(-0.2, 0.7, 0.004)] * 2))
    z = np.where(x < 0.42, lower, lower + step)
    environment = Environment.from_points(np.column_stack([x, y, z]), volume, bounds=around(volume))
    return replace(problem, volume=volume, environment=environment)


@pytest.mark.parametrize(("lower", "step"), [(0.00045, 0.0027), (-0.00045, -0.0027)])
def test_support_almost_as_high_as_tolerated_is_support_to_cells_too(cabinet, lower, step):
    """Cells look it up by rounded heights."""
    problem = stepped(cabinet[0], lower, step)
    planner = planner_of(problem, lambda T: 0.0)
    rng = np.random.default_rng(3)
    cells = np.concatenate([random_cells(problem, rng) for _ in range(40)])
    verdicts, _ = planner.sampler._checker._poses.verdicts(*poses_in(cells, rng, 16))
    stable = (verdicts > Verdict.UNSTABLE).reshape(len(cells), -1)
    rulings = planner._bounds.rulings(cells)
    assert {Ruling.OPEN, Ruling.UNSUPPORTED} <= set(rulings)
    assert stable.any(axis=1).sum() > 100
    assert not stable[rulings == Ruling.UNSUPPORTED].any()


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
    assert "target_volume: move it closer" in planner.exhausted
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


@pytest.mark.parametrize("min_area", [1e-4, 0.02, 10.0])
@pytest.mark.parametrize("min_angle", [0.1, 1.6, 10.0])
def test_a_leaf_is_small_in_area_and_in_angle(cabinet, min_area, min_angle):
    problem = cabinet[0]
    settings = HierarchySettings(min_area=min_area, min_angle=min_angle)
    afr = AfrHierarchy([1], len(problem.body.faces), problem.environment.regions, settings)
    bounds = Bounds(0)
    judged = []
    ask = bounds.rulings
    bounds.rulings = lambda cells: judged.append(cells) or ask(cells)
    remainder = Remainder(afr, bounds)
    while not remainder._found:
        assert not remainder.empty()
    for number, cells in enumerate(judged):
        cells = cells[cells[:, 0] != 0]
        leaves = (areas(cells) <= min_area) & (cells[:, 7] - cells[:, 6] <= min_angle * (1 + 1e-9))
        assert leaves.any() == (number == len(judged) - 1)
        assert len(cells) <= 8


def test_one_call_looks_at_a_bounded_number_of_cells(cabinet):
    class Coarse:
        asked = 0

        def rulings(self, cells):
            self.asked += 1
            open_ones = cells[:, 7] - cells[:, 6] > 2.0 * np.pi / 40
            return np.where(open_ones, Ruling.OPEN, Ruling.OUT_OF_REACH)

    remainder = Remainder(hierarchy(cabinet[0]), Coarse())
    assert not remainder.empty()
    assert remainder._bounds.asked == 500
    assert not remainder.empty()
    assert remainder._bounds.asked == 1000


def test_nothing_is_left_once_every_face_is_ruled_out(cabinet):
    remainder = Remainder(hierarchy(cabinet[0]), Bounds(*range(10)))
    assert any(remainder.empty() for _ in range(1000))
    assert remainder.rulings == {Ruling.UNSUPPORTED}


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


class Treasures:
    """Nothing is possible but at a few poses; a cell is open where it holds one of them."""

    def __init__(self, problem, rng, count) -> None:
        regions = problem.environment.regions
        faces = rng.integers(len(problem.body.faces), size=count)
        rows = rng.integers(len(regions), size=count)
        contacts = np.array([regions[k].sample(rng) for k in rows]).reshape(-1, 3)
        self.at = np.column_stack([faces, contacts[:, 2]])
        self.place = np.column_stack([contacts[:, :2], rng.uniform(0.0, 2.0 * np.pi, count)])

    def rulings(self, cells):
        here = (cells[:, None, :2] == self.at).all(axis=-1)
        here &= (cells[:, None, LOWER] <= self.place).all(axis=-1)
        here &= (cells[:, None, UPPER] >= self.place).all(axis=-1)
        return np.where(here.any(axis=1), Ruling.OPEN, Ruling.UNSUPPORTED)


@pytest.mark.parametrize("count", [0, 1, 2, 40])
def test_something_is_left_as_long_as_one_pose_is_possible(cabinet, count):
    for seed in range(5):
        treasures = Treasures(cabinet[0], np.random.default_rng(seed), count)
        remainder = Remainder(hierarchy(cabinet[0]), treasures)
        assert any(remainder.empty() for _ in range(100)) == (count == 0)
