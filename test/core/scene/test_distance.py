"""The clearance field and the distance bound, against brute force over the boxes."""

import numpy as np
import pinocchio as pin
import pytest
from test_grid import BOUNDS, plane

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.scene.distance import ClearanceField
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


def exact(obstacles, points, tolerance=0.003, cap=0.5):
    """d_S by definition; the tolerance may be one for each point."""
    tolerance = np.broadcast_to(tolerance, len(points))
    touching = ((obstacles.upper >= VOLUME.lower) & (obstacles.lower <= VOLUME.upper)).all(axis=1)
    lower, upper = obstacles.lower[touching], obstacles.upper[touching]
    result = np.full(len(points), cap)
    for row, p in enumerate(points):
        gap = np.maximum(np.maximum(lower - p, p - upper), 0.0)
        gap[:, 2] = np.maximum(lower[:, 2] - p[2], 0.0)
        counted = np.linalg.norm(gap, axis=1)[upper[:, 2] >= p[2] + tolerance[row]]
        result[row] = min(cap, counted.min(initial=np.inf))
    return result


def test_values_are_exact_at_the_grid_points(obstacles, field):
    rng = np.random.default_rng(0)
    _, nz, nx, ny = field.values.shape
    k, i, j = (rng.integers(n, size=1500) for n in (nz, nx, ny))
    points = field.origin + CELL * np.stack([i, j, k], axis=1)
    for values, tolerance in zip(field.values, (0.003, 1e-6), strict=True):
        error = np.abs(values[k, i, j] - exact(obstacles, points, tolerance))
        assert np.quantile(error, 0.95) < 1e-6
        assert error.max() < 0.5 * CELL


def test_queries_are_within_the_stated_bound_of_the_layer_above(obstacles, field):
    rng = np.random.default_rng(1)
    points = rng.uniform((-0.45, -0.45, 0.005), (0.45, 0.4, 0.34), (1500, 3))
    layer = points.copy()
    layer[:, 2] = field.origin[2] + CELL * np.ceil((points[:, 2] - field.origin[2]) / CELL)
    below = np.where(layer[:, 2] - points[:, 2] > 0.003, 1e-6, 0.003)
    error = np.abs(field.distance(points) - exact(obstacles, layer, below))
    assert error.max() < 1.2 * CELL
    assert np.median(np.abs(field.distance(points) - exact(obstacles, points))) < 0.5 * CELL


def test_floor_below_does_not_count_but_what_is_above_does(field):
    points = np.array([[-0.1, -0.05, z] for z in (0.0067, 0.1, 0.2, 0.2599)])
    distance = field.distance(points)
    can = np.hypot(0.2, 0.1) - 0.034
    np.testing.assert_allclose(distance[:3], [can, 0.1512, 0.0512], atol=CELL)
    assert distance[3] > 0.3  # the shelf lies below, the wall is far


def test_a_flat_ceiling_counts_wherever_it_lies_in_its_cell():
    rng = np.random.default_rng(4)
    for offset in np.arange(0.0, 0.01, 0.001):
        face = BOUNDS[0][2] - 0.03 * CELL + 41 * CELL  # between two layers of cells
        height = face + offset
        ceiling = plane((-0.2, -0.2, height), (0.2, 0.2, height))
        obstacles = ObstacleSet.from_points(ceiling, bounds=BOUNDS)
        field = ClearanceField(obstacles, VOLUME)
        points = np.c_[rng.uniform(-0.19, 0.19, (300, 2)), rng.uniform(0.15, face - 0.0031, 300)]
        error = field.distance(points) - (height - points[:, 2])
        assert np.abs(error).max() < CELL + 1e-6


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
        points = np.c_[rng.uniform(-0.2, 0.2, (200, 2)), np.full(200, height + 0.0005)]
        assert (field.distance(points) == 0.5).all()


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
