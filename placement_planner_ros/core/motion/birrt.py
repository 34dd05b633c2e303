"""Goal-set bidirectional RRT: one forward tree, one backward tree per goal (PlanMotion).

RRT-Connect (Kuffner and LaValle, 2000) for a set of goals that changes between calls. Nothing is
forgotten when it does: the forward tree stays, and so do the trees of retired goals, which are
merged into the forward tree when it meets them, without that counting as success.

All trees live in one pool of nodes with one label per node (0 = forward). Merging reverses the
parents between the meeting node and the goal and relabels the tree; no node is copied.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.motion.projected import (
    Constraint,
    ProjectedSteps,
    without_repetition,
)
from placement_planner_ros.core.settings import Settings, setting
from placement_planner_ros.core.types import Array, Index32

_FORWARD = 0
_ANY_BACKWARD = -1


@dataclass(frozen=True, slots=True)
class GoalSetRRTSettings(Settings):
    """How the trees grow.

    Attributes:
        max_step: longest edge, the norm over the joints.
        local_share: share of samples drawn around a random node of the tree that grows (normal,
            half of `max_step` in each coordinate). Trees confined by obstacles get out of them
            this way.
        between_share: share drawn around a random point of the straight line from the start to a
            random active goal (normal, `max_step` in each coordinate), since detours are mostly
            short. The rest is drawn uniformly within the bounds.
        max_nodes: nodes kept in all trees together; beyond it they are cut back, see `GoalSetRRT`.
    """

    max_step: float = setting(1.2, "(0, inf)")
    local_share: float = setting(0.15, "[0, 1)")
    between_share: float = setting(0.65, "[0, 1)")
    max_nodes: int = setting(20_000, "[2, inf)")

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.local_share + self.between_share >= 1.0:
            shares = (self.local_share, self.between_share)
            raise ParameterError("local_share + between_share", shares, "leave some to uniform")


@dataclass(slots=True)
class _Goal:
    """A goal, active or retired.

    `label` is that of its tree until merged, `root` its node, `tip` the end of the branch given
    for it (else the root); `tried` = directly connected or not.
    """

    q: Array
    label: int
    root: int
    tip: int
    active: bool = True
    tried: bool = False


@njit(cache=True, nogil=True)
def _nearest_node(nodes: Array, labels: Index32, count: int, q: Array, label: int) -> int:
    """Index of the node closest to `q` among those with `label` (-1: any backward tree), or -1.

    Args:
        nodes: (dof, capacity), one column per node, so that the inner loops vectorise.
    """
    # Squared distances, joint by joint.
    distances = np.zeros(count)
    for j in range(nodes.shape[0]):
        row = nodes[j, :count]
        x = q[j]
        for i in range(count):
            d = row[i] - x
            distances[i] += d * d
    # The nearest with the label.
    best = np.inf
    arg = -1
    for i in range(count):
        if distances[i] < best and (labels[i] == label or (label < 0 and labels[i] > 0)):
            best = distances[i]
            arg = i
    return arg


def branch_of(parents: Sequence[int] | Index32, node: int) -> list[int]:
    """The nodes from `node` to its tree's root, whose parent is -1."""
    branch = []
    while node >= 0:
        branch.append(node)
        node = int(parents[node])
    return branch


class GoalSetRRT:
    """Bidirectional RRT from one start to whichever of many goals it reaches first.

    Goals are added, retired and re-activated in any order between calls of `solve`; all state is
    kept. A goal that is re-activated after its tree was merged is reported at once.

    Each iteration grows one tree by a step towards a sample, then another tree from its
    nearest node towards the new one in steps of at most `max_step`, keeping every step that is
    free. It is the turn of the forward tree while it has fewer nodes than the active goals' trees
    together, else of theirs; every fourth turn the other way round, lest a tree that cannot grow
    is waited for. A backward turn grows the active goals' trees in rotation; every other forward
    turn aims at the next active goal in rotation, the rest at the nearest backward node. So of n
    active goals each gets at least 1/(4n) of the iterations, however the others resist. Trees of
    retired goals do not grow by samples. A new goal is first tried directly from the nearest
    forward node.

    Memory: when `max_nodes` is reached the trees are cut back to the start, the active goals' ways
    out and the forward branches to goals; retired goals that were never connected are forgotten.
    Where that frees less than half, retired goals are forgotten altogether. Active goals are never
    dropped: where they alone need more than half of `max_nodes`, the limit grows.

    Attributes:
        iterations: iterations done since construction, direct attempts included.
    """

    def __init__(
        self,
        lower: Array,
        upper: Array,
        start: Array,
        edge_is_free: Callable[[Array, Array], bool],
        settings: GoalSetRRTSettings,
        rng: np.random.Generator,
        constraint: Constraint | None = None,
        tied: Callable[[Array], Array] | None = None,
    ) -> None:
        """Plant the forward tree.

        Args:
            lower, upper: (dof,) finite bounds of the configurations.
            start: (dof,) root of the forward tree, known to be free.
            edge_is_free: whether the whole straight motion between two configurations is free;
                symmetric in its arguments.
            settings: how the trees grow.
            rng: the only source of randomness.
            constraint: what whole edges must keep besides; samples and steps are projected onto it.
                Start, goals and branches keep it.
            tied: makes of a sample (dof,) one whose joints move together as they have to; straight
                motions between such configurations keep that, and start, goals and branches do.

        Raises:
            ParameterError: bounds and start do not fit each other.
        """
        self._lower = np.array(lower, dtype=np.float64)
        self._upper = np.array(upper, dtype=np.float64)
        bounds = (self._lower, self._upper)
        if self._lower.ndim != 1 or self._lower.shape != self._upper.shape:
            raise ParameterError("bounds", bounds, "give lower and upper of the same length")
        if not (np.isfinite(bounds).all() and (self._lower <= self._upper).all()):
            raise ParameterError("bounds", bounds, "give finite numbers, lower not above upper")
        self._settings = settings
        self._edge_is_free = edge_is_free
        self._tied = tied or (lambda q: q)
        self._projected: ProjectedSteps | None = None
        if constraint is not None:
            self._projected = ProjectedSteps(constraint, settings.max_step)
        self._rng = rng
        self.iterations = 0

        self._max_nodes = settings.max_nodes
        self._goals: dict[int, _Goal] = {}
        self._unreached: list[int] = []  # keys of active goals outside the forward tree
        self._untried: deque[int] = deque()  # those among them to be tried directly
        self._connected: deque[int] = deque()  # keys of active goals to report
        self._sizes = [0]  # nodes by label
        self._turns = self._forward_turns = 0
        self._count = 0
        self._nodes = np.empty((len(self._lower), 0))
        self._parents = np.empty(0, dtype=np.int32)
        self._labels = np.empty(0, dtype=np.int32)
        self._reserve(256)
        self._append(self._checked("start", start), -1, _FORWARD)

    # ---------------------------------------------------------------- goals

    @property
    def goals(self) -> tuple[int, ...]:
        """Keys of the active goals, in the order they became known."""
        return tuple(key for key, goal in self._goals.items() if goal.active)

    def add_goal(self, key: int, q: Array) -> bool:
        """Make the configuration `q` (dof,) a goal, or re-activate the retired goal `key`.

        Adding an active goal again changes nothing.

        Returns:
            Whether it is new, or was forgotten: its tree is but a root.

        Raises:
            ParameterError: `q` is out of bounds, or `key` is known with another configuration.
        """
        q = self._checked(f"goal {key}", q)
        goal = self._goals.get(key)
        new = goal is None
        if goal is None:
            label = len(self._sizes)
            self._sizes.append(0)
            root = self._append(q, -1, label)
            self._goals[key] = _Goal(q, label, root, root)
        elif not np.array_equal(goal.q, q):
            raise ParameterError(f"goal {key}", q.tolist(), "use a new key for another goal")
        elif goal.active:
            return False
        else:
            goal.active = True
        if self._in_forward_tree(self._goals[key]):
            self._connected.append(key)
            return False
        self._unreached.append(key)
        if not self._goals[key].tried:
            self._untried.append(key)
        return new

    def add_branch(self, key: int, branch: Array) -> None:
        """Lengthen a goal's tree by a way out that the caller knows.

        The first attempt to connect the goal then aims at the branch's end.

        Args:
            key: a goal that was added before.
            branch: (k, dof) configurations from the goal's on, whose edges are free.

        Raises:
            ParameterError: the key is unknown, or the branch starts elsewhere or leaves the bounds.
        """
        if key not in self._goals:
            raise ParameterError("goal", key, "add it before its branch")
        goal = self._goals[key]
        if not np.array_equal(branch[0], goal.q):
            raise ParameterError(f"branch of goal {key}", branch[0].tolist(), "start at the goal")
        node = goal.root
        for q in branch[1:]:
            q = self._checked(f"branch of goal {key}", q)
            node = self._append(q, node, int(self._labels[goal.root]))
        goal.tip = node

    def retire_goal(self, key: int) -> None:
        """Stop aiming at a goal; its tree stays. Retiring a retired goal changes nothing.

        Raises:
            ParameterError: no goal of that key was ever added.
        """
        if key not in self._goals:
            raise ParameterError("goal", key, "add it before retiring it")
        self._goals[key].active = False
        for queue in (self._unreached, self._untried, self._connected):
            if key in queue:
                queue.remove(key)

    # ---------------------------------------------------------------- search

    def solve(
        self, max_iterations: int, should_stop: Callable[[], bool] = lambda: False
    ) -> tuple[int, Array] | None:
        """Search until an active goal is reached that was not reported since its activation.

        Args:
            max_iterations: iterations to spend at most in this call.
            should_stop: asked before every edge; True ends the call.

        Returns:
            The goal's key and the path (n, dof) from start to goal, every edge of it free, or
            None: nothing reached within the limits, or no goal is left to reach.
        """
        # Iterate until a goal is reached, or none is left.
        for _ in range(max_iterations):
            if self._connected or not self._unreached or should_stop():
                break
            if self._count + 1 > self._max_nodes:
                self._cut_back()
            self.iterations += 1
            self._iterate(should_stop)
        if not self._connected:
            return None
        key = self._connected.popleft()
        branch = branch_of(self._parents, self._goals[key].root)
        return key, np.ascontiguousarray(without_repetition(self._nodes[:, branch[::-1]].T))

    def trees(self) -> tuple[Array, Index32, Index32]:
        """A copy of all trees: nodes (n, dof), parents (n,) or -1 at roots, labels (n,).

        Label 0 is the forward tree; node 0 is the start.
        """
        n = self._count
        return self._nodes[:, :n].T.copy(), self._parents[:n].copy(), self._labels[:n].copy()

    def _iterate(self, should_stop: Callable[[], bool]) -> None:
        # A goal that is new is tried directly.
        if self._untried:
            goal = self._goals[self._untried.popleft()]
            goal.tried = True
            self._connect(_FORWARD, goal.tip, should_stop)
            return
        # Whose turn it is: that of the smaller side, every fourth time of the other.
        self._turns += 1
        backward = sum(self._sizes[self._goals[key].label] for key in self._unreached)
        forward_turn = (self._sizes[_FORWARD] <= backward) != (self._turns % 4 == 0)
        # Grow the forward tree, then a goal's tree towards its new node.
        if forward_turn:
            self._forward_turns += 1
            new = self._extend(_FORWARD)
            if new >= 0:
                turn, at_nearest = divmod(self._forward_turns, 2)
                label = _ANY_BACKWARD if at_nearest else self._label_in_rotation(turn)
                self._connect(label, new, should_stop)
        else:
            # Grow a goal's tree, then the forward tree towards its new node.
            turn = self._turns - self._forward_turns
            new = self._extend(self._label_in_rotation(turn))
            if new >= 0:
                self._connect(_FORWARD, new, should_stop)

    def _label_in_rotation(self, turn: int) -> int:
        """Label of the tree of the unreached active goal whose turn it is."""
        return self._goals[self._unreached[turn % len(self._unreached)]].label

    def _sample(self, label: int) -> Array:
        """A configuration (dof,) for a tree to grow towards."""
        settings, rng = self._settings, self._rng
        # Near a node of the tree, between start and a goal, or anywhere.
        kind = rng.random() - settings.local_share
        if kind < 0.0:
            nodes = np.flatnonzero(self._labels[: self._count] == label)
            mean, spread = self._q(int(nodes[rng.integers(len(nodes))])), 0.5 * settings.max_step
        elif kind < settings.between_share:
            goal = self._goals[self._unreached[int(rng.integers(len(self._unreached)))]]
            start, tip = self._q(0), self._q(goal.tip)
            mean, spread = start + rng.random() * (tip - start), settings.max_step
        else:
            return self._tied(rng.uniform(self._lower, self._upper))
        # Normally distributed about the mean, within the bounds.
        q = mean + spread * rng.standard_normal(len(mean))
        return self._tied(np.minimum(np.maximum(q, self._lower), self._upper))

    def _extend(self, label: int) -> int:
        """Grow a tree by one step towards a sample; the new node, or -1 where blocked."""
        target = self._sample(label)
        if self._projected is not None:
            return self._extend_projected(self._projected, target, label)
        # A step from the nearest node, kept where it is free.
        near = self._nearest(target, label)
        q, _ = self._step(near, target)
        if np.array_equal(q, self._q(near)) or not self._is_free(near, q):
            return -1
        return self._append(q, near, int(self._labels[near]))

    def _connect(self, label: int, target: int, should_stop: Callable[[], bool]) -> None:
        """Grow a tree from its node nearest to node `target` until there or blocked; merge."""
        q_target = self._q(target)
        near = self._nearest(q_target, label)
        if self._projected is not None:
            self._projected.begin()
        while not should_stop():
            if self._projected is None:
                q, arrived = self._step(near, q_target)
            else:
                step = self._projected.step(self._q(near), q_target)
                if step is None:
                    return
                q, arrived = step
            if not self._is_free(near, q):
                return
            if arrived:
                if self._labels[near] == _FORWARD:
                    self._merge(near, target)
                else:
                    self._merge(target, near)
                return
            if self._count >= self._max_nodes:
                return
            near = self._append(q, near, int(self._labels[near]))

    def _extend_projected(self, along: ProjectedSteps, target: Array, label: int) -> int:
        """Grow a tree by `max_step` towards a sample, in as many steps as the constraint needs."""
        projected = along.constraint.project(target)
        if projected is None:
            return -1
        along.begin()
        near, new, gone = self._nearest(projected, label), -1, 0.0
        while gone < self._settings.max_step and self._count < self._max_nodes:
            origin = self._q(near)
            step = along.step(origin, projected)
            if step is None or np.array_equal(step[0], origin) or not self._is_free(near, step[0]):
                break
            gone += float(np.linalg.norm(step[0] - origin))
            near = new = self._append(step[0], near, int(self._labels[near]))
            if step[1]:
                break
        return new

    def _step(self, node: int, target: Array) -> tuple[Array, bool]:
        """At most `max_step` from a node towards `target`; whether that is the target itself."""
        q = self._q(node)
        difference = target - q
        distance = float(np.linalg.norm(difference))
        if distance <= self._settings.max_step:
            return target, True
        return q + (self._settings.max_step / distance) * difference, False

    def _is_free(self, node: int, q: Array) -> bool:
        origin = self._q(node)
        if np.array_equal(origin, q):
            return True
        return bool(self._edge_is_free(origin, q))

    def _merge(self, forward: int, backward: int) -> None:
        """Hang the tree of node `backward` under node `forward` of the forward tree."""
        label = int(self._labels[backward])
        parent = forward
        node = backward
        while node >= 0:
            following = int(self._parents[node])
            self._parents[node] = parent
            parent, node = node, following
        labels = self._labels[: self._count]
        labels[labels == label] = _FORWARD
        self._sizes[_FORWARD] += self._sizes[label]
        self._sizes[label] = 0
        for key in [k for k in self._unreached if self._in_forward_tree(self._goals[k])]:
            self._unreached.remove(key)
            if key in self._untried:
                self._untried.remove(key)
            self._connected.append(key)

    # ---------------------------------------------------------------- pool of nodes

    def _checked(self, name: str, q: Array) -> Array:
        q = np.array(q, dtype=np.float64)
        if q.shape != self._lower.shape or not np.isfinite(q).all():
            raise ParameterError(name, q.tolist(), f"give {len(self._lower)} finite numbers")
        if (q < self._lower).any() or (q > self._upper).any():
            raise ParameterError(name, q.tolist(), "must lie within the bounds")
        return q

    def _q(self, node: int) -> Array:
        return self._nodes[:, node].copy()

    def _nearest(self, q: Array, label: int) -> int:
        return int(_nearest_node(self._nodes, self._labels, self._count, q, label))

    def _in_forward_tree(self, goal: _Goal) -> bool:
        return bool(self._labels[goal.root] == _FORWARD)

    def _reserve(self, capacity: int) -> None:
        n = self._count
        nodes = np.zeros((len(self._lower), capacity))
        nodes[:, :n] = self._nodes[:, :n]
        parents = np.full(capacity, -1, dtype=np.int32)
        parents[:n] = self._parents[:n]
        labels = np.zeros(capacity, dtype=np.int32)
        labels[:n] = self._labels[:n]
        self._nodes, self._parents, self._labels = nodes, parents, labels

    def _append(self, q: Array, parent: int, label: int) -> int:
        if self._count == len(self._parents):
            self._reserve(2 * self._count)
        node = self._count
        self._nodes[:, node] = q
        self._parents[node] = parent
        self._labels[node] = label
        self._sizes[label] += 1
        self._count += 1
        return node

    def _cut_back(self) -> None:
        """Free at least half of the pool, see the class description."""
        # Forget retired goals: those never reached first, then all.
        for keep_retired in (True, False):
            for key, goal in list(self._goals.items()):
                if not goal.active and not (keep_retired and self._in_forward_tree(goal)):
                    del self._goals[key]
            # Keep the start, branches to goals that were reached, and those of the others.
            kept = {0}
            for goal in self._goals.values():
                if self._in_forward_tree(goal):
                    kept.update(branch_of(self._parents, goal.root))
                else:
                    kept.update(branch_of(self._parents, goal.tip))
            if 2 * len(kept) <= self._max_nodes:
                break
        self._max_nodes = max(self._max_nodes, 2 * len(kept))
        # Move the kept nodes to the front, and number their parents and the goals anew.
        old = np.array(sorted(kept))
        new_index = np.full(self._count + 1, -1, dtype=np.int32)  # the last stands for "no parent"
        new_index[old] = np.arange(len(old), dtype=np.int32)
        self._count = len(old)
        self._nodes[:, : len(old)] = self._nodes[:, old]
        self._parents[: len(old)] = new_index[self._parents[old]]
        self._labels[: len(old)] = self._labels[old]
        self._sizes = np.bincount(self._labels[: self._count], minlength=len(self._sizes)).tolist()
        for goal in self._goals.values():
            goal.root = int(new_index[goal.root])
            goal.tip = max(int(new_index[goal.tip]), goal.root)
