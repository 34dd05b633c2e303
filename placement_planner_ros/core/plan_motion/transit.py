"""PlanMotion: transit to any goal of the set 𝒢, one goal-set RRT per arm and grasp (M_s)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Protocol

import numpy as np

from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.motion.birrt import GoalSetRRT, GoalSetRRTSettings
from placement_planner_ros.core.plan_motion.withdrawal import WindingTree
from placement_planner_ros.core.robot.arm import follow_masters
from placement_planner_ros.core.settings import Settings, setting
from placement_planner_ros.core.types import Array, Goal

_MAX_WAITING_GOALS = 1000
"""Goals of one arm and grasp that wait; once there are twice as many, the rest is forgotten."""


@dataclass(frozen=True, slots=True)
class TransitSettings(Settings):
    """How planning effort is shared among goals.

    Attributes:
        active_goals: goals of one arm and grasp that are planned for at the same time.
        patience: iterations after which a goal that resists is tried the other way round, too; for
            each active goal as many, after which it makes room for one that waits.
        withdrawal: whether each backward tree begins with the way straight out of its goal, and
            gets a winding one where the goal resists.
        rrt: how the trees grow.
    """

    active_goals: int = setting(8, "[1, inf)")
    patience: int = setting(400, "[1, inf)")
    withdrawal: bool = True
    rrt: GoalSetRRTSettings = field(default_factory=GoalSetRRTSettings)


class GoalPlanner(Protocol):
    """PlanMotion with its state: the goals 𝒢, and what was learned of the ways to them."""

    @property
    def goals(self) -> int:
        """|𝒢|."""
        ...

    @property
    def iterations(self) -> int:
        """Planning iterations spent so far."""
        ...

    def add(self, goal: Goal) -> None:
        """𝒢 ← 𝒢 ∪ {g}."""
        ...

    def retire(self, goal: Goal) -> None:
        """𝒢 ← 𝒢 \\ {g}."""
        ...

    def retire_up_to(self, bound: float) -> None:
        """𝒢 ← 𝒢 \\ 𝒢_o with 𝒢_o = {g | ξ(g) ≤ bound}."""
        ...

    def plan(
        self, max_iterations: int, should_stop: Callable[[], bool]
    ) -> tuple[Goal, Array] | None:
        """Spend up to m_max iterations on each tree that has goals, and a few tries of ways out of
        them, or less where told to stop; 𝒢 is not empty.

        Returns:
            A goal reached and the path (n, dof) from q_0 to its raised pre-placement, or None.
        """
        ...


@dataclass(slots=True)
class _Candidate:
    """A goal of 𝒢, its key in the RRT and when (in iterations) it was last made active.

    `rounds` counts how often it made room for others; `tree` holds the ways out of it, None until
    it is first active; `turned` is whether it has been tried the other way round, too.
    """

    goal: Goal
    key: int
    rounds: int = 0
    activated: int = 0
    tree: WindingTree | None = None
    turned: bool = False

    def order(self) -> tuple[int, float]:
        """Goals that had the fewest rounds come first, of these the best ξ."""
        return self.rounds, -self.goal.objective


class _Trees:
    """The RRT of one holding with its active and waiting goals."""

    def __init__(
        self, holding: Holding, settings: TransitSettings, rng: np.random.Generator
    ) -> None:
        self._holding = holding
        self._settings = settings
        self._rng = rng
        self._active: dict[int, _Candidate] = {}
        self._waiting: list[_Candidate] = []
        self._next_key = 0
        # A start that keeps the margin, but hardly anything in reserve, can be left all the same.
        tight = not holding.can_be_left(holding.q_start)
        self.rrt = GoalSetRRT(
            holding.arm.lower,
            holding.arm.upper,
            holding.q_start,
            self._is_free if tight else holding.edge_free,
            settings.rrt,
            rng,
            holding.upright,
            partial(follow_masters, holding.arm.ties),
        )

    def _is_free(self, a: Array, b: Array) -> bool:
        """`Holding.edge_free`, and without its reserve where it leads from the start."""
        holding = self._holding
        from_start = np.array_equal(a, holding.q_start) or np.array_equal(b, holding.q_start)
        return holding.collision.edge_free(a, b) if from_start else holding.edge_free(a, b)

    @property
    def goals(self) -> int:
        """Active and waiting."""
        return len(self._active) + len(self._waiting)

    def add(self, goal: Goal) -> None:
        self._waiting.append(_Candidate(goal, self._next_key))
        self._next_key += 1
        # Too many wait: forget the worse half.
        if len(self._waiting) > 2 * _MAX_WAITING_GOALS:
            self._waiting.sort(key=_Candidate.order)
            del self._waiting[_MAX_WAITING_GOALS:]

    def retire(self, unwanted: Callable[[Goal], bool]) -> None:
        self._waiting = [c for c in self._waiting if not unwanted(c.goal)]
        for key, candidate in list(self._active.items()):
            if unwanted(candidate.goal):
                self.rrt.retire_goal(key)
                del self._active[key]

    def plan(
        self, max_iterations: int, should_stop: Callable[[], bool]
    ) -> tuple[Goal, Array] | None:
        self._share()
        found = self.rrt.solve(max_iterations, should_stop)
        if found is not None:
            key, path = found
            return self._active[key].goal, path
        # Seek a winding way out of the goal that has gained most beyond its straight one for what
        # that took: some seconds each, which none gets where all take turns.
        trees = [(c.tree.pace, key, c.tree) for key, c in self._active.items() if c.tree]
        if trees:
            _, key, tree = max(trees)
            way = tree.grow(self._rng, should_stop)
            if way is not None:
                self.rrt.add_branch(key, way)
        return None

    def _share(self) -> None:
        """Let goals that resist wait; activate those that had the fewest rounds, best ξ first."""
        iterations, settings = self.rrt.iterations, self._settings
        # Goals that resist are tried the longer way round, too.
        for candidate in list(self._active.values()):
            if not candidate.turned and iterations - candidate.activated >= settings.patience:
                candidate.turned = True
                other = self._other_way_round(candidate.goal)
                if other is not None:
                    self.add(other)
        # Goals that have resisted for long make room for others that wait.
        if self._waiting:
            tired = settings.patience * max(1, len(self._active))
            for key, candidate in list(self._active.items()):
                if iterations - candidate.activated >= tired:
                    self.rrt.retire_goal(key)
                    candidate.rounds += 1
                    self._waiting.append(self._active.pop(key))
        # Fill the room with the best of those that had the fewest rounds.
        room = settings.active_goals - len(self._active)
        if room <= 0 or not self._waiting:
            return
        self._waiting.sort(key=_Candidate.order)
        for candidate in self._waiting[:room]:
            candidate.activated = iterations
            self._active[candidate.key] = candidate
            q = candidate.goal.q_raised
            # Begin its tree with the furthest known way out, a straight one at first; anew where it
            # was forgotten.
            if self.rrt.add_goal(candidate.key, q) and settings.withdrawal:
                candidate.tree = candidate.tree or WindingTree(self._holding, q)
                self.rrt.add_branch(candidate.key, candidate.tree.way)
        del self._waiting[:room]

    def _other_way_round(self, goal: Goal) -> Goal | None:
        """The same goal the longer way round with its turnable joint that turns furthest.

        Goals take the shorter way (`Holding.configurations`); what stands in it may leave only the
        other. None where there is none, or it is that already.
        """
        arm = self._holding.arm
        # The joint that turns furthest on the short way, turned the other way.
        way = goal.q_raised - self._holding.q_start
        turnable = np.isin(arm.joints, arm.turnable) & (np.abs(way) <= np.pi)
        if not turnable.any():
            return None
        shift = np.zeros(arm.dof)
        joint = int(np.argmax(np.where(turnable, np.abs(way), -1.0)))
        shift[joint] = -np.copysign(2.0 * np.pi, way[joint])
        # The same turn for all waypoints, where the limits allow it.
        approach = goal.approach + shift
        retreat = None if goal.retreat is None else goal.retreat + shift
        ways = approach if retreat is None else np.vstack([approach, retreat])
        if (ways < arm.lower).any() or (ways > arm.upper).any():
            return None
        return replace(goal, approach=approach, retreat=retreat)


class MotionPlanner:
    """M_s: trees that persist over a run, and 𝒢, the goals they may connect to.

    Args:
        holdings: every usable arm with each of its grasps.
        rng: split among the trees.
    """

    def __init__(
        self, holdings: list[Holding], settings: TransitSettings, rng: np.random.Generator
    ) -> None:
        self._trees = {
            (holding.arm.name, holding.grasp): _Trees(holding, settings, child)
            for holding, child in zip(holdings, rng.spawn(len(holdings)), strict=True)
        }

    @property
    def goals(self) -> int:
        """|𝒢|."""
        return sum(trees.goals for trees in self._trees.values())

    @property
    def iterations(self) -> int:
        """RRT iterations spent so far."""
        return sum(trees.rrt.iterations for trees in self._trees.values())

    def add(self, goal: Goal) -> None:
        """𝒢 ← 𝒢 ∪ {g}."""
        self._trees[goal.arm, goal.grasp].add(goal)

    def retire(self, goal: Goal) -> None:
        """𝒢 ← 𝒢 \\ {g}; its tree is kept."""
        self._trees[goal.arm, goal.grasp].retire(lambda g: g is goal)

    def retire_up_to(self, bound: float) -> None:
        """𝒢 ← 𝒢 \\ 𝒢_o with 𝒢_o = {g | ξ(g) ≤ bound}; their trees are kept."""
        for trees in self._trees.values():
            trees.retire(lambda g: g.objective <= bound)

    def plan(
        self, max_iterations: int, should_stop: Callable[[], bool]
    ) -> tuple[Goal, Array] | None:
        """Spend up to m_max iterations on each tree that has goals, the least used tree first.

        Returns:
            A goal reached and the path (n, dof) from q_0 to its raised pre-placement, or None.
        """
        for trees in sorted(self._trees.values(), key=lambda t: t.rrt.iterations):
            if trees.goals == 0 or should_stop():
                continue
            found = trees.plan(max_iterations, should_stop)
            if found is not None:
                return found
        return None
