"""The questions that the planner asks its collision checks in a run."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any
from unittest import mock

import numpy as np
import numpy.typing as npt

from benchmarks.cases import Case, make_problem
from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.types import Array


@dataclass(frozen=True, slots=True)
class RecordingSettings:
    """How long to record and how much to keep of each kind of query.

    Attributes:
        runs: runs of the case, with seeds of their own; what is kept is spread over all.
        samples: goal samples after which a run ends.
        seconds: after which it ends at the latest.
    """

    runs: int = 3
    samples: int = 2000
    seconds: float = 60.0
    states: int = 4000
    edges: int = 1000


@dataclass(frozen=True, slots=True, eq=False)
class HeldQueries:
    """What was asked of one arm with the object in one grasp.

    Attributes:
        states: (n, dof) configurations; contact: (n,) whether the object rests on its support.
        edges: (m, 2, dof) straight joint motions; edge_contact: (m,).
    """

    holding: Holding
    states: Array
    contact: npt.NDArray[np.bool_]
    edges: Array
    edge_contact: npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A random subset of one run's queries.

    Attributes:
        seen: how many of each kind the run asked.
    """

    case: Case
    problem: Problem
    settings: PlannerSettings
    held: tuple[HeldQueries, ...]
    seen: dict[str, int]


@dataclass(slots=True)
class _Asked:
    """All that is asked while planners run; checkers stand for their holdings."""

    states: list[tuple[ArmCollision, Array, bool]] = field(default_factory=list)
    edges: list[tuple[ArmCollision, Array, Array, bool]] = field(default_factory=list)
    holdings: dict[int, Holding] = field(default_factory=dict)

    def state(
        self, checker: ArmCollision, q: Array, reserve: float = 0.0, contact: bool = False
    ) -> None:
        """`ArmCollision.free` and `free_batch`."""
        for row in np.array(q, dtype=np.float64).reshape(-1, np.shape(q)[-1]):
            self.states.append((checker, row, contact))

    def edge(
        self,
        checker: ArmCollision,
        a: Array,
        b: Array,
        *,
        contact: bool = False,
        deviation: Array | None = None,
        reserve: float = 0.0,
    ) -> None:
        """`ArmCollision.edge_free`; motions that may stray from the line are no plain edges."""
        if deviation is None:
            self.edges.append((checker, np.array(a), np.array(b), contact))

    def pose(self, holding: Holding, *_: object, **__: object) -> None:
        """`Holding.configurations`, which says whose checks these are."""
        self.holdings[id(holding.collision)] = holding


@contextmanager
def _noting_calls(asked: _Asked) -> Iterator[None]:
    """Note every call from outside; what those call in turn does not count."""
    inside = False

    def listened(kind: type, name: str, tell: Callable[..., None]) -> Any:
        original = getattr(kind, name)

        def method(self: object, *arguments: Any, **named: Any) -> Any:
            nonlocal inside
            if not inside or kind is not ArmCollision:
                tell(self, *arguments, **named)
            if kind is not ArmCollision or inside:
                return original(self, *arguments, **named)
            inside = True
            try:
                return original(self, *arguments, **named)
            finally:
                inside = False

        return mock.patch.object(kind, name, method)

    with ExitStack() as stack:
        for kind, name, tell in (
            (ArmCollision, "free", asked.state),
            (ArmCollision, "free_batch", asked.state),
            (ArmCollision, "edge_free", asked.edge),
            (Holding, "configurations", asked.pose),
        ):
            stack.enter_context(listened(kind, name, tell))
        yield


def record_queries(case: Case, first_seed: int, settings: RecordingSettings) -> Recording:
    """Run the planner on a case, several times, and keep a random subset of what it asks.

    Raises:
        PlacementPlannerError: the runs asked for no state or edge.
    """
    problem, objective = make_problem(case, np.random.default_rng(first_seed))
    planner_settings, asked = PlannerSettings(), _Asked()
    for seed in range(first_seed, first_seed + settings.runs):
        rng = np.random.default_rng(seed)
        planner = PlacementPlanner(problem, objective, planner_settings, rng)
        ends = time.monotonic() + settings.seconds

        def enough(planner: PlacementPlanner = planner, ends: float = ends) -> bool:
            return planner.statistics.samples >= settings.samples or time.monotonic() > ends

        with _noting_calls(asked):
            for _ in planner.run(enough):
                pass
    kinds = ("states", "edges")
    seen = {kind: len(getattr(asked, kind)) for kind in kinds}
    rng = np.random.default_rng(first_seed)
    for kind in kinds:
        kept = np.sort(rng.permutation(seen[kind])[: getattr(settings, kind)])
        setattr(asked, kind, [getattr(asked, kind)[row] for row in kept])
    held = _by_holding(asked)
    for kind in kinds:
        if not sum(len(getattr(queries, kind)) for queries in held):
            raise PlacementPlannerError(
                f"{kind} of {case}", seen, "the runs asked for none: give them more samples"
            )
    return Recording(case, problem, planner_settings, tuple(held), seen)


def _by_holding(asked: _Asked) -> list[HeldQueries]:
    """One arm with one grasp is alike in all runs: its first holding stands for all."""
    holdings: dict[tuple[str, int], Holding] = {}
    keys: dict[int, tuple[str, int]] = {}
    for checker, holding in asked.holdings.items():
        keys[checker] = holding.arm.name, holding.grasp
        holdings.setdefault(keys[checker], holding)
    held = []
    for key, holding in holdings.items():
        states = [(q, contact) for c, q, contact in asked.states if keys.get(id(c)) == key]
        moves = [(a, b, contact) for c, a, b, contact in asked.edges if keys.get(id(c)) == key]
        dof = len(holding.q_start)
        held.append(
            HeldQueries(
                holding,
                np.array([q for q, _ in states]).reshape(-1, dof),
                np.array([contact for _, contact in states], dtype=np.bool_),
                np.array([(a, b) for a, b, _ in moves]).reshape(-1, 2, dof),
                np.array([contact for _, _, contact in moves], dtype=np.bool_),
            )
        )
    return held
