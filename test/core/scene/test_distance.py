"""The clearance field and the distance bound, against brute force over the boxes."""

import numpy as np
import pinocchio as pin
import pytest
from test_grid import BOUNDS, plane

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


def exact(obstacles, points, cap=0.5):
    """Mean of d_S, by definition, from half a voxel below to half a voxel above the points."""
    touching = ((obstacles.upper >= VOLUME.lower) & (obstacles.lower <= VOLUME.upper)).all(axis=1)
    lower, upper = obstacles.lower[touching], obstacles.upper[touching]
    c, s, *sides = obstacles.outline[touching].T
    heights = 0.005 * ((np.arange(20) + 0.5) / 20 - 0.5)
    result = np.empty(len(points))
    for row, p in enumerate(points):
        u, v = c * p[0] + s * p[1], c * p[1] - s * p[0]
        aside = np.maximum(np.maximum(sides[0] - u, u - sides[1]), 0.0) ** 2
        aside += np.maximum(np.maximum(sides[2] - v, v - sides[3]), 0.0) ** 2
        z = p[2] + heights[:, None]
        gap = np.sqrt(aside + np.maximum(lower[:, 2] - z, 0.0) ** 2)
        counted = np.minimum(upper[:, 2], VOLUME.upper[2]) >= z
        result[row] = np.minimum(np.where(counted, gap, cap).min(axis=1), cap).mean()
    return result


def test_values_are_those_of_the_definition(obstacles, field):
    """Also between the grid points; where a thing ends, what is averaged over differs by little."""
    rng = np.random.default_rng(0)
    nx, ny, nz = field.values.shape
    i, j, k = (rng.integers(n - 1, size=1200) for n in (nx, ny, nz))
    points = field.origin + np.stack([CELL * i, CELL * j, field.level * k], axis=1)
    error = np.abs(field.values[i, j, k] - exact(obstacles, points))
    assert np.quantile(error, 0.9) < 1e-3
    assert np.quantile(error, 0.99) < 0.5 * CELL
    assert error.max() <= 0.5 / 20  # where all ends, of 20 heights one is in doubt
    points = rng.uniform((-0.45, -0.45, 0.005), (0.45, 0.4, 0.34), (1200, 3))
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
    for _ in range(6):
        z = rng.uniform(0.0, 0.01)
        clouds = [plane((-0.4, -0.4, z), (0.4, 0.4, z), 0.004)]
        solids = []
        for n in range(6):
            half = rng.uniform(0.015, 0.04, 2) if n else np.array([0.04, 0.001])
            at = rng.uniform(-0.25, 0.25, 2)
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
                np.append(rng.uniform(-0.25, 0.25, 2), z),
            )
            size = rng.choice([0.02, 0.06, 0.11])
            line = np.arange(0.0025, 0.05, 0.005)
            up = np.arange(0.0025, size, 0.005)
            body = np.stack(np.meshgrid(line, line, up), axis=-1).reshape(-1, 3)
            world = body @ pose.rotation.T + pose.translation
            if true_distance_to(solids, world).min() > 0.0:
                poses.append((pose, body, true_distance_to(solids, world).mean()))
        found = []
        for _ in range(6):
            low = np.array([-0.45, -0.45, -0.1]) - rng.uniform(0.0, 0.01, 3)
            obstacles = ObstacleSet.from_points(cloud, bounds=(low, np.add(low, (0.9, 0.9, 0.6))))
            field = ClearanceField(obstacles, VOLUME)
            found.append([field.mean_clearance(p.homogeneous, b)[0] for p, b, _ in poses])
        found = np.array(found)
        spread.append(np.ptp(found, axis=0))
        off.append(np.abs(found - [true for *_, true in poses]))
    assert np.max(spread) < 2e-3
    assert np.max(off) < 3e-3


def test_a_field_over_any_volume_is_bounded(obstacles):
    """Its lines and levels are further apart, and values less exact, not more of them."""
    wide = TargetVolume(np.array([-4.0, -4.0, -1.0]), np.array([4.0, 4.0, 3.0]))
    field = ClearanceField(obstacles, wide)
    assert field.values.size <= MAX_VALUES
    assert field.cell_size > CELL
    rng = np.random.default_rng(1)
    points = rng.uniform((-0.45, -0.45, 0.005), (0.45, 0.4, 0.34), (800, 3))
    error = np.abs(field.distance(points) - ClearanceField(obstacles, VOLUME).distance(points))
    assert np.median(error) < 0.5 * field.cell_size


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
    inner = np.abs((points[:, :2] - field.origin[:2]) / CELL % 1.0 - 0.5).max(axis=1) < 0.49
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
