"""The clearance field and the distance bound, against brute force over the boxes."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.points import BOUNDS, plane
from scipy.spatial import ConvexHull, QhullError

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.scene.distance import MAX_VALUES, ClearanceField
from placement_planner_ros.core.scene.distance_bound import distance_bound_field
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import TargetVolume

VOLUME = TargetVolume(np.array([-0.3, -0.3, -0.05]), np.array([0.3, 0.25, 0.35]))
CELL = 0.01


def scene():
    """A floor, a can, a shelf overhead and a wall that lies half outside V."""
    angle = np.linspace(0.0, 2.0 * np.pi, 80, endpoint=False)
    can = [
        np.c_[0.1 + 0.034 * np.cos(angle), 0.05 + 0.034 * np.sin(angle), np.full(80, z)]
        for z in np.arange(0.0, 0.12, 0.003)
    ]
    return np.vstack(
        [
            plane((-0.35, -0.35, 0.0042), (0.35, 0.35, 0.0042)),
            plane((-0.2, -0.2, 0.2512), (0.0, 0.1, 0.2512)),
            plane((0.271, -0.3, 0.0), (0.271, 0.0, 0.45)),
            *can,
        ]
    )


@pytest.fixture(scope="module")
def obstacles():
    return ObstacleSet.from_points(scene(), bounds=BOUNDS)


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
    """Also between the grid points; where a thing ends, what is averaged over differs by little."""
    rng = np.random.default_rng(0)
    (table,) = field.tables
    i, j, k = (rng.integers(n - 1, size=500) for n in table.values.shape)
    points = table.origin + np.stack([CELL * i, CELL * j, table.rise * k], axis=1)
    error = np.abs(table.values[i, j, k] - exact(obstacles, points))
    assert np.quantile(error, 0.9) < 1e-3
    assert np.quantile(error, 0.99) < 0.5 * CELL
    assert error.max() <= 0.5 / 20  # where all ends, of 20 heights one is in doubt
    points = rng.uniform((-0.45, -0.45, 0.005), (0.45, 0.4, 0.34), (500, 3))
    error = np.abs(field.distance(points) - exact(obstacles, points))
    assert np.median(error) < 5e-4
    assert np.quantile(error, 0.95) < 4e-3
    assert error.max() < CELL


def test_floor_below_does_not_count_but_what_is_above_does(field):
    points = np.array([[-0.1, -0.05, z] for z in (0.0087, 0.1, 0.2, 0.2599)])
    distance = field.distance(points)
    can = np.hypot(0.2, 0.1) - 0.034
    np.testing.assert_allclose(distance[:3], [can, 0.1512, 0.0512], atol=CELL)
    assert distance[3] > 0.3  # the shelf lies below, the wall is far


def test_a_flat_ceiling_counts_wherever_it_lies_in_its_cell():
    rng = np.random.default_rng(4)
    for offset in np.arange(0.0, 0.01, 0.001):
        height = BOUNDS[0][2] - 0.03 * CELL + 41 * CELL + offset
        ceiling = plane((-0.2, -0.2, height), (0.2, 0.2, height))
        obstacles = ObstacleSet.from_points(ceiling, bounds=BOUNDS)
        field = ClearanceField(obstacles, VOLUME)
        below = rng.uniform(0.15, height - 0.0038, 300)
        points = np.c_[rng.uniform(-0.19, 0.19, (300, 2)), below]
        error = field.distance(points) - (height - points[:, 2])
        assert np.abs(error).max() < 5e-4  # of points 5 mm apart


def test_distances_are_continuous_in_z(field):
    rng = np.random.default_rng(5)
    column = np.arange(-0.06, 0.4, 1e-4)
    for x, y in rng.uniform((-0.35, -0.35), (0.35, 0.3), (40, 2)):
        distance = field.distance(np.c_[np.full((len(column), 2), (x, y)), column])
        # from nothing but the cap to a thing beside the point over the height of a voxel at most
        assert np.abs(np.diff(distance)).max() <= 0.5 * 1e-4 / 0.0025


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
            found.append([field.mean_clearance(p.homogeneous, b)[0] for p, b, _ in poses])
        found = np.array(found)
        spread.append(np.ptp(found, axis=0))
        off.append(np.abs(found - [true for *_, true in poses]))
    assert np.max(spread) < 2e-3
    assert np.max(off) < 3e-3


def ball(centre, radius, spacing):
    """Points of a ball, about `spacing` apart, and its d_S."""
    n = int(4.0 * np.pi * radius**2 / spacing**2)
    turn, up = np.pi * (1.0 + 5.0**0.5) * np.arange(n), 1.0 - (2.0 * np.arange(n) + 1.0) / n
    around = np.sqrt(1.0 - up**2)
    points = centre + radius * np.c_[around * np.cos(turn), around * np.sin(turn), up]

    def distance(p):
        off = p - centre
        beside = np.linalg.norm(off[:, :2], axis=1)
        level = beside - np.sqrt(np.maximum(radius**2 - off[:, 2] ** 2, 0.0))
        nearest = np.where(off[:, 2] < 0.0, np.linalg.norm(off, axis=1) - radius, level)
        return np.where(off[:, 2] <= radius, nearest, 0.5)

    return points, distance


def cone(foot, radius, height, spacing):
    """Points of a cone's side, about `spacing` apart, and its d_S."""
    slant = np.hypot(radius, height)
    rings = []
    for share in np.linspace(0.0, 1.0, int(slant / spacing) + 1):
        r = radius * (1.0 - share)
        angle = np.arange(max(int(2.0 * np.pi * r / spacing), 1))
        angle = angle * 2.0 * np.pi / len(angle) + 7.0 * share
        rings.append(
            np.c_[r * np.cos(angle), r * np.sin(angle), np.full(len(angle), share * height)]
        )

    def distance(p):
        beside = np.linalg.norm(p[:, :2] - foot[:2], axis=1)
        up = p[:, 2] - foot[2]
        return np.where(up <= height, beside - radius * (1.0 - np.maximum(up, 0.0) / height), 0.5)

    return np.vstack(rings) + foot, distance


def board(middle, radius, spacing):
    """Points of a thin board in the air, turned by 0.4 rad, on all its sides, and its d_S."""
    half = np.array([0.8 * radius, 0.6 * radius, 0.004])
    points, (low, high, angle) = sampled_box(-half, half, 0.4, spacing)
    below = points[points[:, 2] == half[2]] * np.array([1.0, 1.0, -1.0])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def distance(p):
        xy = (p - middle)[:, :2] @ turn
        aside = np.maximum(np.maximum(low[:2] - xy, xy - high[:2]), 0.0)
        z = p[:, 2] - middle[2]
        gap = np.sqrt((aside**2).sum(axis=1) + np.maximum(low[2] - z, 0.0) ** 2)
        return np.where(z <= high[2], gap, 0.5)

    return np.vstack([points, below]) + middle, distance


@pytest.mark.parametrize("spacing", [0.002, 0.004])
@pytest.mark.parametrize("kind", ["ball", "ball in the air", "cone", "board"])
def test_clearance_beside_what_is_round_or_leans_hardly_depends_on_the_origin(kind, spacing):
    rng = np.random.default_rng(7)
    spread, off = [], []
    for _ in range(5):
        foot = np.append(rng.uniform(-0.05, 0.05, 2), rng.uniform(0.0, 0.01))
        radius = rng.uniform(0.015, 0.08)
        if kind == "ball":
            points, true = ball(foot + np.array([0.0, 0.0, radius]), radius, spacing)
        elif kind == "ball in the air":
            points, true = ball(foot + np.array([0.0, 0.0, radius + 0.04]), radius, spacing)
        elif kind == "cone":
            points, true = cone(foot, radius, rng.uniform(0.8, 2.0) * radius, spacing)
        else:
            points, true = board(foot + np.array([0.0, 0.0, 0.08]), radius, spacing)
        floor = plane((-0.3, -0.3, foot[2]), (0.3, 0.3, foot[2]), 0.004)
        cloud = np.vstack([floor, points])
        line = np.arange(0.0025, 0.06, 0.005)
        bodies, poses = [], []
        for height in (0.02, 0.06, 0.11):
            up = np.arange(0.0025, height, 0.005)
            bodies.append(np.stack(np.meshgrid(line, line, up), axis=-1).reshape(-1, 3))
            way, turn = rng.uniform(0.0, 2.0 * np.pi, 2)
            away = radius + rng.uniform(0.1, 0.15)
            pose = pin.SE3(pin.utils.rotate("z", turn), foot.copy())
            pose.translation[:2] += away * np.array([np.cos(way), np.sin(way)])
            poses.append(pose)
        found, wanted = [], []
        for _ in range(6):
            low = np.array([-0.45, -0.45, -0.1]) - rng.uniform(0.0, 0.01, 3)
            obstacles = ObstacleSet.from_points(cloud, bounds=(low, np.add(low, (0.9, 0.9, 0.6))))
            field = ClearanceField(obstacles, VOLUME)
            found.append([field.mean_clearance(p.homogeneous, b)[0]
                          for p, b in zip(poses, bodies, strict=True)])  # fmt: skip
        for pose, body in zip(poses, bodies, strict=True):
            world = body @ pose.rotation.T + pose.translation
            world[:, 2] = np.maximum(world[:, 2], world[:, 2].min() + field.lift)
            layers = 0.005 * ((np.arange(10) + 0.5) / 10 - 0.5)
            wanted.append(np.mean([true(world + np.array([0.0, 0.0, z])) for z in layers]))
        spread.append(np.ptp(found, axis=0))
        off.append(np.abs(np.array(found) - wanted))
    assert np.max(spread) < 2e-3
    assert np.max(off) < 3e-3


@pytest.mark.parametrize("beyond", [0.0, 0.5])
def test_what_leans_counts_where_it_goes_through_the_floor_and_the_top_of_the_volume(beyond):
    """A ramp that rises along x through all of V and past it."""
    along, across = np.meshgrid(np.arange(-0.35, 0.35, 0.002), np.arange(-0.3, 0.3, 0.002))
    ramp = np.c_[along.ravel(), across.ravel(), along.ravel() + 0.15]
    obstacles = ObstacleSet.from_points(ramp, bounds=BOUNDS)
    field = ClearanceField(obstacles, VOLUME, beyond)
    z = np.arange(-0.04, 0.34, 0.01)
    for gap in (0.03, 0.1):
        points = np.c_[z - 0.15 - gap, np.zeros(len(z)), z]
        inside = (points[:, 0] > -0.3) & (z < 0.34)
        np.testing.assert_allclose(field.distance(points[inside]), gap, atol=2e-3)


def test_what_leaves_the_volume_through_its_side_counts_up_to_there_whatever_the_origin():
    """A ramp that rises along x through V's side, with nothing counting beyond V."""
    along, across = np.random.default_rng(3).uniform((0.2, -0.1), (0.4, 0.1), (20000, 2)).T
    ramp = np.c_[along, across, 0.5 * (along - 0.2)]
    points = np.c_[np.full(200, 0.1), np.zeros(200), np.linspace(0.005, 0.06, 200)]
    found = []
    for shift in np.arange(0.0, 0.01, 0.00125):
        low = np.array([-0.45 - shift, -0.45, -0.1])
        obstacles = ObstacleSet.from_points(ramp, bounds=(low, low + 0.9))
        found.append(ClearanceField(obstacles, VOLUME, 0.0).distance(points))
    assert np.ptp(np.mean(found, axis=1)) < 2e-3
    inside = points[:, 2] < 0.045
    assert np.abs(np.array(found)[:, inside] - 0.1 - 2.0 * points[inside, 2]).max() < 4e-3
    assert (np.array(found)[:, points[:, 2] > 0.0526] == 0.5).all()


def test_a_large_volume_sees_what_is_low():
    points, _ = sampled_box((-0.03, -0.03, 0.0), (0.03, 0.03, 0.02), 0.3, 0.003)
    tower, _ = sampled_box((0.4, 0.4, 0.0), (0.42, 0.42, 0.7), 0.0, 0.005)
    obstacles = ObstacleSet.from_points(np.vstack([points, tower]))
    volume = TargetVolume(np.array([-1.0, -1.0, -0.05]), np.array([1.0, 1.0, 0.8]))
    large, small = ClearanceField(obstacles, volume), ClearanceField(obstacles, VOLUME)
    assert large.lift == small.lift
    beside = np.array([[x, 0.0, 0.012] for x in np.linspace(0.06, 0.2, 40)])
    np.testing.assert_allclose(large.distance(beside), small.distance(beside), atol=2e-3)


def size_of(field):
    return sum(table.values.size for table in field.tables)


@pytest.mark.parametrize("beyond", [0.0, 0.5])
def test_a_field_over_any_volume_is_bounded(beyond):
    """Its lines and levels are further apart, and values less exact, not more of them."""
    tower = plane((0.5, 0.5, -1.0), (0.5, 0.52, 3.4), 0.01)  # so that levels go up all the way
    bounds = (-1.0, -1.0, -1.1), (1.0, 1.0, 3.6)
    tall = ObstacleSet.from_points(np.vstack([scene(), tower]), bounds=bounds)
    wide = TargetVolume(np.array([-4.0, -4.0, -1.0]), np.array([4.0, 4.0, 3.0]))
    field = ClearanceField(tall, wide, beyond)
    assert 0.1 * MAX_VALUES < size_of(field) <= MAX_VALUES
    (table,) = field.tables
    assert table.size > CELL
    rng = np.random.default_rng(1)
    points = rng.uniform((-0.45, -0.45, 0.005), (0.45, 0.4, 0.34), (800, 3))
    error = np.abs(field.distance(points) - exact(tall, points, volume=wide, beyond=beyond))
    assert np.median(error) < 0.5 * table.size


def test_the_field_of_boxes_far_apart_is_bounded_and_keeps_its_lines(obstacles):
    """As many as there may be, tens of metres from each other: a table for each."""
    rng = np.random.default_rng(2)
    low = np.vstack([np.array([[-0.3, -0.3, -0.05]]), rng.uniform(-60.0, 60.0, (63, 3))])
    high = low + np.array([0.3, 0.4, 0.3])
    volume = TargetVolume(low, high)
    for beyond in (0.0, 0.5):
        field = ClearanceField(obstacles, volume, beyond)
        assert size_of(field) <= MAX_VALUES
        assert len(field.tables) > 60
        assert field.tables[0].size == pytest.approx(CELL)
        points = rng.uniform((-0.35, -0.35, 0.015), (0.1, 0.2, 0.24), (400, 3))
        error = np.abs(field.distance(points) - exact(obstacles, points, 0.5, volume, beyond))
        assert np.median(error) < 5e-4
        assert np.quantile(error, 0.98) < CELL


def test_values_around_several_boxes_are_those_of_the_definition(obstacles):
    """Of each box its own table, and of a pose that of the box it stands in."""
    low = np.array([[-0.3, -0.3, -0.05], [0.05, -0.05, 0.0], [3.0, 0.0, 0.0]])
    high = np.array([[0.0, 0.1, 0.1], [0.3, 0.25, 0.3], [3.4, 0.4, 0.4]])
    volume = TargetVolume(low, high)
    rng = np.random.default_rng(3)
    for beyond in (0.0, 0.1, 0.5):
        field = ClearanceField(obstacles, volume, beyond)
        assert len(field.tables) == 2
        near = rng.uniform((-0.45, -0.45, 0.015), (0.45, 0.4, 0.34), (600, 3))
        far = rng.uniform((2.9, 0.0, 0.0), (3.5, 0.4, 0.4), (50, 3))
        points = np.vstack([near, far])
        error = np.abs(field.distance(points) - exact(obstacles, points, 0.5, volume, beyond))
        assert np.median(error) < 5e-4
        assert np.quantile(error, 0.95) < 4e-3
        assert np.quantile(error, 0.98) < CELL
        body = rng.uniform(-0.03, 0.03, (60, 3))
        poses = np.tile(np.eye(4), (5, 1, 1))
        poses[:, :3, 3] = [[-0.1, 0, 0.1], [3.2, 0.2, 0.1], [0.2, 0.2, 0.2], [3, 0, 0], [0, 0, 0.1]]
        values, _ = field.mean_clearance_batch(poses, body)
        for pose, value in zip(poses, values, strict=True):
            world = body + pose[:3, 3]
            world[:, 2] = np.maximum(world[:, 2], world[:, 2].min() + field.lift)
            assert value == pytest.approx(field.distance(world).mean(), abs=1e-12)


def test_boxes_that_make_one_box_have_the_field_of_that_box(obstacles):
    low, high = VOLUME.lower, VOLUME.upper
    for axis in range(3):
        lower, upper = np.array([low, low]), np.array([high, high])
        upper[0, axis] = lower[1, axis] = low[axis] + 0.3 * (high - low)[axis]
        for beyond in (0.0, 0.5):
            one = ClearanceField(obstacles, VOLUME, beyond)
            two = ClearanceField(obstacles, TargetVolume(lower, upper), beyond)
            np.testing.assert_array_equal(one.tables[0].values, two.tables[0].values)


def test_walls_just_outside_a_tight_volume_count_where_things_beyond_it_do():
    """A bin: walls 14 mm outside V on all sides, and a shelf over it."""
    side, wall = np.arange(-0.114, 0.115, 0.003), []
    for z in np.arange(0.0, 0.15, 0.003):
        edge = np.full(len(side), 0.114)
        wall += [np.c_[side, s * edge, edge * 0 + z] for s in (-1, 1)]
        wall += [np.c_[s * edge, side, edge * 0 + z] for s in (-1, 1)]
    cloud = np.vstack(
        [
            plane((-0.114, -0.114, 0.0), (0.114, 0.114, 0.0), 0.004),
            plane((-0.1, -0.1, 0.45), (0.1, 0.1, 0.45), 0.004),
            *wall,
        ]
    )
    obstacles = ObstacleSet.from_points(cloud, bounds=BOUNDS)
    tight = TargetVolume(np.array([-0.1, -0.1, -0.01]), np.array([0.1, 0.1, 0.1]))
    rng = np.random.default_rng(4)
    points = rng.uniform((-0.099, -0.099, 0.01), (0.099, 0.099, 0.25), (500, 3))
    paper = ClearanceField(obstacles, tight).distance(points)
    np.testing.assert_allclose(paper, 0.5)
    around = ClearanceField(obstacles, tight, 0.5)
    beside = 0.114 - np.abs(points[:, :2]).max(axis=1)
    low, high = points[:, 2] < 0.13, points[:, 2] > 0.155
    np.testing.assert_allclose(around.distance(points[low]), beside[low], atol=0.5 * CELL)
    over = 0.45 - points[high, 2]
    np.testing.assert_allclose(around.distance(points[high]), over, atol=1e-3)
    # what is further from V than that does not count
    near = ClearanceField(obstacles, tight, 0.2)
    np.testing.assert_allclose(near.distance(points[high]), 0.5)


def test_the_same_values_every_time(obstacles):
    one, two = (ClearanceField(obstacles, VOLUME, 0.5).tables[0].values for _ in range(2))
    np.testing.assert_array_equal(one, two)


def test_an_empty_volume_has_the_cap(obstacles):
    empty = ObstacleSet.from_points(np.zeros((0, 3)), bounds=BOUNDS)
    field = ClearanceField(empty, VOLUME, cap=0.4)
    points = np.random.default_rng(0).uniform(-1, 1, (50, 3))
    np.testing.assert_allclose(field.distance(points), 0.4, rtol=1e-6)
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
        assert field.mean_clearance(pose.homogeneous, points)[0] == pytest.approx(0.5, abs=1e-6)


def test_gradient_is_that_of_the_interpolation(field):
    rng = np.random.default_rng(3)
    points = rng.uniform((-0.3, -0.3, 0.01), (0.3, 0.25, 0.3), (500, 3))
    step = 1e-6
    origin = field.tables[0].origin[:2]
    inner = np.abs((points[:, :2] - origin) / CELL % 1.0 - 0.5).max(axis=1) < 0.49
    points = points[inner]
    gradient = field.gradient(points)
    for axis in range(2):
        ahead, behind = points.copy(), points.copy()
        ahead[:, axis] += step
        behind[:, axis] -= step
        numeric = (field.distance(ahead) - field.distance(behind)) / (2 * step)
        np.testing.assert_allclose(gradient[:, axis], numeric, atol=1e-6)


def test_mean_clearance_and_its_gradient(field):
    rng = np.random.default_rng(4)
    body = rng.uniform(-0.04, 0.04, (400, 3)) + np.array([0.03, 0.0, 0.05])
    pose = pin.SE3(pin.utils.rotate("z", 0.7) @ pin.utils.rotate("x", 0.3), np.array([0, 0, 0.05]))
    value, gradient = field.mean_clearance(pose.homogeneous, body)
    world = body @ pose.rotation.T + pose.translation
    world[:, 2] = np.maximum(world[:, 2], world[:, 2].min() + field.lift)
    assert value == pytest.approx(field.distance(world).mean(), abs=1e-12)
    np.testing.assert_allclose(gradient[:2], field.gradient(world).mean(axis=0), atol=1e-12)
    step = 1e-6

    def at(change):
        turned = pin.SE3(
            pin.utils.rotate("z", change[2]) @ pose.rotation,
            pose.translation + np.array([change[0], change[1], 0.0]),
        )
        return field.mean_clearance(turned.homogeneous, body)[0]

    numeric = [(at(step * e) - at(-step * e)) / (2 * step) for e in np.eye(3)]
    np.testing.assert_allclose(gradient, numeric, atol=2e-3)


def test_batches_equal_single_poses(field):
    rng = np.random.default_rng(5)
    body = rng.uniform(-0.04, 0.04, (50, 3))
    poses = np.stack([pin.SE3.Random().homogeneous for _ in range(6)])
    values, gradients = field.mean_clearance_batch(poses, body)
    for pose, value, gradient in zip(poses, values, gradients, strict=True):
        single = field.mean_clearance(pose, body)
        assert single[0] == value
        np.testing.assert_array_equal(single[1], gradient)


def true_distance(obstacles, points):
    return np.array(
        [
            np.linalg.norm(
                np.maximum(np.maximum(obstacles.lower - p, p - obstacles.upper), 0.0), axis=1
            ).min()
            for p in points
        ]
    )


def levels_of(bound, cells):
    tile, (i, j, k) = tuple((cells // 4).T), (cells % 4).T
    return bound.levels[(*tile, 16 * i + 4 * j + k)].astype(np.float64)


@pytest.mark.parametrize("cap", [0.3, 0.04])
def test_bounds_hold_everywhere_and_are_exact_near(obstacles, cap):
    bound = distance_bound_field(obstacles, cap)
    rng = np.random.default_rng(6)
    cells = np.stack([rng.integers(n, size=2500) for n in obstacles.shape], axis=1)
    boxes = rng.integers(len(obstacles), size=1500)
    near = obstacles.cells[boxes] + rng.integers(-4, 5, (1500, 3))
    cells = np.vstack([cells, np.clip(near, 0, np.array(obstacles.shape) - 1)])
    centers = bound.origin + (cells + 0.5) * bound.cell_size
    levels = levels_of(bound, cells)
    true = true_distance(obstacles, centers)
    assert (levels * bound.step <= true).all()
    known = levels < bound.exact
    assert (true <= (levels + 1) * bound.step + 1e-9)[known].all()
    assert known[true < min(2.5 * CELL, cap) - 2 * bound.step].all()
    assert known.sum() > 300
    assert levels.max() * bound.step <= cap
    below = np.minimum(true, cap) - levels * bound.step
    assert below.max() <= np.sqrt(2.0) * CELL + bound.step + 1e-6


@pytest.mark.parametrize("corner", [(0.0, 0.0, 0.0), (0.63, 0.21, 0.0), (0.33, 0.97, 0.44)])
def test_bounds_hold_far_from_what_was_measured(corner):
    thing = np.array(corner) + np.random.default_rng(3).uniform(0.0, 0.08, (40, 3))
    obstacles = ObstacleSet.from_points(thing, bounds=((0.0, 0.0, 0.0), (0.7, 1.05, 0.53)))
    bound = distance_bound_field(obstacles, 0.15)
    cells = np.argwhere(np.ones(bound.shape, dtype=bool))
    levels = levels_of(bound, cells)
    assert (levels == levels.max()).mean() > 0.5
    centers = bound.origin + (cells + 0.5) * bound.cell_size
    true = np.full(len(centers), np.inf)
    for lower, upper in zip(obstacles.lower, obstacles.upper, strict=True):
        aside = np.maximum(np.maximum(lower - centers, centers - upper), 0.0)
        true = np.minimum(true, np.linalg.norm(aside, axis=1))
    assert (levels * bound.step <= true).all()
    below = np.minimum(true, 0.15) - levels * bound.step
    assert below.max() <= np.sqrt(2.0) * CELL + bound.step + 1e-6
    tiled = 4 * np.array(bound.levels.shape[:3])
    outside = np.argwhere(np.ones(tiled, dtype=bool))
    outside = outside[(outside >= bound.shape).any(axis=1)]
    assert len(outside)
    assert (levels_of(bound, outside) == 0.0).all()


def test_bound_of_an_empty_set_is_the_cap():
    empty = ObstacleSet.from_points(np.zeros((0, 3)), bounds=BOUNDS)
    bound = distance_bound_field(empty, 0.2)
    cells = np.argwhere(np.ones(empty.shape, dtype=bool))
    levels = levels_of(bound, cells)
    assert bound.shape == empty.shape
    assert (levels >= bound.exact).all()
    assert levels.min() * bound.step >= 0.2 - 1.01 * bound.step


def test_bad_lengths_are_refused(obstacles):
    with pytest.raises(ParameterError):
        distance_bound_field(obstacles, 0.0)
    with pytest.raises(ParameterError):
        ClearanceField(obstacles, VOLUME, cap=float("nan"))
    with pytest.raises(ParameterError):
        ClearanceField(obstacles, VOLUME, padding=-1.0)
    with pytest.raises(ParameterError, match="beyond"):
        ClearanceField(obstacles, VOLUME, beyond=-0.1)


def test_values_are_the_same_in_whatever_order_they_are_asked_for(obstacles):
    """Those beside V are made at once, further ones as they are asked for."""
    rng = np.random.default_rng(4)
    whole, grown = (ClearanceField(obstacles, VOLUME, 0.2) for _ in range(2))
    (table,) = whole.tables
    made = []
    for reach in (0.0, 0.1, 0.2, 0.9):
        for _ in range(4):
            corner = rng.uniform(VOLUME.lower - reach, VOLUME.upper + reach)
            points = corner + rng.uniform(-0.04, 0.04, (50, 3))
            np.testing.assert_array_equal(grown.distance(points), whole.distance(points))
            made.append(grown._tables[0]._filled)
            body, pose = rng.uniform(-0.05, 0.05, (200, 3)), np.eye(4)
            pose[:3, 3] = rng.uniform(VOLUME.lower - reach, VOLUME.upper + reach)
            one, two = (field.mean_clearance(pose, body) for field in (whole, grown))
            assert one[0] == two[0]
            np.testing.assert_array_equal(one[1], two[1])
    assert len(set(made)) > 2
    np.testing.assert_array_equal(grown.tables[0].values, table.values)
