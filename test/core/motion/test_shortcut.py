"""Random shortcutting on two-dimensional toys."""

from itertools import pairwise

import numpy as np
import pytest

from placement_planner_ros.core.motion.shortcut import shorten_path


def outside_disc(a, b):
    """Whether the segment stays out of the disc of radius 3 around (5, 5): exact."""
    d = b - a
    center = np.array([5.0, 5.0])
    t = np.clip(np.dot(center - a, d) / max(np.dot(d, d), 1e-300), 0.0, 1.0)
    return bool(np.linalg.norm(a + t * d - center) >= 3.0)


def length(path):
    return np.linalg.norm(np.diff(path, axis=0), axis=1).sum()


def wandering_path(rng, points=40):
    """A path around the disc whose edges are free, jittery and too long."""
    angles = np.linspace(np.pi * 1.25, np.pi * 0.25, points)
    radii = rng.uniform(3.3, 4.8, points)
    path = 5.0 + radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    assert all(outside_disc(a, b) for a, b in pairwise(path))
    return path


@pytest.mark.parametrize(("attempts", "tries"), [(100, 1), (400, 4)])
@pytest.mark.parametrize("seed", range(3))
def test_shorter_with_the_same_ends_and_free(seed, attempts, tries):
    rng = np.random.default_rng(seed)
    path = wandering_path(rng)
    copy = path.copy()
    result = shorten_path(path, outside_disc, rng, attempts, tries=tries)
    np.testing.assert_array_equal(path, copy)
    np.testing.assert_array_equal(result[[0, -1]], path[[0, -1]])
    outward = 5.0 + (result - 5.0) * (1.0 + 1e-9)  # parts of edges that graze are rounded
    assert all(outside_disc(a, b) for a, b in pairwise(outward))
    assert (np.diff(result, axis=0) != 0.0).any(axis=1).all()
    # the shortest way: two tangents and an arc
    r = np.linalg.norm(path[[0, -1]] - 5.0, axis=1)
    shortest = np.sqrt(r**2 - 9.0).sum() + 3.0 * (np.pi - np.arccos(3.0 / r).sum())
    assert shortest <= length(result) <= 1.08 * shortest
    assert length(result) < 0.8 * length(path)


def test_every_new_edge_was_asked_for():
    path = wandering_path(np.random.default_rng(3))
    certified = [*pairwise(path)]

    def record(a, b):
        free = outside_disc(a, b)
        if free:
            certified.append((a.copy(), b.copy()))
        return free

    def on(p, a, b):
        return np.linalg.norm(p - a) + np.linalg.norm(b - p) <= np.linalg.norm(b - a) + 1e-9

    for a, b in pairwise(shorten_path(path, record, np.random.default_rng(0), 60)):
        assert any(on(a, *edge) and on(b, *edge) for edge in certified)


def test_stop_ends_it_with_a_whole_path():
    path = wandering_path(np.random.default_rng(4))
    np.testing.assert_array_equal(
        shorten_path(path, outside_disc, np.random.default_rng(0), 50, lambda: True), path
    )
    asked = 0

    def count(a, b):
        nonlocal asked
        asked += 1
        return outside_disc(a, b)

    result = shorten_path(path, count, np.random.default_rng(0), 10**9, lambda: asked >= 20)
    assert asked == 20
    np.testing.assert_array_equal(result[[0, -1]], path[[0, -1]])
    assert length(result) < length(path)


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ([[1.0, 2.0]], [[1.0, 2.0]]),
        ([[1.0, 2.0], [1.0, 2.0]], [[1.0, 2.0]]),
        ([[1.0, 2.0], [3.0, 2.0]], [[1.0, 2.0], [3.0, 2.0]]),
        ([[0.0, 0.0], [0.0, 0.0], [0.0, 1.0], [0.0, 1.0]], [[0.0, 0.0], [0.0, 1.0]]),
    ],
)
def test_degenerate_paths(path, expected):
    result = shorten_path(np.array(path), lambda a, b: True, np.random.default_rng(0), 10)
    np.testing.assert_array_equal(result, expected)
