"""The clearance field, against brute force over the boxes and true solids."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.points import BOUNDS, floor_can_shelf_wall, plane
from scipy.spatial import ConvexHull, QhullError

from placement_planner_ros.core.scene.clearance import ClearanceField
from placement_planner_ros.core.scene.clearance_table import CAP, LIFT_M, MOST_PIXELS
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.scenes import scene_by_name

VOLUME = TargetVolume(np.array([-0.3, -0.3, -0.05]), np.array([0.3, 0.25, 0.35]))
CELL = 0.01


@pytest.fixture(scope="module")
def obstacles():
    return ObstacleSet.from_points(floor_can_shelf_wall(), bounds=BOUNDS)


@pytest.fixture(scope="module")
def field(obstacles):
    return ClearanceField(obstacles, VOLUME)


def exact(obstacles, points, cap=0.5, volume=VOLUME, beyond=0.0):
    """Mean of d_S, by definition, from half a voxel below to half a voxel above the points.

    To the hulls of the points of each box that lie in V, seen from above.
    """
    touching, last = np.zeros(len(obstacles), bool), np.full(len(obstacles), -np.inf)
    for low, high in volume.boxes:
        low, high = low - beyond, high + beyond
        touched = ((obstacles.upper >= low) & (obstacles.lower <= high)).all(axis=1)
        touching |= touched
        last[touched] = np.maximum(last[touched], high[2])
    lower, upper, last = obstacles.lower[touching], obstacles.upper[touching], last[touching]
    heights = 0.005 * ((np.arange(20) + 0.5) / 20 - 0.5)
    result = np.empty(len(points))
    aside = []
    for n in np.flatnonzero(touching):
        of = obstacles.points[obstacles.first_point[n] : obstacles.first_point[n + 1], :2]
        off = 1e-6 + beyond
        inside = [(of >= low[:2] - off).all(1) & (of <= high[:2] + off).all(1)
                  for low, high in volume.boxes]  # fmt: skip
        of = of[np.any(inside, axis=0)].astype(float)
        aside.append(distance_to_hull(of, points[:, :2]) if len(of) else np.full(len(points), cap))
    for row, p in enumerate(points):
        z = p[2] + heights[:, None]
        beside = np.array([a[row] for a in aside]) if aside else np.zeros(0)
        gap = np.sqrt(beside**2 + np.maximum(lower[:, 2] - z, 0.0) ** 2)
        counted = np.minimum(upper[:, 2], last) >= z
        result[row] = np.minimum(np.where(counted, gap, cap).min(axis=1, initial=cap), cap).mean()
    return result


def test_a_wall_that_meets_a_ceiling_counts_below_it():
    x, y = (each.ravel() for each in np.mgrid[-0.2:0.2:0.005, -0.2:0.2:0.005])
    ceiling = np.column_stack([x, y, np.full(x.size, 0.3)])
    y, z = (each.ravel() for each in np.mgrid[-0.2:0.2:0.005, 0.0:0.301:0.005])
    wall = np.column_stack([np.full(y.size, 0.003), y, z])
    made = ObstacleSet.from_points(np.vstack([ceiling, wall]), bounds=BOUNDS)
    asked = np.random.default_rng(0).uniform([-0.1, -0.1, 0.02], [0.1, 0.1, 0.25], (200, 3))
    true = np.minimum(np.abs(asked[:, 0] - 0.003), 0.3 - asked[:, 2])
    assert ClearanceField(made, VOLUME).distance(asked) == pytest.approx(true, abs=0.006)


def distance_to_hull(of, points):
    """(n,) from points (n, 2) to the convex hull of others."""
    try:
        corners = of[ConvexHull(of).vertices]
    except (QhullError, ValueError):  # fewer than three, or in line
        corners = np.array([of.min(axis=0), of.max(axis=0)])
        if (of - of.mean(axis=0)).prod(axis=1).sum() < 0.0:
            corners[:, 1] = corners[::-1, 1]
    distance, inside = np.full(len(points), np.inf), np.ones(len(points), bool)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-18), 0.0, 1.0)
        distance = np.minimum(
            distance, np.linalg.norm(points - a - along[:, None] * (b - a), axis=1)
        )
        inside &= (b - a)[0] * (points - a)[:, 1] > (b - a)[1] * (points - a)[:, 0]
    return np.where(inside, 0.0, distance)


def test_values_are_those_of_the_definition(obstacles, field):
    """Of runs at the mean of their points: on clean surfaces a little too far, seldom by more."""
    rng = np.random.default_rng(0)
    points = rng.uniform((-0.45, -0.45, 0.012), (0.45, 0.4, 0.34), (500, 3))
    error = field.distance(points) - exact(obstacles, points)
    assert np.median(np.abs(error)) < 1e-3
    assert np.quantile(np.abs(error), 0.95) < 5e-3
    assert np.abs(error).max() < 1.5 * CELL


def test_what_is_looked_up_changes_no_faster_than_a_distance_but_for_the_raster():
    """Along x and y, at one height: by the way between two places and what `docs/limits.md` says,
    as between four pixels it changes along both axes."""
    scene = scene_by_name("table")
    low, high = scene.volume.lower, scene.volume.upper
    field = Environment.from_points(complete_cloud(scene), scene.volume).clearance
    rng = np.random.default_rng(8)
    here = rng.uniform(low, high, (100_000, 3))
    there = here + rng.uniform(-0.02, 0.02, here.shape) * (1.0, 1.0, 0.0)
    change = np.abs(field.distance(here) - field.distance(there))
    more = change - np.linalg.norm(here - there, axis=1)
    assert more.max() < 0.7 * CELL
    assert np.quantile(more, 0.999) < 0.1 * CELL


def sampled_box(low, high, angle, spacing):
    """Points on the sides and the top of an upright box, its edges included; its true solid."""
    lines = [np.linspace(a, b, int((b - a) / spacing) + 2) for a, b in zip(low, high, strict=True)]
    faces = []
    for axis in range(3):
        for end in (0, -1) if axis < 2 else (-1,):
            grid = np.meshgrid(*(x if a != axis else x[[end]] for a, x in enumerate(lines)))
            faces.append(np.stack(grid, axis=-1).reshape(-1, 3))
    c, s = np.cos(angle), np.sin(angle)
    points = np.vstack(faces)
    points[:, :2] = points[:, :2] @ np.array([[c, s], [-s, c]])
    return points, (np.asarray(low), np.asarray(high), angle)


def true_distance_to(solids, points, cap=0.5):
    """d_S to upright boxes, by definition, the mean over the height of a voxel."""
    heights = 0.005 * ((np.arange(20) + 0.5) / 20 - 0.5)
    lowest = points[:, 2].min() + 0.003 + 0.0025 + 0.00125  # support does not count
    z = np.maximum(points[:, 2], lowest)[:, None] + heights
    best = np.full(z.shape, cap)
    for low, high, angle in solids:
        c, s = np.cos(angle), np.sin(angle)
        xy = points[:, :2] @ np.array([[c, -s], [s, c]])
        aside = np.maximum(np.maximum(low[:2] - xy, xy - high[:2]), 0.0)
        gap = np.sqrt((aside**2).sum(axis=1)[:, None] + np.maximum(low[2] - z, 0.0) ** 2)
        best = np.minimum(best, np.where(high[2] >= z, gap, cap))
    return best.mean(axis=1)


def test_clearance_is_the_same_whatever_the_origin_of_the_grid():
    """And that of the true solids: things of all heights, one that is thinner than a voxel, and a
    board overhead."""
    rng = np.random.default_rng(6)
    spread, off = [], []
    for _ in range(3):
        z = rng.uniform(0.0, 0.01)
        clouds = [plane((-0.4, -0.4, z), (0.4, 0.4, z), 0.004)]
        solids = []
        for n in range(6):
            half = rng.uniform(0.015, 0.04, 2) if n else np.array([0.04, 0.001])
            at = rng.uniform(-0.19, 0.19, 2)  # within V: what lies beyond does not count
            low, high = np.append(at - half, z), np.append(at + half, z + rng.uniform(0.01, 0.2))
            points, solid = sampled_box(low, high, rng.uniform(0.0, np.pi), 0.004)
            clouds.append(points)
            solids.append(solid)
        board = np.array([-0.3, -0.3, z + 0.3]), np.array([0.1, 0.3, z + 0.301])
        points, solid = sampled_box(*board, 0.0, 0.004)
        clouds.append(points)
        solids.append(solid)
        cloud = np.vstack(clouds)
        poses = []
        while len(poses) < 8:
            pose = pin.SE3(
                pin.utils.rotate("z", rng.uniform(0.0, 2.0 * np.pi)),
                np.append(rng.uniform(-0.19, 0.19, 2), z),
            )
            size = rng.choice([0.02, 0.06, 0.11])
            line = np.arange(0.0025, 0.05, 0.005)
            up = np.arange(0.0025, size, 0.005)
            body = np.stack(np.meshgrid(line, line, up), axis=-1).reshape(-1, 3)
            world = body @ pose.rotation.T + pose.translation
            if true_distance_to(solids, world).min() > 0.0:
                poses.append((pose, body, true_distance_to(solids, world).mean()))
        found = []
        for _ in range(4):
            low = np.array([-0.45, -0.45, -0.1]) - rng.uniform(0.0, 0.01, 3)
            obstacles = ObstacleSet.from_points(cloud, bounds=(low, np.add(low, (0.9, 0.9, 0.6))))
            field = ClearanceField(obstacles, VOLUME)
            found.append([field.mean_clearance(p.homogeneous[None], b)[0][0] for p, b, _ in poses])
        found = np.array(found)
        spread.append(np.ptp(found, axis=0))
        off.append(np.abs(found - [true for *_, true in poses]))
    assert np.max(spread) < 2e-3
    assert np.max(off) < 5e-3  # what docs/limits.md states


def test_a_field_over_any_volume_is_bounded(obstacles):
    """Its pixels are further apart, and values less exact, not more of them."""
    wide = TargetVolume(np.array([-4.0, -4.0, -1.0]), np.array([4.0, 4.0, 3.0]))
    field = ClearanceField(obstacles, wide)
    assert field._table.values[0, :, :, 0].size <= 1.02 * MOST_PIXELS
    points = np.random.default_rng(1).uniform((-0.3, -0.3, 0.012), (0.3, 0.25, 0.3), (200, 3))
    error = np.abs(field.distance(points) - exact(obstacles, points, volume=wide))
    assert np.median(error) < 0.5 * field._table.pixel


def test_values_around_several_boxes_are_those_of_the_definition(obstacles):
    low = np.array([[-0.3, -0.3, -0.05], [0.05, -0.05, 0.0]])
    high = np.array([[0.0, 0.1, 0.1], [0.3, 0.25, 0.3]])
    volume = TargetVolume(low, high)
    points = np.random.default_rng(3).uniform((-0.3, -0.3, 0.015), (0.3, 0.25, 0.3), (80, 3))
    for beyond in (0.0, 0.1, 0.5):
        field = ClearanceField(obstacles, volume, beyond)
        error = np.abs(field.distance(points) - exact(obstacles, points, 0.5, volume, beyond))
        assert np.median(error) < 1e-3
        assert np.quantile(error, 0.9) < CELL


def test_an_empty_volume_has_the_cap(obstacles):
    empty = ObstacleSet.from_points(np.zeros((0, 3)), bounds=BOUNDS)
    field = ClearanceField(empty, VOLUME)
    points = np.random.default_rng(0).uniform(-1, 1, (50, 3))
    np.testing.assert_allclose(field.distance(points), CAP, rtol=1e-6)
    volume = TargetVolume(np.array([-0.3, -0.3, 0.3]), np.array([-0.1, 0.0, 0.4]))
    above = ClearanceField(obstacles, volume)
    np.testing.assert_allclose(above.distance(np.array([[-0.2, -0.1, 0.31]])), 0.5)


def test_noisy_support_within_the_contact_tolerance_does_not_count():
    rng = np.random.default_rng(2)
    floor = plane((-0.3, -0.3, 0.0), (0.3, 0.3, 0.0))
    for height in np.arange(0.0, 0.01, 0.001):
        rough = floor + np.array([0.0, 0.0, height])
        rough[:, 2] += rng.uniform(0.0, 0.0029, len(rough))
        obstacles = ObstacleSet.from_points(rough, bounds=BOUNDS)
        field = ClearanceField(obstacles, VOLUME)
        points = np.c_[rng.uniform(-0.1, 0.1, (200, 2)), np.full(200, 0.0001)]
        pose = pin.SE3(np.eye(3), np.array([0.0, 0.0, height]))
        assert field.mean_clearance(pose.homogeneous[None], points)[0] == pytest.approx(
            0.5, abs=1e-6
        )


def test_mean_clearance_and_its_gradient(field):
    rng = np.random.default_rng(4)
    body = rng.uniform(-0.04, 0.04, (400, 3)) + np.array([0.03, 0.0, 0.05])
    pose = pin.SE3(pin.utils.rotate("z", 0.7) @ pin.utils.rotate("x", 0.3), np.array([0, 0, 0.05]))
    (value,), (gradient,) = field.mean_clearance(pose.homogeneous[None], body)
    world = body @ pose.rotation.T + pose.translation
    world[:, 2] = np.maximum(world[:, 2], world[:, 2].min() + LIFT_M)
    assert value == pytest.approx(field.distance(world).mean(), abs=1e-12)
    step = 1e-6

    def at(change):
        turned = pin.SE3(
            pin.utils.rotate("z", change[2]) @ pose.rotation,
            pose.translation + np.array([change[0], change[1], 0.0]),
        )
        return field.mean_clearance(turned.homogeneous[None], body)[0][0]

    numeric = [(at(step * e) - at(-step * e)) / (2 * step) for e in np.eye(3)]
    np.testing.assert_allclose(gradient, numeric, atol=2e-3)
