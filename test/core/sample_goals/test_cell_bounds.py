"""Bounds of cells against sampled poses, and against every column of the map and every arm."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from helpers.tilts import slope_of, tilted_problem

from benchmarks.cases import Case
from placement_planner_ros.core.constraints import PoseConstraints, placement_pose
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.reach.reach_bound import ReachBound
from placement_planner_ros.core.sample_goals.placed_cells import PlacedCells
from placement_planner_ros.core.sample_goals.support_bounds import SupportBound
from placement_planner_ros.core.search.cell_layout import LOWER, SLOPE, UPPER, X, contacts
from placement_planner_ros.core.search.pruning import Ruling
from placement_planner_ros.core.types import LEVEL, TargetVolume, Verdict


def turned(cell, angle, points):
    """(m, 3) points of the face frame as they are turned where the cell's plane is sloping."""
    T = placement_pose(_FACE, np.zeros(3), angle, tuple(cell[[SLOPE, SLOPE + 1]]))
    return points @ T.rotation.T


_FACE = SimpleNamespace(T_face_object=pin.SE3.Identity())
FOOTING = PlannerSettings().footing
TILTS = {"level": (0.0, 0.0), "tilted": (4.0, 0.7), "steep": (14.0, -2.0)}


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
    """Of all sizes, on the regions and across their borders."""
    problem, _ = made
    rng = np.random.default_rng(1)
    rows = []
    for _ in range(1500):
        region = problem.environment.regions[rng.integers(len(problem.environment.regions))]
        size = rng.choice([0.0, 0.005, 0.05, 0.3], 2) * rng.random(2)
        turn = rng.choice([0.0, 0.05, 0.5, 2.0 * np.pi])
        low = region.sample(rng)[:2] - rng.random(2) * size - rng.choice([0.0, 0.1]) * rng.random(2)
        start = rng.uniform(0.0, 2.0 * np.pi)
        face = rng.integers(len(problem.body.faces))
        rows.append([face, region.z, low[0], low[0] + size[0], low[1], low[1] + size[1]])
        rows[-1] += [start, start + turn, *region.slope]
    return np.array(rows)


def test_points_of_the_body_stay_where_they_are_said_to(cells):
    rng = np.random.default_rng(2)
    points = rng.normal(size=(5, 3)) * 0.2
    placed = PlacedCells(cells)
    each = np.broadcast_to(points, (len(cells), 5, 3))
    middles, strays, rises = placed.middles(each), placed.strays(each), placed.rises(each)
    assert (placed.half == 0.5 * (cells[:, [3, 5]] - cells[:, [2, 4]])).all()
    assert (rises == 0.0).all() == (cells[:, SLOPE:] == 0.0).all()
    for row, cell in list(enumerate(cells))[::3]:
        low, high = cell[LOWER], cell[UPPER]
        center = 0.5 * (low + high)
        contact = contacts(cell[None], center[None, :2])[0]
        assert contact[2] == pytest.approx(cell[1] + cell[SLOPE:] @ center[:2])
        assert middles[row] == pytest.approx(turned(cell, center[2], points) + contact)
        within = placed.half[row] + strays[row][:, None] + 1e-12
        for x, y, angle in low + rng.random((8, 3)) * (high - low):
            at = contacts(cell[None], np.array([[x, y]]))[0]
            off = np.abs(turned(cell, angle, points) + at - middles[row])
            assert (off[:, :2] <= within).all()
            assert (off[:, 2] <= rises[row] + 1e-12).all()
        # At the ends of the interval, or half a turn away, no less would do.
        angle = min(high[2], center[2] + np.pi)
        way = turned(cell, angle, points) - turned(cell, center[2], points)
        assert np.linalg.norm(way, axis=1) == pytest.approx(strays[row], abs=1e-12)


def test_cells_are_unsupported_where_no_column_under_some_contact_has_a_surface(made, cells):
    problem, planner = made
    poses = planner.sampler._checker._poses
    body, volume = problem.body, problem.volume
    columns = {}
    for slope in {region.slope for region in problem.environment.regions}:
        support = problem.environment.support_of(slope)
        column = np.repeat(np.arange(len(support.start) - 1), np.diff(support.start))
        at = np.column_stack(np.divmod(column, support.columns[1])) * support.cell_size
        at = at + support.origin[:2]
        within = ((at >= volume.lower[:2] - 0.5) & (at <= volume.upper[:2] + 0.5)).all(axis=1)
        columns[slope] = at[within], support.height[within]
    cells = cells[::6]
    size = problem.environment.support.cell_size
    level_at = {}
    for z, slope in {(cell[1], tuple(cell[SLOPE:])) for cell in cells}:
        at, heights = columns[slope]
        for more in (0.0, 1.1e-3):
            near = np.abs(heights - z) <= poses.footing.contact_tolerance + more
            level_at[z, slope, more] = at[near]
    unsupported = planner._bounds._support.unsupported(PlacedCells(cells))
    seen = set()
    for cell, ruled_out in zip(cells, unsupported, strict=True):
        face = body.faces[int(cell[0])]
        T = face.T_face_object
        half = 0.5 * (cell[UPPER] - cell[LOWER])
        center = 0.5 * (cell[UPPER] + cell[LOWER])

        def reached(points, cell=cell, half=half, center=center):
            """Lower and upper corners of what points of the face frame stay in."""
            middle = turned(cell, center[2], points)[:, :2] + center[:2]
            turn = 2.0 * np.sin(0.5 * min(half[2], np.pi)) * np.hypot(points[:, 0], points[:, 1])
            return middle - turn[:, None] - half[:2], middle + turn[:, None] + half[:2]

        feet = face.vertices @ T.rotation.T + T.translation
        low, high = reached(feet)
        surely = maybe = True  # supported
        for a, b in zip(low, high, strict=True):
            for slack, more in ((0.0, 0.0), (5e-6, 1.1e-3)):
                near = level_at[cell[1], tuple(cell[SLOPE:]), more]
                near = ((near <= b + slack) & (near + size >= a - slack)).all(axis=1)
                if more:
                    maybe &= bool(near.any())
                else:
                    surely &= bool(near.any())
        a, b = reached(T.act(body.center_of_mass)[None])
        for slack in (0.0, 5e-6):
            inside = (b[0] + slack >= volume.lower[:2]).all() and (
                a[0] - slack <= volume.upper[:2]
            ).all()
            if slack:
                maybe &= bool(inside)
            else:
                surely &= bool(inside)
        assert not (ruled_out and surely)
        assert ruled_out or maybe
        seen.add((bool(ruled_out), bool(inside)))
    assert seen >= {(True, True), (False, True)}


@pytest.mark.parametrize("margin", [0.0, 0.003, 0.015, 0.04])
def test_no_cell_with_a_stable_pose_is_unsupported_whatever_the_edge_margin(made, cells, margin):
    problem, planner = made
    settings = planner._settings.collision
    poses = PoseConstraints(
        problem, settings, replace(PlannerSettings(), edge_margin=margin).footing, 0.0
    )
    unsupported = SupportBound(poses).unsupported(PlacedCells(cells))
    rng = np.random.default_rng(4)
    times = 40
    at = np.repeat(cells, times, axis=0)
    x, y, angle = (at[:, LOWER] + rng.random((len(at), 3)) * (at[:, UPPER] - at[:, LOWER])).T
    points = contacts(at, np.column_stack([x, y]))
    verdicts, _ = poses.verdicts(at[:, 0].astype(np.int64), points, angle, at[:, SLOPE:])
    stable = (verdicts > Verdict.UNSTABLE).reshape(-1, times).any(axis=1)
    assert not (stable & unsupported).any()
    assert stable.sum() > 30
    assert unsupported.sum() > 50


def test_no_cell_with_a_pose_in_any_of_several_boxes_is_ruled_out(made, cells):
    problem, planner = made
    low, high = problem.volume.lower, problem.volume.upper
    size = 0.3 * (high - low)
    heights = np.array([low[2], 0.5 * (low[2] + high[2])])
    lower = np.array([low, low + np.array([0.2, 0.5, 0.0]), [*(low[:2] + 0.1), heights[1]]])
    upper = lower + size
    upper[:2, 2] = heights[1]
    several = replace(problem, volume=TargetVolume(lower, upper))
    poses = PoseConstraints(several, planner._settings.collision, FOOTING, 0.0)
    unsupported = SupportBound(poses).unsupported(PlacedCells(cells))
    everywhere = PoseConstraints(problem, planner._settings.collision, FOOTING, 0.0)
    one = SupportBound(everywhere).unsupported(PlacedCells(cells))
    assert not (one & ~unsupported).any()
    assert (unsupported & ~one).sum() > 100
    rng, times = np.random.default_rng(4), 40
    at = np.repeat(cells, times, axis=0)
    x, y, angle = (at[:, LOWER] + rng.random((len(at), 3)) * (at[:, UPPER] - at[:, LOWER])).T
    points = contacts(at, np.column_stack([x, y]))
    verdicts, _ = poses.verdicts(at[:, 0].astype(np.int64), points, angle, at[:, SLOPE:])
    stable = (verdicts > Verdict.UNSTABLE).reshape(-1, times).any(axis=1)
    assert not (stable & unsupported).any()
    assert stable.sum() > 20


def test_cells_are_out_of_reach_where_they_are_of_every_arm_in_every_grasp(made, cells):
    problem, planner = made
    rng = np.random.default_rng(3)
    cells = cells[::4]
    moved = cells.copy()
    shift = rng.uniform(-0.2, 0.6, (len(cells), 2))
    moved[:, [X, X + 1]] += shift[:, :1]
    moved[:, [X + 2, X + 3]] += shift[:, 1:]
    moved[:, 1] += rng.uniform(-0.3, 0.3, len(cells))
    out = planner._bounds._reach.out_of_reach(PlacedCells(moved))
    bounds = []
    for holding in planner.holdings.values():
        bound = ReachBound.of(holding.chain)
        wrist = holding.arm.grasps[holding.grasp].inverse().act(bound.wrist)
        bounds.append((bound, wrist))
    assert len(bounds) >= 2
    one_arm_only = 0
    for cell, ruled_out in zip(moved, out, strict=True):
        T = problem.body.faces[int(cell[0])].T_face_object
        half, center = 0.5 * (cell[UPPER] - cell[LOWER]), 0.5 * (cell[UPPER] + cell[LOWER])
        steep = np.linalg.norm(cell[SLOPE:])
        near, gaps = [], []
        for bound, wrist in bounds:
            point = T.act(wrist)[None]
            share = rng.random((6, 3))
            for x, y, angle in (center, *(cell[LOWER] + share * 2.0 * half)):
                contact = contacts(cell[None], np.array([[x, y]]))[0]
                away = turned(cell, angle, point)[0] + contact - bound.shoulder
                near.append(np.linalg.norm(away) <= bound.length)
            contact = contacts(cell[None], center[None, :2])[0]
            away = np.abs(turned(cell, center[2], point)[0] + contact - bound.shoulder)
            turn = 2.0 * np.sin(0.5 * min(half[2], np.pi)) * np.hypot(*point[0, :2])
            least = max(np.linalg.norm(np.maximum(away[:2] - half[:2], 0.0)) - turn, 0.0)
            rise = np.abs(cell[SLOPE:]) @ half[:2] + turn * np.sin(np.arctan(steep))
            gaps.append(np.hypot(least, max(away[2] - rise, 0.0)) - bound.length)
        assert not (ruled_out and any(near))
        assert ruled_out == (min(gaps) > 0.001)
        one_arm_only += max(gaps) > 0.001 >= min(gaps)
    assert one_arm_only > 5
    assert 0.1 < out.mean() < 0.9


def test_rulings_say_what_rules_each_cell_out(made, cells):
    _, planner = made
    bounds = planner._bounds
    far = cells.copy()
    far[:700, [X, X + 1]] += 0.4
    rulings, placed = bounds.rulings(far), PlacedCells(far)
    out, unsupported = bounds._reach.out_of_reach(placed), bounds._support.unsupported(placed)
    expected = np.where(unsupported, Ruling.UNSUPPORTED, Ruling.OPEN)
    assert (rulings == np.where(out, Ruling.OUT_OF_REACH, expected)).all()
    assert set(rulings) == set(Ruling) - {Ruling.BREAKS_RULE}
