"""A thin ring in the plane: nothing random lies on it, and straight edges leave it."""

import itertools

import numpy as np
import pytest

from placement_planner_ros.core.motion.birrt import GoalSetRRT, GoalSetRRTSettings
from placement_planner_ros.core.motion.shortcut import shorten_path

INNER, OUTER = 0.98, 1.02
LOWER, UPPER = np.array([-1.5, -1.5]), np.array([1.5, 1.5])
START, GOAL = np.array([1.0, 0.0]), np.array([-1.0, 0.0])
SETTINGS = GoalSetRRTSettings(max_step=0.8)


class Ring:
    """Radii between two, exactly: the furthest of an edge is an end, the nearest its foot."""

    def project(self, q):
        radius = float(np.linalg.norm(q))
        if INNER <= radius <= OUTER:
            return q
        return q / radius if radius > 1e-3 else None

    def keeps(self, a, b):
        s = np.clip(-(a @ (b - a)) / max((b - a) @ (b - a), 1e-300), 0.0, 1.0)
        ends = max(np.linalg.norm(a), np.linalg.norm(b))
        return bool(ends <= OUTER + 1e-12 and np.linalg.norm(a + s * (b - a)) >= INNER)


class Blocked(Ring):
    """The same with a wall across the upper half."""

    def is_free(self, a, b):
        s = np.linspace(0.0, 1.0, 50)[:, None]
        points = a + s * (b - a)
        return not ((np.abs(points[:, 0]) < 0.1) & (points[:, 1] > 0.0)).any()


def assert_on_ring(path, ring):
    for a, b in itertools.pairwise(path):
        assert ring.keeps(a, b)


@pytest.mark.parametrize("seed", range(2))
def test_a_way_is_found_along_the_ring(seed):
    ring = Blocked()
    rng = np.random.default_rng(seed)
    rrt = GoalSetRRT(LOWER, UPPER, START, ring.is_free, SETTINGS, rng, ring)
    rrt.add_goal(0, GOAL)
    found = rrt.solve(300)
    assert found is not None
    key, path = found
    assert key == 0
    np.testing.assert_array_equal(path[[0, -1]], [START, GOAL])
    assert_on_ring(path, ring)
    assert path[:, 1].min() < -0.9, "below the wall"
    nodes, parents, _ = rrt.trees()
    for node, parent in zip(nodes, parents, strict=True):
        assert parent < 0 or ring.keeps(nodes[parent], node)


def test_shortcuts_follow_the_ring_and_never_lengthen():
    ring, rng = Ring(), np.random.default_rng(1)
    angles = np.concatenate([np.linspace(0.0, 2.5, 60), np.linspace(2.5, 1.5, 30)])
    radii = rng.uniform(0.99, OUTER, len(angles))
    path = radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    assert_on_ring(path, ring)
    before = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    short = shorten_path(path, ring.keeps, rng, constraint=ring)
    assert_on_ring(short, ring)
    np.testing.assert_array_equal(short[[0, -1]], path[[0, -1]])
    after = np.linalg.norm(np.diff(short, axis=0), axis=1).sum()
    assert after <= before
    assert after < 1.02 * 1.5
