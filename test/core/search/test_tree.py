"""The tree search alone: Algorithm 3 against a literal transcription, and what a rising ξ does."""

import math

import numpy as np
import pytest

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.search.tree import SearchTree


def binary(node: tuple[int, ...]) -> list[tuple[int, ...]]:
    return [(*node, 0), (*node, 1)] if len(node) < 4 else []


class Hierarchy:
    root = ()

    def __init__(self, children) -> None:
        self._children = children

    def child_count(self, node):
        return len(self._children(node))

    def child(self, node, index):
        return self._children(node)[index]


def make(children=binary, min_depth=2, c=0.5, max_nodes=1000, seed=0) -> SearchTree:
    rng = np.random.default_rng(seed)
    return SearchTree(Hierarchy(children), min_depth, c, max_nodes, rng)


def test_when_the_best_value_jumps_visits_leave_what_holds_nothing_better():
    """Branch (0, *) is always valid at ξ = 1; branch (1, *) seldom, but at ξ = 2."""
    rng = np.random.default_rng(0)
    tree = make(c=0.2)
    best = -math.inf

    def run(samples: int) -> float:
        in_zero = 0
        for _ in range(samples):
            node = tree.select()
            zero = tree[node][0] == 0
            in_zero += zero
            value = 1.0 if zero else (2.0 if rng.uniform() < 0.3 else -math.inf)
            if value > best:
                tree.update(node, 1.0, value, 0.4)
            else:
                tree.update(node, 0.4 if value > -math.inf else 0.3, -math.inf, 0.4)
        return in_zero / samples

    run(300)
    before = run(300)
    best = 1.0
    tree.raise_threshold(best)
    run(100)
    after = run(300)
    assert before > 0.8
    assert after < 0.3


def test_the_tree_stays_within_its_bound_and_goes_on_sampling():
    def wide(node):
        return [(*node, i) for i in range(10)] if len(node) < 30 else []

    tree = make(children=wide, max_nodes=50)
    for _ in range(2000):
        node = tree.select()
        assert len(tree[node]) >= 2
        tree.update(node, 0.5, 1.0, 0.1)
    assert len(tree) <= 52
    assert tree.visits(0) == 2000
    assert len(tree._records) <= 50
    # What there was no room to remember counts as overtaken already.
    kept = len(tree._records)
    assert tree.reward(0) == pytest.approx(0.5 * kept + 0.1 * (2000 - kept))


def test_a_hierarchy_without_anything_to_sample_is_refused():
    tree = make(children=lambda node: [])
    with pytest.raises(ParameterError, match="no children"):
        tree.select()


def test_a_tree_that_outgrows_its_arrays_loses_nothing():
    """Visits and rewards of each node are its own and those of its children, and links hold."""

    def wide(node):
        return [(*node, i) for i in range(4)] if len(node) < 9 else []

    tree = make(children=wide, min_depth=1, c=3.0, max_nodes=5000)
    rng = np.random.default_rng(1)
    own = {}
    for _ in range(4000):
        node = tree.select()
        reward = float(rng.integers(8)) / 8
        tree.update(node, reward, -math.inf, 0.0)
        visits, total = own.get(node, (0, 0.0))
        own[node] = visits + 1, total + reward
    assert len(tree) > 2048  # the arrays have been doubled twice
    assert len({tree[n] for n in range(len(tree))}) == len(tree)
    parents = {}
    for node in range(len(tree)):
        below = tree.added_children(node)
        visits, reward = own.get(node, (0, 0.0))
        assert tree.visits(node) == visits + sum(tree.visits(c) for c in below)
        assert tree.reward(node) == reward + sum(tree.reward(c) for c in below)
        assert tree.is_leaf(node) == (len(tree[node]) == 9)
        for child in below:
            assert child not in parents
            assert tree[child][:-1] == tree[node]
            parents[child] = node
    assert sorted(parents) == list(range(1, len(tree)))


@pytest.mark.parametrize(
    ("name", "value"), [("exploration", -1e-9), ("exploration", math.nan), ("max_nodes", 1)]
)
def test_trees_of_no_use_are_refused(name, value):
    with pytest.raises(ParameterError, match=name):
        make(**{"c" if name == "exploration" else name: value})
    make(c=0.0, max_nodes=2)
