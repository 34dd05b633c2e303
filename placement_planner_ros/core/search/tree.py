"""Monte-Carlo tree over the AFR hierarchy: UCB1 with child addition (Algorithm 3).

Its numbers v(n), r(n) and its links live in flat arrays, so that one descent is one compiled call.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement_planner_ros.core.search.hierarchy import AfrHierarchy, AfrNode
from placement_planner_ros.core.types import Array, Index, Index32
from placement_planner_ros.core.uncounted import Uncounted

Links = Index32
Counts = Index


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _descend_tree(
    node: int,
    depth: int,
    min_depth: int,
    c: float,
    may_add: bool,
    links: tuple[Links, Links],
    children: tuple[Links, Links],
    counts: tuple[Counts, Array],
) -> tuple[int, int, bool]:
    """Follow SelectChild (Algorithm 3) from `node` until one is to be sampled or a child added.

    UCB1: the child with the greatest r(n)/v(n) + c sqrt(2 ln v(parent) / v(n)). A child that is not
    in the tree yet counts as one with the mean of the j that are, and j visits.

    Args:
        links: first child and next sibling of each node, -1 without one.
        children: how many of its children are in the tree, and how many it has, -1 if not known.
        counts: v and r.

    Returns:
        the node, its depth, and whether a child is to be added to it.
    """
    first_child, next_sibling = links
    added, total = children
    visits, rewards = counts
    while True:
        # A new node is sampled before it is descended, and so is a leaf.
        if depth >= min_depth and (visits[node] == 0 or total[node] == 0):
            return node, depth, False
        if total[node] < 0 or added[node] == 0:
            return node, depth, depth < min_depth or may_add
        # UCB1 of the children in the tree.
        log_visits = np.log(visits[node])
        best, best_child, mean_sum = -np.inf, -1, 0.0
        child = first_child[node]
        while child >= 0:
            # Mean reward, and the width of its confidence bound.
            mean = rewards[child] / visits[child]
            u = mean + c * np.sqrt(2.0 * log_visits / visits[child])
            mean_sum += mean
            if u > best:
                best, best_child = u, child
            child = next_sibling[child]
        # A further one.
        if added[node] < total[node] and may_add:
            j = added[node]
            u_new = mean_sum / j + c * np.sqrt(2.0 * log_visits / j)
            if u_new > best:
                return node, depth, True
        # Down to the best child.
        node = best_child
        depth += 1


class SearchTree:
    """G_s: the part of the hierarchy that has been visited, with v(n), r(n) and Ch(n, G_s).

    Args:
        hierarchy: Ch(n); asked for a child only when it is added.
        exploration: c of UCB1.
        max_nodes: once reached, no further child is added below the depth from which nodes can be
            sampled.
        rng: chooses which child is added next.

    Attributes:
        nodes: what is in the tree, the root first.
        parent: of each.
        visits, rewards: v(n) and r(n).
    """

    def __init__(
        self, hierarchy: AfrHierarchy, exploration: float, max_nodes: int, rng: np.random.Generator
    ) -> None:
        self._hierarchy = hierarchy
        self._exploration = exploration
        self._max_nodes = max_nodes
        self._rng = rng
        self._waiting: dict[int, list[int]] = {}  # children that are not in the tree yet
        # Room for a few more, that are added above where nodes are sampled.
        size = max_nodes + hierarchy.MIN_SAMPLE_DEPTH
        self.parent, self._first_child, self._next_sibling = np.full((3, size), -1, np.int32)
        self._added, self._total = np.zeros(size, np.int32), np.full(size, -1, np.int32)
        self.visits, self.rewards = np.zeros(size, np.int64), np.zeros(size)
        self.nodes: list[AfrNode] = [hierarchy.root]

    def select(self) -> int:
        """SelectAfrNode: the node to sample next, by UCB1 from the root on."""
        node, depth, add = 0, 0, True
        while True:
            # Down as far as the tree goes, in one compiled call.
            may_add = len(self.nodes) < self._max_nodes
            links, children = (self._first_child, self._next_sibling), (self._added, self._total)
            given = self._hierarchy.MIN_SAMPLE_DEPTH, self._exploration, may_add, links, children
            node, depth, add = _descend_tree(node, depth, *given, (self.visits, self.rewards))
            if not add or self.is_leaf(node):
                return node
            # Add a child, and go on from there.
            if self._added[node] < self._total[node]:
                node = self._add_child(node)
                depth += 1

    def is_leaf(self, node: int) -> bool:
        """Whether the hierarchy has no children below this node."""
        if self._total[node] < 0:
            self._total[node] = self._hierarchy.child_count(self.nodes[node])
        return bool(self._total[node] == 0)

    def update(self, node: int, visits: int, reward: float) -> None:
        """Update: add to v and r of a node and of its ancestors."""
        while node >= 0:
            self.visits[node] += visits
            self.rewards[node] += reward
            node = int(self.parent[node])

    def _add_child(self, node: int) -> int:
        # One of those that are not in the tree yet, swapped to the end to be taken from there.
        waiting = self._waiting.setdefault(node, list(range(int(self._total[node]))))
        pick = int(self._rng.integers(len(waiting)))
        waiting[pick], waiting[-1] = waiting[-1], waiting[pick]
        child = len(self.nodes)
        self.nodes.append(self._hierarchy.child(self.nodes[node], waiting.pop()))
        # It comes before its siblings.
        self.parent[child] = node
        self._next_sibling[child] = self._first_child[node]
        self._first_child[node] = child
        self._added[node] += 1
        return child
