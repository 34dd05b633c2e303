"""Accumulated points, against a plain loop over all of them."""

import numpy as np

from placement_planner_ros.ros.inputs.merged_points import MergedPoints


def plainly(clouds, edge):
    """The first point of each cube, in the order in which they come."""
    first = {}
    for point in np.vstack(clouds):
        first.setdefault(tuple(np.floor(point / edge)), point)
    return np.array(list(first.values())).reshape(-1, 3)


def test_of_each_cube_the_first_point_stays():
    rng = np.random.default_rng(0)
    clouds = [rng.normal(0.0, 0.03, (400, 3)) for _ in range(6)]
    merged = MergedPoints.of(np.empty((0, 3)), 0.01)
    for count, cloud in enumerate(clouds, 1):
        before = merged.points.copy()
        merged = merged.with_points(cloud, 0.01)
        np.testing.assert_array_equal(merged.points, plainly(clouds[:count], 0.01))
        np.testing.assert_array_equal(merged.points[: len(before)], before)
    assert merged.with_points(clouds[0], 0.01) is merged
    assert merged.with_points(np.empty((0, 3)), 0.01) is merged
    assert merged.with_points(np.full((1, 3), 1e6), 0.01) is merged


def test_with_other_cubes_all_are_thinned_anew():
    rng = np.random.default_rng(1)
    one, other = rng.normal(0.0, 0.03, (2, 500, 3))
    merged = MergedPoints.of(one, 0.005)
    for edge in (0.02, 0.0025):
        expected = plainly([merged.points, other], edge)
        np.testing.assert_array_equal(merged.with_points(other, edge).points, expected)


def test_what_is_taken_away_can_come_again():
    points = np.random.default_rng(2).normal(0.0, 0.03, (500, 3))
    merged = MergedPoints.of(points, 0.01)
    gone = merged.points[:, 0] > 0.0
    left = merged.without(gone)
    np.testing.assert_array_equal(left.points, merged.points[~gone])
    again = left.with_points(merged.points[gone], 0.01)
    np.testing.assert_array_equal(again.points, np.vstack([left.points, merged.points[gone]]))
    assert merged.without(np.zeros(len(merged.points), bool)) is merged
