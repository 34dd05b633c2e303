"""Cells that are ruled out hold nothing, and a search of which nothing is left says so and why."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.objective.objective import (
    ObjectiveContext,
    make_objective,
    upper_bounds,
)
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.slope import greatest_slope
from placement_planner_ros.core.search.cell_layout import LOWER, UPPER, X, halved, whole_cells
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.search.pruning import Remainder, Ruling
from placement_planner_ros.core.types import TargetVolume, Verdict
from placement_planner_ros.experiments.cases import Case, make_problem
from placement_planner_ros.experiments.placement_grid import GridResolution, grid_placements

CASE = Case("cabinet_low_clutter", "large_crayons_box", "maximize_clearance")
SWITCHES = ("prune_reach", "prune_support", "prune_objective")
DEFAULT = tuple(switch for switch in SWITCHES if getattr(PlannerSettings().sampling, switch))


def with_pruning(*names: str) -> PlannerSettings:
    settings = PlannerSettings()
    chosen = {switch: switch in names for switch in SWITCHES}
    return replace(settings, sampling=replace(settings.sampling, **chosen))


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


def planner_of(problem, objective, *switches: str) -> PlacementPlanner:
    settings = with_pruning(*switches)
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
    cell = np.array([face, contact[2], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
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
    bounds = planner_of(standing, objective, "prune_reach")._bounds
    assert len(cells) == 600
    assert (bounds.rulings(np.array(cells), np.inf) == Ruling.OPEN).all()
    # A metre further out there is nothing but the bound to tell.
    assert (bounds.rulings(np.array(away), np.inf) == Ruling.OUT_OF_REACH).mean() > 0.9


def test_cells_are_out_of_reach_where_no_configuration_takes_the_tip(cabinet, sampled):
    """The bound is not idle: it rules out most of what lies beyond all tips ever sampled."""
    problem, objective = cabinet
    cells, poses = sampled
    cells, shift = cells.copy(), 0.3  # further away than they are
    cells[:, [X, X + 1]] += shift
    planner = planner_of(problem, objective, "prune_reach")
    rulings = planner._bounds.rulings(cells, np.inf)
    assert set(rulings) == {Ruling.OPEN, Ruling.OUT_OF_REACH}
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
    planner = planner_of(problem, objective, "prune_support")
    rulings = planner._bounds.rulings(cells, np.inf)
    assert set(rulings) == {Ruling.OPEN, Ruling.UNSUPPORTED}
    verdicts, _ = planner.sampler._checker._poses.verdicts(*poses)
    stable = verdicts.reshape(len(cells), -1) > Verdict.UNSTABLE
    assert stable.any()
    assert not stable[rulings == Ruling.UNSUPPORTED].any()
    small = slice(-len(whole_cells(hierarchy(problem))), None)
    never = ~stable[small].any(axis=1)
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
    planner = planner_of(problem, lambda T: 0.0, "prune_support")
    rng = np.random.default_rng(3)
    cells = np.concatenate([random_cells(problem, rng) for _ in range(40)])
    verdicts, _ = planner.sampler._checker._poses.verdicts(*poses_in(cells, rng, 16))
    stable = (verdicts > Verdict.UNSTABLE).reshape(len(cells), -1)
    rulings = planner._bounds.rulings(cells, np.inf)
    assert {Ruling.OPEN, Ruling.UNSUPPORTED} == set(rulings)
    assert stable.any(axis=1).sum() > 100
    assert not stable[rulings == Ruling.UNSUPPORTED].any()


@pytest.mark.parametrize("name", ["maximize_clearance", "minimize_clearance"])
def test_no_pose_of_a_cell_has_more_than_its_bound(cabinet, sampled, name):
    problem, _ = cabinet
    objective = make_objective(
        name, ObjectiveContext(problem.environment, problem.volume, problem.body)
    )
    cells, poses = sampled
    some = slice(0, None, 3)
    planner = planner_of(problem, objective, "prune_objective")
    _, T = planner.sampler._checker._poses.verdicts(*poses)
    values = objective.values(T.reshape(len(cells), -1, 4, 4)[some].reshape(-1, 4, 4))
    highest = values.reshape(len(cells[some]), -1).max(axis=1)
    ruled_out = 0
    for best in np.quantile(highest, [0.5, 0.8, 0.95]):
        rulings = planner._bounds.rulings(cells[some], best)
        assert set(rulings) <= {Ruling.OPEN, Ruling.NOT_BETTER}
        out = rulings == Ruling.NOT_BETTER
        ruled_out += out.sum()
        assert (highest[out] <= best + planner._settings.min_improvement).all()
    assert ruled_out > 0.2 * len(cells[some])


class Eastward:
    """ξ = the x of a point of the object, with the least upper bound there is."""

    point = np.array([0.1, -0.05, 0.02])

    def __call__(self, T_world_object: pin.SE3) -> float:
        return float(T_world_object.act(self.point)[0])

    def values(self, T_world_object):
        return (T_world_object[:, :3, :3] @ self.point + T_world_object[:, :3, 3])[:, 0]

    def upper_bounds(self, T_world_object, pivot, shift, turn):
        arm = (T_world_object[:, :3, :3] @ self.point + T_world_object[:, :3, 3] - pivot)[:, :2]
        angle = np.arctan2(arm[:, 1], arm[:, 0])
        nearest_east = np.maximum(np.abs(angle) - turn, 0.0)
        return pivot[:, 0] + np.linalg.norm(arm, axis=1) * np.cos(nearest_east) + shift


def test_what_an_objective_is_asked_to_bound_holds_every_pose_of_the_cell(cabinet, sampled):
    problem, _ = cabinet
    cells, poses = sampled
    planner = planner_of(problem, Eastward(), "prune_objective")
    _, T = planner.sampler._checker._poses.verdicts(*poses)
    highest = Eastward().values(T).reshape(len(cells), -1).max(axis=1)
    ruled_out = 0
    for best in np.linspace(highest.min(), highest.max(), 50):
        out = planner._bounds.rulings(cells, best) == Ruling.NOT_BETTER
        assert (highest[out] <= best + planner._settings.min_improvement).all()
        ruled_out += out.sum()
    assert ruled_out > 0.2 * 50 * len(cells)


def test_no_stable_free_and_better_pose_of_a_grid_lies_in_a_cell_ruled_out(cabinet):
    problem, objective = cabinet
    settings = PlannerSettings()
    planner = planner_of(problem, objective, "prune_support", "prune_objective")
    found = grid_placements(problem, GridResolution(0.03, math.radians(30.0)), settings)
    assert len(found.face) > 100
    for best in np.quantile(found.clearance, [0.2, 0.9]):
        level = whole_cells(hierarchy(problem))
        out = []
        for _ in range(3):
            rulings = planner._bounds.rulings(level, best)
            out.append(level[rulings != Ruling.OPEN])
            level = halved(level[rulings == Ruling.OPEN])
        cells = np.concatenate(out)
        assert len(cells) > 100
        better = found.clearance > best + settings.min_improvement
        place = np.column_stack([found.contact[:, :2], found.angle + 1e-9])  # on no cell's border
        for face, z in {*zip(cells[:, 0], cells[:, 1], strict=True)}:
            here = cells[(cells[:, :2] == (face, z)).all(axis=1)]
            x = place[better & (found.face == face) & (found.contact[:, 2] == z)][:, None]
            assert not ((here[:, LOWER] < x) & (x < here[:, UPPER])).all(axis=-1).any()


def test_clearance_at_one_height_changes_no_faster_than_its_slope(cabinet):
    field = cabinet[0].environment.clearance
    slope = greatest_slope(field)
    rng = np.random.default_rng(0)
    volume = cabinet[0].volume
    p = rng.uniform(volume.lower - 0.4, volume.upper + 0.4, (20_000, 3))
    q = p + np.column_stack([rng.normal(0.0, 0.02, (len(p), 2)), np.zeros(len(p))])
    ratio = np.abs(field.distance(p) - field.distance(q)) / np.linalg.norm(p - q, axis=1)
    assert ratio.max() <= slope + 1e-6
    assert ratio.max() > 0.5 * slope


def around(volume):
    return volume.lower - 0.3, volume.upper + 0.5


def moved_away(problem, shift):
    """The same problem with V and all that is in it elsewhere."""
    volume = TargetVolume(problem.volume.lower + shift, problem.volume.upper + shift)
    x, y = (np.arange(a, b, 0.005) for a, b in np.column_stack([volume.lower, volume.upper])[:2])
    points = np.array([*itertools.product(x, y, [volume.lower[2] + 0.03])])
    environment = Environment.from_points(points, volume, bounds=around(volume))
    return replace(problem, volume=volume, environment=environment)


def planned(problem, switches=DEFAULT, samples=2000, objective=None):
    objective = objective or make_objective(
        "maximize_clearance", ObjectiveContext(problem.environment, problem.volume, problem.body)
    )
    planner = planner_of(problem, objective, *switches)
    return planner, list(planner.run(lambda: planner.statistics.samples >= samples))


def test_a_volume_out_of_reach_ends_the_search_at_once_and_says_why(cabinet):
    far = moved_away(cabinet[0], np.array([2.0, 0.0, 0.0]))
    planner, placements = planned(far)
    assert placements == []
    assert "out of reach of every arm" in planner.exhausted
    assert "move target_volume closer" in planner.exhausted
    assert "support" not in planner.exhausted
    assert planner.statistics.samples <= planner._settings.sampling.samples_per_call
    unaware, _ = planned(far, switches=("prune_support", "prune_objective"))
    assert unaware.exhausted == ""


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
    unaware, _ = planned(small, switches=("prune_reach", "prune_objective"))
    assert unaware.exhausted == ""


class Constant:
    """ξ = 1 everywhere, with or without saying so."""

    def __call__(self, T_world_object: pin.SE3) -> float:
        return 1.0


class KnownConstant(Constant):
    def upper_bounds(self, T_world_object, pivot, shift, turn):
        return np.ones(len(T_world_object))


def test_an_objective_known_to_be_constant_ends_the_search_with_its_first_placement(cabinet):
    problem, _ = cabinet
    planner, placements = planned(problem, SWITCHES, objective=KnownConstant())
    assert len(placements) == 1
    assert "no placement better than 1 is left" in planner.exhausted
    black_box, placements = planned(problem, SWITCHES, objective=Constant())
    assert len(placements) == 1
    assert black_box.exhausted == ""
    assert black_box.statistics.samples >= 2000


@pytest.mark.parametrize("switches", [(), *((name,) for name in SWITCHES), SWITCHES])
def test_each_kind_of_pruning_can_be_switched_off(cabinet, switches):
    problem, objective = cabinet
    planner, placements = planned(problem, switches, 3500, objective)
    assert placements
    assert planner.exhausted == ""
    ruled_out = {ruling for ruling, count in planner.sampler.rulings.items() if count}
    expected = {
        "prune_reach": Ruling.OUT_OF_REACH,
        "prune_support": Ruling.UNSUPPORTED,
        "prune_objective": Ruling.NOT_BETTER,
    }
    assert ruled_out - {Ruling.OPEN} <= {expected[name] for name in switches}
    if switches == SWITCHES:
        assert Ruling.NOT_BETTER in ruled_out


def test_bounds_that_are_no_numbers_are_refused(cabinet):
    class Wrong(Constant):
        def upper_bounds(self, T_world_object, pivot, shift, turn):
            return np.full(len(T_world_object), np.nan)

    one = np.eye(4)[None]
    with pytest.raises(ParameterError, match="upper_bounds must be 1 numbers"):
        upper_bounds(Wrong(), one, np.zeros((1, 3)), np.zeros(1), np.zeros(1))


class OpenBelow:
    """Cells are open while ξ_best is below a threshold, but never for some faces."""

    def __init__(self, threshold: float) -> None:
        self.threshold = threshold
        self.asked = 0

    def rulings(self, cells, best):
        self.asked += 1
        closed = np.where(cells[:, 0] == 0, Ruling.OUT_OF_REACH, Ruling.OPEN)
        return np.where(best >= self.threshold, Ruling.NOT_BETTER, closed)


def test_what_is_left_is_sought_again_only_when_the_best_value_has_risen(cabinet):
    bounds = OpenBelow(0.5)
    remainder = Remainder(hierarchy(cabinet[0]), bounds)
    assert not remainder.empty(-np.inf)
    asked = bounds.asked
    assert asked < 100
    assert not remainder.empty(-np.inf)
    assert bounds.asked == asked
    assert not remainder.empty(0.4)
    assert bounds.asked <= asked + 1
    assert any(remainder.empty(0.5) for _ in range(1000))
    assert "no placement better than 0.5" in remainder.why_empty(0.5)


class Treasures:
    """ξ is above -1 at a few poses only; a cell is bounded by the best pose that it holds."""

    def __init__(self, problem, rng, count) -> None:
        regions = problem.environment.regions
        faces = rng.integers(len(problem.body.faces), size=count)
        contacts = np.array(
            [regions[k].sample(rng) for k in rng.integers(len(regions), size=count)]
        )
        angles = rng.uniform(0.0, 2.0 * np.pi, count)
        self.at = np.column_stack([faces, contacts[:, 2]])
        self.place = np.column_stack([contacts[:, :2], angles])
        self.value = rng.permutation(count) + 1.0

    def rulings(self, cells, best):
        here = (cells[:, None, :2] == self.at).all(axis=-1)
        here &= (cells[:, None, LOWER] <= self.place).all(axis=-1)
        here &= (cells[:, None, UPPER] >= self.place).all(axis=-1)
        bounds = np.where(here, self.value, -1.0).max(axis=1)
        return np.where(bounds <= best, Ruling.NOT_BETTER, Ruling.OPEN)


@pytest.mark.parametrize("seed", range(5))
def test_nothing_is_left_only_once_the_best_pose_has_been_found(cabinet, seed):
    treasures = Treasures(cabinet[0], np.random.default_rng(seed), 40)
    remainder = Remainder(hierarchy(cabinet[0]), treasures)
    for best in (-np.inf, *np.arange(0.5, 40.0, 0.5)):
        assert not any(remainder.empty(best) for _ in range(200)), best
    assert any(remainder.empty(40.0) for _ in range(2000))
