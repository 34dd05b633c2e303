"""Timed curves: limits, continuity, and that what is certified is what a controller plays.

The evaluator here solves for each quintic's coefficients itself and shares nothing with the code.
"""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import cKDTree

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.timing.quintic import positions_at
from placement_planner_ros.core.timing.timing import CurveSettings, parameterize_path

JOINTS = ("a", "b")
VELOCITY = np.array([1.0, 2.0])
ACCELERATION = np.array([4.0, 3.0])
LIMITS = np.stack([VELOCITY, ACCELERATION])


def always(a, b, deviation):
    return True


def sample(trajectory, per_piece=40):
    """Dense t, q, v, a of the quintics, from the linear system of each piece."""
    t_all, q_all, v_all, a_all = [], [], [], []
    for i in range(len(trajectory.times) - 1):
        h = trajectory.times[i + 1] - trajectory.times[i]
        powers = np.arange(6)

        def rows(t, powers=powers):
            t = np.atleast_1d(t)[:, None]
            one = t**powers
            two = powers * t ** np.maximum(powers - 1, 0)
            three = powers * (powers - 1) * t ** np.maximum(powers - 2, 0)
            return one, two, three

        system = np.vstack([*rows(0.0), *rows(h)])
        ends = np.vstack(
            [
                getattr(trajectory, name)[k]
                for k in (i, i + 1)
                for name in ("positions", "velocities", "accelerations")
            ]
        )
        coefficients = np.linalg.solve(system, ends)
        t = np.linspace(0.0, h, per_piece)
        for target, matrix in zip((q_all, v_all, a_all), rows(t), strict=True):
            target.append(matrix @ coefficients)
        t_all.append(trajectory.times[i] + t)
    return tuple(np.concatenate(x) for x in (t_all, q_all, v_all, a_all))


def distance_to_polyline(points, path):
    best = np.full(len(points), np.inf)
    for a, b in pairwise(path):
        d = b - a
        s = np.clip((points - a) @ d / max(d @ d, 1e-300), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - a - s[:, None] * d, axis=1))
    return best


def assert_sound(trajectory, path, velocity, acceleration, deviation):
    np.testing.assert_array_equal(trajectory.positions[0], path[0])
    np.testing.assert_array_equal(trajectory.positions[-1], path[-1])
    for ends in (trajectory.velocities[[0, -1]], trajectory.accelerations[[0, -1]]):
        np.testing.assert_array_equal(ends, 0.0)
    assert trajectory.times[0] == 0.0
    assert (np.diff(trajectory.times) > 0.0).all()
    _, q, v, a = sample(trajectory)
    assert (np.abs(v) <= velocity * (1.0 + 1e-6)).all()
    assert (np.abs(a) <= acceleration * (1.0 + 1e-6)).all()
    assert distance_to_polyline(q, path).max() <= deviation
    from_curve, _ = cKDTree(q).query(path)
    assert max(from_curve) <= deviation + 0.05, "no waypoint is left out"


def random_path(rng, dof, points, step):
    return np.cumsum(rng.normal(size=(points, dof)) * step, axis=0)


@pytest.mark.parametrize("seed", range(5))
def test_random_paths_keep_limits_and_polyline(seed):
    rng = np.random.default_rng(seed)
    dof = int(rng.integers(1, 8))
    path = random_path(rng, dof, int(rng.integers(2, 15)), 10.0 ** rng.uniform(-2.5, 0.5))
    velocity, acceleration = rng.uniform(0.1, 6.0, dof), rng.uniform(0.5, 20.0, dof)
    trajectory = parameterize_path(
        path, [f"j{i}" for i in range(dof)], np.stack([velocity, acceleration]), always
    )
    assert_sound(trajectory, path, velocity, acceleration, 0.2)


def test_a_straight_line_takes_about_the_shortest_time():
    path = np.array([[0.0, 0.0], [1.5, 0.3]])
    trajectory = parameterize_path(path, JOINTS, LIMITS, always)
    assert_sound(trajectory, path, VELOCITY, ACCELERATION, 1e-9)
    shortest = 1.5 / 1.0 + 1.0 / 4.0  # trapezoid of the first joint
    assert shortest <= trajectory.duration <= 1.1 * shortest


@pytest.mark.parametrize("seed", range(3))
def test_every_point_of_the_curve_lies_within_a_certified_chord(seed):
    rng = np.random.default_rng(seed)
    path = random_path(rng, 3, 6, 0.5)
    certified = []

    def record(a, b, deviation):
        if rng.random() < 0.1 and deviation.max() > 1e-4:
            return False  # now and then, to see finer chords
        certified.append((a.copy(), b.copy(), deviation.copy()))
        return True

    velocity, acceleration = np.full(3, 1.5), np.full(3, 5.0)
    trajectory = parameterize_path(path, "abc", np.stack([velocity, acceleration]), record)
    _, q, _, _ = sample(trajectory)
    covered = np.zeros(len(q), dtype=bool)
    for a, b, deviation in certified:
        assert deviation.shape == (3,)
        assert (deviation > 0.0).all()
        assert deviation.max() <= CurveSettings().chord_tolerance
        d = b - a
        # the chord points within reach of q, coordinate by coordinate: an interval each
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.sort(((q - a)[:, :, None] + np.array([-1, 1]) * deviation[:, None]) / d[:, None])
        low, high = np.maximum(t[:, :, 0].max(axis=1), 0), np.minimum(t[:, :, 1].min(axis=1), 1)
        covered |= low <= high + 1e-12
    assert covered.all()


def test_refused_everywhere_gives_none():
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    assert parameterize_path(path, JOINTS, LIMITS, lambda a, b, d: False) is None


def test_where_only_the_polyline_is_free_it_stops_at_each_waypoint():
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [2.0, 1.5]])

    def on_polyline(a, b, deviation):
        ends = distance_to_polyline(np.array([a, b, 0.5 * (a + b)]), path)
        return bool(max(ends.max(), deviation.max()) < 1e-8)

    trajectory = parameterize_path(path, JOINTS, LIMITS, on_polyline)
    assert_sound(trajectory, path, VELOCITY, ACCELERATION, 1e-8)
    for waypoint in path[1:-1]:
        (k,) = np.flatnonzero((trajectory.positions == waypoint).all(axis=1))
        np.testing.assert_array_equal(trajectory.velocities[k], 0.0)


def test_repeated_waypoints_and_paths_that_do_not_move():
    path = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.0, 1e-12], [1.0, 1.0], [1.0, 1.0]])
    trajectory = parameterize_path(path, JOINTS, LIMITS, always)
    assert_sound(trajectory, path, VELOCITY, ACCELERATION, 0.2)
    for still in ([[1.0, 2.0]], [[1.0, 2.0], [1.0, 2.0]]):
        trajectory = parameterize_path(np.array(still), JOINTS, LIMITS, always)
        np.testing.assert_array_equal(trajectory.positions, [[1.0, 2.0]])
        np.testing.assert_array_equal(trajectory.velocities, 0.0)
        assert trajectory.duration == 0.0


def test_positions_are_the_quintics_and_stand_still_outside():
    path = random_path(np.random.default_rng(0), 2, 5, 1.0)
    trajectory = parameterize_path(path, JOINTS, LIMITS, always)
    t, q, _, _ = sample(trajectory)
    np.testing.assert_allclose(positions_at(trajectory, t), q, rtol=0.0, atol=1e-8)
    outside = positions_at(trajectory, np.array([-1.0, trajectory.duration + 1.0]))
    np.testing.assert_array_equal(outside, path[[0, -1]])


def test_stop_gives_none():
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    stopped = parameterize_path(path, JOINTS, LIMITS, always, should_stop=lambda: True)
    assert stopped is None


def test_a_setting_out_of_range_is_named():
    with pytest.raises(ParameterError, match="max_interval"):
        CurveSettings(max_interval=0.0)
