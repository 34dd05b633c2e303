"""Distances and bounds of the kernels against brute force: all faces, all boxes."""

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from placement_planner_ros.core.collision.against_boxes import distance_bounds
from placement_planner_ros.core.collision.boxes import box_arrays
from placement_planner_ros.core.collision.separation import sets_keep
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet

NEAR = 1e-5
"""m, more than what thresholds must be passed by."""


def distance(a, b):
    """Between two hulls (m, 3) and (n, 3), by every face of their Minkowski difference.

    Where they overlap, how deep, below zero.
    """
    hull = ConvexHull((a[:, None] - b).reshape(-1, 3))
    if (hull.equations[:, 3] < 0.0).all():
        return float(hull.equations[:, 3].max())
    nearest = trimesh.triangles.closest_point(
        hull.points[hull.simplices], np.zeros((len(hull.simplices), 3))
    )
    return float(np.linalg.norm(nearest, axis=1).min())


def corners_of(box):
    return np.array(np.meshgrid(*box.reshape(2, 3).T)).reshape(3, -1).T


def thing(rng):
    size = rng.choice([0.02, 0.1, 0.3], 3)
    return rng.normal(size=(int(rng.integers(4, 20)), 3)) * size


def cases(rng, count):
    """Hulls, the other as hull or box (1, 6), and their distance."""
    for k in range(count):
        a = thing(rng) + rng.normal(size=3) * rng.choice([0.1, 0.5, 1.5])
        if k % 2:
            box = np.concatenate([-rng.uniform(0.01, 0.3, 3), rng.uniform(0.01, 0.3, 3)])
            yield a, box[None], distance(a, corners_of(box))
        else:
            b = thing(rng)
            yield a, b, distance(a, b)


def support(other, n):
    """max of n over what `other` says."""
    corners = corners_of(other[0]) if other.shape[1] == 6 else other
    return (corners @ n).max()


def asked(a, other, distance, start):
    """The kernel's answer, with rows of other sets around those that are asked for."""
    work = np.zeros((9, 4))
    work[5, :3] = start
    around = np.full((2, 3), 1e3)
    outside = np.full((3, other.shape[1]), -1e3)
    first = np.vstack([around, a, around]), 2, 2 + len(a)
    second = np.vstack([outside, other, outside]), 3, 3 + len(other)
    return sets_keep(first, second, distance, work), work[5, :3]


def test_convex_sets_are_as_far_apart_as_all_faces_of_their_difference_say():
    rng = np.random.default_rng(0)
    apart = overlapping = 0
    for a, other, d in cases(rng, 300):
        start = rng.normal(size=3) * rng.choice([0.0, 1e-3, 1.0])
        if d > 1e-3:
            apart += 1
            answer, n = asked(a, other, d - NEAR, start)
            assert answer
            assert (a @ n).min() - support(other, n) >= (d - NEAR) * np.linalg.norm(n)
            assert not asked(a, other, d + NEAR, start)[0]
        elif d < -1e-3:
            overlapping += 1
            assert not asked(a, other, 0.0, start)[0]
    assert apart > 100
    assert overlapping > 50


def test_the_field_bounds_the_distance_of_any_point_to_all_boxes():
    rng = np.random.default_rng(2)
    points = rng.uniform([0.0, -0.2, 0.1], [0.35, 0.15, 0.3], (30, 3))
    made = ObstacleSet.from_points(
        points, GridSettings(cell_size=0.01), bounds=np.array([[-0.2, -0.4, 0.0], [0.5, 0.3, 0.5]])
    )
    boxes = box_arrays(made)
    step = 0.3 / 255

    def brute_force(p):
        away = np.maximum(np.maximum(made.lower - p, p - made.upper), 0.0)
        return np.linalg.norm(away, axis=1).min()

    near = far = outside = 0
    anywhere = rng.uniform([-0.3, -0.5, -0.1], [0.6, 0.4, 0.6], (3000, 3))
    for p in (*anywhere, *(rng.choice(points, 500) + 0.01 * rng.normal(size=(500, 3)))):
        d = brute_force(p)
        lower, upper = distance_bounds(boxes.field_grid, boxes.field, *p)
        assert lower <= d + 1e-9
        assert d <= upper + 1e-9
        nearest = np.clip(p, made.origin, made.origin + 0.01 * np.array(made.shape))
        if (beyond := np.linalg.norm(p - nearest)) > 0.0:
            outside += 1
            assert lower >= np.hypot(beyond, max(min(brute_force(nearest), 0.25) - 0.04, 0.0))
            continue
        cell = np.floor((p - made.origin) / 0.01)
        center = made.origin + (cell + 0.5) * 0.01
        off, at_center = np.linalg.norm(p - center), brute_force(center)
        if at_center < 0.024:
            near += 1
            assert at_center - step - 1e-6 <= lower + off <= at_center + 1e-6
            assert at_center - 1e-6 <= upper - off <= at_center + step + 1e-6
        elif at_center < 0.25:
            far += 1
            assert at_center - step - 0.0142 <= lower + off <= at_center + 1e-6
    assert min(near, far, outside) > 50
