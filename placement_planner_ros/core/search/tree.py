"""Monte-Carlo tree over any `Hierarchy`: UCB1 with child addition (Algorithm 3).

The tree knows nothing of what its nodes stand for. Its numbers v(n), r(n) and its links live in
flat arrays, so that one descent is one compiled call.
"""

from __future__ import annotations

import heapq
import itertools
from typing import Generic, Protocol, TypeVar

import numpy as np
from numba import njit

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted

N = TypeVar("N")

_UNKNOWN = -1
"""The number of children is not known yet."""


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _descend_tree(
    node: int,
    depth: int,
    min_depth: int,
    c: float,
    may_add: bool,
    links: tuple[np.ndarray, np.ndarray],
    children: tuple[np.ndarray, np.ndarray],
    counts: tuple[np.ndarray, np.ndarray],
) -> tuple[int, int, bool]:
    """Follow SelectChild (Algorithm 3) from `node` until one is to be sampled or a child added.

    UCB1: the child with the greatest r(n)/v(n) + c sqrt(2 ln v(parent) / v(n)). A child that is not
    in the tree yet counts as one with the mean of the j that are, and j visits.

    Args:
        links: first child and next sibling of each node, -1 without one.
        children: how many of its children are in the tree, and how many it has.
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
        if total[node] == _UNKNOWN or added[node] == 0:
            if depth >= min_depth and not may_add:
                return node, depth, False
            return node, depth, True
        # UCB1 of the children in the tree.
        log_visits = np.log(visits[node])
        best, best_child, mean_sum = -np.inf, -1, 0.0
        child = first_child[node]
        while child >= 0:
            if visits[child] == 0:  # added, but its sample was not needed
                best, best_child = np.inf, child
                child = next_sibling[child]
                continue
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


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _propagate_reward(
    node: int,
    visit: int,
    reward: float,
    parent: np.ndarray,
    visits: np.ndarray,
    rewards: np.ndarray,
) -> None:
    """Add to v and r of a node and of all above it."""
    # From the node up to the root.
    while node >= 0:
        visits[node] += visit
        rewards[node] += reward
        node = parent[node]


class Hierarchy(Protocol[N]):
    """What a tree needs to know of the nodes it searches."""

    @property
    def root(self) -> N:
        """The node everything else lies below."""
        ...

    def child_count(self, node: N) -> int:
        """|Ch(n)|; 0 for a leaf."""
        ...

    def child(self, node: N, index: int) -> N:
        """One of Ch(n), 0 ≤ index < child_count."""
        ...


class SearchTree(Generic[N]):
    """G_s: the part of a hierarchy that has been visited, with v(n), r(n) and Ch(n, G_s).

    Args:
        hierarchy: Ch(n); asked for a child only when it is added.
        min_depth: depth from which nodes can be sampled (the root has depth 0).
        exploration: c of UCB1, ≥ 0.
        max_nodes: once reached, no further child is added below `min_depth`.
        rng: chooses which child is added next.

    Raises:
        ParameterError: `exploration` is negative or `max_nodes` too small.
    """

    def __init__(
        self,
        hierarchy: Hierarchy[N],
        min_depth: int,
        exploration: float,
        max_nodes: int,
        rng: np.random.Generator,
    ) -> None:
        if not exploration >= 0.0:
            raise ParameterError("exploration", exploration, "must be zero or larger")
        if max_nodes < 2:
            raise ParameterError("max_nodes", max_nodes, "must be at least 2")
        self._hierarchy = hierarchy
        self._min_depth = min_depth
        self._exploration = exploration
        self._max_nodes = max_nodes
        self._rng = rng
        self._payload: list[N] = []
        self._waiting: dict[int, list[int]] = {}
        self._allocate(1024)
        self._new_node(hierarchy.root, -1)
        self._threshold = -np.inf
        self._records: list[tuple[float, int, int, float]] = []
        self._record_count = itertools.count()

    def __len__(self) -> int:
        return len(self._payload)

    def __getitem__(self, node: int) -> N:
        return self._payload[node]

    def visits(self, node: int) -> int:
        """v(n)."""
        return int(self._visits[node])

    def reward(self, node: int) -> float:
        """r(n)."""
        return float(self._rewards[node])

    def added_children(self, node: int) -> list[int]:
        """Ch(n, G_s)."""
        found = []
        child = int(self._first_child[node])
        while child >= 0:
            found.append(child)
            child = int(self._next_sibling[child])
        return found

    def is_leaf(self, node: int) -> bool:
        """Whether the hierarchy has no children below this node."""
        if self._total[node] == _UNKNOWN:
            self._total[node] = self._hierarchy.child_count(self._payload[node])
        return bool(self._total[node] == 0)

    def select(self) -> int:
        """SelectAfrNode: the node to sample next, by UCB1 from the root on.

        Raises:
            ParameterError: the hierarchy ends above `min_depth`.
        """
        node, depth = 0, 0
        while True:
            # Down as far as the tree goes, in one compiled call.
            node, depth, add = _descend_tree(
                node,
                depth,
                self._min_depth,
                self._exploration,
                len(self._payload) < self._max_nodes,
                (self._first_child, self._next_sibling),
                (self._added, self._total),
                (self._visits, self._rewards),
            )
            if not add:
                return node
            if self.is_leaf(node):
                if depth < self._min_depth:
                    raise ParameterError(
                        "hierarchy", self._payload[node], "has no children to choose from"
                    )
                return node
            # Add a child, and go on from there.
            if self._added[node] < self._total[node]:
                node = self._add_child(node)
                depth += 1

    def hold(self, node: int) -> None:
        """Count a visit whose reward is not known yet, as if it were 0, until `release`."""
        _propagate_reward(node, 1, 0.0, self._parent, self._visits, self._rewards)

    def release(self, node: int) -> None:
        """Take back what `hold` counted."""
        _propagate_reward(node, -1, 0.0, self._parent, self._visits, self._rewards)

    def update(self, node: int, reward: float, value: float, demoted: float) -> None:
        """Update: one more sample of `node`, propagated to its ancestors.

        Args:
            reward: Δr(n).
            value: ξ of the sample where it beat the threshold, else -inf.
            demoted: what the reward becomes once the threshold has risen to `value` or above.
        """
        if value <= self._threshold:
            value = -np.inf
        _propagate_reward(node, 1, reward, self._parent, self._visits, self._rewards)
        # Remember what the reward becomes once ξ_best rises to the value.
        if value > -np.inf and reward != demoted:
            record = (value, next(self._record_count), node, demoted - reward)
            heapq.heappush(self._records, record)
            # Where there are too many, the lowest is demoted early.
            if len(self._records) > self._max_nodes:
                self._demote(heapq.heappop(self._records))

    def raise_threshold(self, value: float) -> None:
        """ξ_best rose: samples that no longer beat it count as what they now are."""
        self._threshold = max(self._threshold, value)
        while self._records and self._records[0][0] <= value:
            self._demote(heapq.heappop(self._records))

    def _demote(self, record: tuple[float, int, int, float]) -> None:
        _propagate_reward(record[2], 0, record[3], self._parent, self._visits, self._rewards)

    def _add_child(self, node: int) -> int:
        # The children that are not in the tree yet.
        waiting = self._waiting.get(node)
        if waiting is None:
            waiting = self._waiting[node] = list(range(int(self._total[node])))
        # One of them at random, swapped to the end to be taken from there.
        pick = int(self._rng.integers(len(waiting)))
        waiting[pick], waiting[-1] = waiting[-1], waiting[pick]
        child = self._new_node(self._hierarchy.child(self._payload[node], waiting.pop()), node)
        if not waiting:
            del self._waiting[node]
        # It comes before its siblings.
        self._next_sibling[child] = self._first_child[node]
        self._first_child[node] = child
        self._added[node] += 1
        return child

    def _new_node(self, payload: N, parent: int) -> int:
        node = len(self._payload)
        # Twice the room where all is used.
        if node == len(self._parent):
            self._allocate(2 * node)
        self._payload.append(payload)
        self._parent[node] = parent
        return node

    def _allocate(self, size: int) -> None:
        def grown(name: str, fill: float, dtype: type) -> np.ndarray:
            array: np.ndarray = np.full(size, fill, dtype=dtype)
            old: Array | None = getattr(self, name, None)
            if old is not None:
                array[: len(old)] = old
            return array

        self._parent = grown("_parent", -1, np.int32)
        self._first_child = grown("_first_child", -1, np.int32)
        self._next_sibling = grown("_next_sibling", -1, np.int32)
        self._added = grown("_added", 0, np.int32)
        self._total = grown("_total", _UNKNOWN, np.int32)
        self._visits = grown("_visits", 0, np.int64)
        self._rewards = grown("_rewards", 0.0, np.float64)
