"""Unknown space: what clouds with known sensors leave unseen, and what the planner makes of it."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from helpers.footholds import bare_problem
from helpers.problems import problem_of

from benchmarks.cases import Case
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.collision.attached_object import AttachedObject
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.errors import CloudError
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.problem import workspace
from placement_planner_ros.core.robot.arm import MovingArm
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.freespace import FREE, SeenSpace, View
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet
from placement_planner_ros.core.types import TargetVolume, Verdict
from placement_planner_ros.ros.inputs.self_filter import outside_robot
from placement_planner_ros.scenes.clouds import CameraNoise, DepthCamera, camera_clouds
from placement_planner_ros.scenes.primitives import box
from placement_planner_ros.scenes.scenes import Scene, scene_by_name

SIZE = GridSettings().cell_size
VOLUME = TargetVolume([-0.3, -0.3, -0.02], [0.3, 0.3, 0.3])
BOUNDS = (np.array([-0.5, -0.5, -0.1]), np.array([0.5, 0.5, 0.6]))
EYE = np.array([-0.8, 0.0, 0.5])

FLOOR = box("floor", (-1.5, -1.5, -0.05), (1.5, 1.5, 0.004), (0.5, 0.5, 0.5))
WALL = box("wall", (1.4, -3.0, 0.0), (1.5, 3.0, 2.0), (0.5, 0.5, 0.5))
CRATE = box("crate", (-0.05, -0.1, 0.004), (0.05, 0.1, 0.154), (0.5, 0.5, 0.5))


def view_of(*parts, eye=EYE, noise=0.0, **changes):
    camera = DepthCamera.looking_at("eye", eye, (0.0, 0.0, 0.05))
    (cloud,) = camera_clouds(
        Scene("test", VOLUME, parts),
        np.random.default_rng(0),
        cameras=[camera],
        noise=CameraNoise(noise, 0.0),
    )
    return View(cloud.world_points(), eye, **changes)


def space_of(obstacles, views, volume=VOLUME):
    """What views saw, in the very cells of the obstacle set."""
    space = SeenSpace.around(obstacles, views, volume, *BOUNDS)
    assert np.allclose(space.origin, obstacles.origin)
    assert space.shape == obstacles.shape
    return space


def unknown_cells(obstacles, views, outside=None, below_measured=False):
    return space_of(obstacles, views).unknown(below_measured, outside)


def seen_free(obstacles, views):
    return space_of(obstacles, views).state == FREE


def measured(*views):
    return ObstacleSet.from_points(np.vstack([v.points for v in views]), bounds=BOUNDS)


def mask(obstacles, cells):
    found = np.zeros(obstacles.shape, bool)
    found[tuple(np.asarray(cells).T)] = True
    return found


def cell_of(obstacles, point):
    return tuple(np.floor((np.array(point) - obstacles.origin) / SIZE).astype(int))


def crossed(a, b, lower, upper):
    """How far each segment from a to b (n, 3) runs through a box, as a share of its length."""
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = (lower - a) / (b - a), (upper - a) / (b - a)
    first = np.minimum(low, high).max(axis=1).clip(0.0)
    last = np.maximum(low, high).min(axis=1).clip(max=1.0)
    return last - first


@pytest.mark.parametrize("sensor", [EYE, [0.1, 0.2, 0.3], [0.0, 0.0, 2.0], [-0.445, 0.055, 0.1]])
def test_cells_that_lines_of_sight_cross_are_seen_free_and_no_others(sensor):
    rng = np.random.default_rng(1)
    points = rng.uniform([-0.9, -0.9, -0.3], [0.9, 0.9, 1.1], (40, 3))
    points[::9] = np.nan
    points[1] = [*sensor[:2], 0.25]
    settings = GridSettings(cell_size=0.1, min_points=0)
    obstacles = ObstacleSet.from_points(np.zeros((0, 3)), settings, BOUNDS)
    free = seen_free(obstacles, [View(points, sensor)])
    points = points[np.isfinite(points).all(axis=1)]
    assert free.any()
    assert not free.all()
    for cell in np.ndindex(*obstacles.shape):
        lower = obstacles.origin + np.array(cell) * 0.1
        upper = lower + 0.1
        ends = ((points >= lower) & (points < upper)).all(axis=1)
        share = crossed(np.array(sensor), points[~ends], lower, upper)
        if free[cell]:
            assert share.max() > -1e-9
        else:
            assert share.max() < 1e-9


def test_what_is_seen_free_stays_free_with_and_without_noise():
    for noise in (0.0, 0.002):
        view = view_of(FLOOR, WALL, CRATE, noise=noise)
        obstacles = measured(view)
        cells = unknown_cells(obstacles, [view])
        assert (obstacles.number_at[tuple(cells.T)] == 0).all()
        low = obstacles.origin + cells * SIZE
        above_floor = low[:, 2] > 0.004 + noise
        beside = np.abs(low[:, 1]) > 0.25
        before = low[:, 0] < -0.05 - 2 * SIZE
        over = low[:, 2] > 0.154 + 2 * SIZE
        assert not (above_floor & (beside | before | over)).any()


def test_the_inside_of_the_crate_cannot_be_entered_nor_its_shadow():
    view = view_of(FLOOR, WALL, CRATE)
    environment = Environment.from_points(
        view.points, VOLUME, bounds=BOUNDS, sights=[view]
    ).with_unknown()
    occupied = environment.obstacles.number_at > 0
    for into in ((0.0, 0.0, 0.05), (0.1, 0.0, 0.05)):
        for axis in range(3):
            for side in (-1, 1):
                line = [cell_of(environment.obstacles, into)]
                while all(0 <= c < n for c, n in zip(line[-1], occupied.shape, strict=True)):
                    following = list(line[-1])
                    following[axis] += side
                    line.append(tuple(following))
                if axis == 2 and side == -1:
                    continue  # all of it is unknown, down to the end of the workspace
                assert any(occupied[c] for c in line[:-1])


def test_regions_support_and_clearance_are_those_of_what_was_measured():
    view = view_of(FLOOR, WALL, CRATE, noise=0.001)
    plain = Environment.from_points(view.points, VOLUME, bounds=BOUNDS, sights=[view])
    careful = Environment.from_points(
        view.points, VOLUME, bounds=BOUNDS, sights=[view]
    ).with_unknown()
    assert len(careful.obstacles) > len(plain.obstacles)
    assert [r.z for r in careful.regions] == [r.z for r in plain.regions]
    assert {round(r.z, 2) for r in careful.regions} == {0.0, 0.15}
    for a, b in zip(careful.regions, plain.regions, strict=True):
        assert np.array_equal(a.rectangles, b.rectangles)
    assert np.array_equal(careful.measured.number_at, plain.obstacles.number_at)
    hidden = np.array([[0.12, 0.0, 0.004], [-0.2, 0.0, 0.004]])
    assert careful.support.supported(hidden, 0.003).tolist() == [False, True]


def test_a_second_sensor_takes_the_shadow_away():
    front = view_of(FLOOR, CRATE)
    back = view_of(FLOOR, CRATE, eye=np.array([0.8, 0.0, 0.5]))
    both = measured(front, back)
    one = unknown_cells(both, [front])
    two = unknown_cells(both, [front, back])
    in_shadow = cell_of(both, (0.12, 0.0, 0.02))
    assert mask(both, one)[:, in_shadow[1], in_shadow[2]][in_shadow[0] - 8 :].any()
    assert not seen_free(both, [front])[in_shadow]
    assert seen_free(both, [front, back])[in_shadow]
    assert not mask(both, two)[in_shadow]


def test_without_a_known_sensor_nothing_is_unknown():
    view = view_of(FLOOR, WALL, CRATE)
    environment = Environment.from_points(view.points, VOLUME, bounds=BOUNDS)
    assert environment.obstacles is environment.measured


def test_outside_v_only_hidden_space_is_unknown_and_in_v_all_that_is_unseen():
    # A camera that sees nothing but the crate's front: what is beside it, it does not look at.
    view = view_of(CRATE)
    obstacles = measured(view)
    cells = unknown_cells(obstacles, [view])
    centers = obstacles.origin + (cells + 0.5) * SIZE
    unhidden = np.abs(centers[:, 1]) > 0.25
    assert unhidden.any()
    assert VOLUME.contains(centers[unhidden]).all()
    assert (centers[:, 0] > VOLUME.upper[0]).any()


def test_points_on_the_robot_hide_nothing_outside_v():
    view = view_of(CRATE)
    obstacles = measured(view)
    robot = replace(view, hides=np.zeros(len(view.points), bool))
    cells = unknown_cells(obstacles, [robot])
    assert VOLUME.contains(obstacles.origin + (cells + 0.5) * SIZE).all()


def test_cells_that_the_robot_reaches_into_are_not_unknown():
    view = view_of(FLOOR, WALL, CRATE)
    obstacles = measured(view)
    center, radius = np.array([0.15, 0.0, 0.04]), 0.05

    def outside_ball(points, distance):
        return np.linalg.norm(points - center, axis=1) > radius + distance

    def nearest_of(cells):
        low = obstacles.origin + cells * SIZE
        return np.linalg.norm(center - center.clip(low, low + SIZE), axis=1)

    before = nearest_of(unknown_cells(obstacles, [view]))
    after = nearest_of(unknown_cells(obstacles, [view], outside_ball))
    assert before.min() < radius
    assert radius - 1e-9 <= after.min() <= radius + 2 * SIZE


def test_nothing_above_the_highest_that_was_measured_is_unknown_where_so_asked():
    view = view_of(FLOOR, CRATE)
    obstacles = measured(view)
    highest = obstacles.cells[:, 2].max()
    every = unknown_cells(obstacles, [view])
    below = unknown_cells(obstacles, [view], below_measured=True)
    assert every[:, 2].max() > highest + 2
    assert highest - 1 <= below[:, 2].max() <= highest
    lower = {tuple(cell) for cell in every[every[:, 2] < highest]}
    assert {tuple(cell) for cell in below[below[:, 2] < highest]} == lower
    nothing = ObstacleSet.from_points(np.zeros((0, 3)), bounds=BOUNDS)
    assert len(unknown_cells(nothing, [view]))
    assert not len(unknown_cells(nothing, [view], below_measured=True))


@pytest.mark.parametrize(
    "bad",
    [
        {"points": np.zeros((3, 2))},
        {"origin": [0.0, np.nan, 0.0]},
        {"origin": [0.0, 0.0]},
        {"hides": np.ones(2, bool)},
    ],
)
def test_bad_views_are_refused(bad):
    with pytest.raises(CloudError, match=next(iter(bad))):
        View(**{"points": np.zeros((3, 3)), "origin": EYE, **bad})


@pytest.fixture(scope="module")
def cabinet():
    """A problem, and the same with unknown space as obstacle."""
    case = Case("cabinet_high_clutter", "wine_glass", "maximize_clearance", "cameras")
    plain, _ = problem_of(case)
    clouds = camera_clouds(scene_by_name(case.scene), np.random.default_rng(0))
    views = [View(c.world_points(), c.camera.T_world_camera.translation) for c in clouds]
    seen = Environment.from_points(
        np.vstack([v.points for v in views]),
        plain.volume,
        bounds=workspace(plain.robot, plain.arms, plain.q_start, plain.body, plain.volume),
        sights=views,
    )

    def outside(points, distance):
        robot, arms, q, body = plain.robot, plain.arms, plain.q_start, plain.body
        return outside_robot(points, robot, q, arms, body, 0.02 + distance)

    return plain, replace(plain, environment=seen.with_unknown(outside_robot=outside))


def test_an_arm_may_start_but_not_enter_hidden_space(cabinet):
    plain, arm = cabinet[0], cabinet[0].arms[0]
    moving = MovingArm(plain.robot, arm, plain.q_start)
    known, hidden = (
        ArmCollision(moving, AttachedObject(plain.body), each.environment.obstacles)
        for each in cabinet
    )
    q = plain.q_start[arm.q_index]
    assert hidden.free(q)
    rng = np.random.default_rng(0)
    samples = np.ascontiguousarray(rng.uniform(arm.lower, arm.upper, (3000, len(q))))
    free, allowed = known.free_batch(samples), hidden.free_batch(samples)
    assert (free & ~allowed).any()
    assert allowed.any()
    assert not (allowed & ~free).any()


@pytest.mark.parametrize("height", [0.0005, 0.0028, 0.008])
def test_unknown_space_below_a_table_takes_no_place_from_it(height):
    """However high it is within its cells: the second time just beyond the contact tolerance."""
    ticks = np.arange(-0.45, 0.45, 0.004)
    table = np.stack(np.meshgrid(ticks, ticks, height), axis=-1).reshape(-1, 3)
    eye, bounds = np.array([0.0, 0.0, 1.0]), ([-0.5, -0.5, -0.1], [0.5, 0.5, 0.6])
    known = Environment.from_points(table, VOLUME, bounds=bounds, sights=[View(table, eye)])
    mesh = trimesh.creation.box((0.06, 0.05, 0.04))
    body, settings = Body.from_mesh(mesh.vertices, mesh.faces), PlannerSettings()
    shares = []
    for around in (known, known.with_unknown()):
        rules = settings.collision, settings.footing, 0.03
        poses = PoseConstraints(bare_problem(body, around), *rules)
        rng = np.random.default_rng(0)
        contacts = np.array([poses.contacts.regions[0].sample(rng) for _ in range(300)])
        verdicts, _ = poses.verdicts(np.zeros(300, int), contacts, rng.uniform(0.0, 6.3, 300))
        shares.append((verdicts == Verdict.FEASIBLE).mean())
    assert shares[1] == shares[0] > 0.8


def test_the_share_of_the_volume_that_was_seen_is_known():
    floor = np.stack(np.meshgrid(*[np.arange(-0.6, 0.6, 0.008)] * 2, 0.0), -1).reshape(-1, 3)
    above = np.array([0.0, 0.0, 1.0])
    volume = TargetVolume([-0.3, -0.3, 0.0], [0.3, 0.3, 0.3])
    seen = Environment.from_points(floor, volume, sights=[View(floor, above)]).with_unknown().seen
    assert seen == 1.0
    # a board over half of V, as wide as V's shadow needs
    board = floor[floor[:, 0] < 0.0] + [0.0, 0.0, 0.5]
    left = floor[floor[:, 0] >= 0.0]
    both = np.vstack([board, left])
    seen = Environment.from_points(both, volume, sights=[View(both, above)]).with_unknown().seen
    assert 0.45 < seen < 0.6
    assert Environment.from_points(both, volume, sights=[View(both, above)]).seen is None


def test_unknown_space_that_is_cut_off_far_from_v_cannot_be_entered_from_there():
    view = view_of(FLOOR, WALL, CRATE)
    volume = TargetVolume([-0.1, -0.1, 0.0], [0.0, 0.1, 0.05])
    bounds = BOUNDS[0] - [0.0, 0.0, 0.5], BOUNDS[1] + [0.5, 0.0, 0.0]
    obstacles = ObstacleSet.from_points(view.points, bounds=bounds)
    space = SeenSpace.around(obstacles, [view], volume, *bounds)
    joined = space.with_unknown(space.unknown())
    assert joined.bounds[0][2] <= space.origin[2] + 1e-9
    occupied = joined.number_at > 0
    under = cell_of(joined, (0.2, 0.0, -0.3))  # below the floor, within what is known
    assert occupied[under[0], under[1], : under[2]].any()
    assert occupied[under[0] :, under[1], under[2]].any()
