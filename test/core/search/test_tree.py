"""The tree alone: it stays within its bound, and its links and counts hold."""

import numpy as np
import pytest

from placement_planner_ros.core.search.tree import SearchTree


class Tuples:
    """Tuples of digits as nodes, which are sampled from length 2 on."""

    MIN_SAMPLE_DEPTH = 2
    root = ()

    def __init__(self, width: int, length: int) -> None:
        self._width, self._length = width, length

    def child_count(self, node):
        return self._width if len(node) < self._length else 0

    def child(self, node, index):
        return (*node, index)


def test_the_tree_stays_within_its_bound_and_goes_on_sampling():
    tree = SearchTree(Tuples(10, 30), 0.5, 50, np.random.default_rng(0))
    for _ in range(2000):
        node = tree.select()
        assert len(tree.nodes[node]) >= 2
        tree.update(node, 1, 0.5)
    assert len(tree.nodes) <= 52
    assert tree.visits[0] == 2000
    assert tree.rewards[0] == 1000.0


def test_visits_and_rewards_of_a_node_are_its_own_and_those_below():
    tree = SearchTree(Tuples(4, 9), 3.0, 5000, np.random.default_rng(1))
    rng, own = np.random.default_rng(1), np.zeros((5002, 2))
    for _ in range(4000):
        node = tree.select()
        reward = float(rng.integers(8)) / 8
        tree.update(node, 1, reward)
        own[node] += 1, reward
    assert len(set(tree.nodes)) == len(tree.nodes) > 2048
    for child, node in enumerate(tree.parent[1 : len(tree.nodes)].tolist(), 1):
        assert tree.nodes[child][:-1] == tree.nodes[node]
    for child in range(len(tree.nodes) - 1, 0, -1):
        assert [tree.visits[child], tree.rewards[child]] == own[child].tolist()
        own[tree.parent[child]] += own[child]
        assert tree.is_leaf(child) == (len(tree.nodes[child]) == 9)
    assert tree.visits[0] == 4000
    assert tree.rewards[0] == pytest.approx(own[0, 1])
