"""Rows measured on recorded queries: configurations and edges."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.baselines.exact_collision import ExactCollision
from benchmarks.speed.recorder import Recording
from benchmarks.speed.rows import Entry
from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.types import Array

_REPEATS = 10_000
_EDGES = 60
"""Of a case that are put to coal too, which takes milliseconds for each."""
_Asked = tuple[ArmCollision, ExactCollision, bool, Array]
"""Both checks, whether the object rests on its support, and what they are asked."""


class QueryBench:
    """The queries of one recorded run, put to the fast path and to coal alone.

    Args:
        rng: chooses what coal is asked too.
    """

    def __init__(self, recording: Recording, rng: np.random.Generator) -> None:
        self._recording = recording
        self._rng = rng
        obstacles, settings = recording.problem.environment.obstacles, recording.settings.collision
        self._held = [
            (q, ExactCollision(q.holding.moving, q.holding.held, obstacles, settings))
            for q in recording.held
        ]

    def _chosen_edges(self) -> Iterator[_Asked]:
        """Some edges of the run, by holding, with and without support contact."""
        every = max(1, sum(len(queries.edges) for queries, _ in self._held))
        for queries, exact in self._held:
            number = len(queries.edges)
            kept = min(number, -(-number * _EDGES // every))
            rows = np.sort(self._rng.choice(number, kept, replace=False)).astype(np.int64)
            for contact, chosen in _by_contact(queries.edges[rows], queries.edge_contact[rows]):
                yield queries.holding.collision, exact, contact, chosen

    def configurations(self) -> Entry:
        """All recorded configurations, in the order they came; then by answer."""
        parts = []
        for queries in self._recording.held:
            answer = queries.holding.collision.free_batch
            for contact, states in _by_contact(queries.states, queries.contact):
                clear = answer(states, contact=contact)
                parts.append(
                    {"queries": len(states), "free": int(clear.sum())}
                    | _cpu_time("seconds", answer, states, contact=contact)
                    | _cpu_time("free_seconds", answer, states[clear], contact=contact)
                    | _cpu_time("colliding_seconds", answer, states[~clear], contact=contact)
                )
        return self._entry("configurations", parts)

    def edges(self) -> Entry:
        """Edges certified to the end beside coal's samples every 5 mm."""
        parts = []
        for collision, exact, contact, edges in self._chosen_edges():
            ours = _edges_free(collision, edges, contact)
            theirs = _edges_free(exact, edges, contact)
            parts.append(
                {"queries": len(edges), "certified": sum(ours), "sampled_free": sum(theirs)}
                | {"refuted": sum(a and not b for a, b in zip(ours, theirs, strict=True))}
                | _cpu_time("seconds", _edges_free, collision, edges, contact)
                | _cpu_time("exact_seconds", _edges_free, exact, edges, contact)
            )
        return self._entry("edges", parts)

    def _entry(self, row: str, parts: Sequence[Mapping[str, float]]) -> Entry:
        """The parts, added up."""
        total: Counter[str] = Counter()
        for part in parts:
            total.update(part)
        return {"row": row, "case": str(self._recording.case), **total}


def cpu_seconds(action: Callable[[], object], at_least: float = 0.05) -> float:
    """CPU time of one call, mean over as many as take `at_least` seconds together.

    It counts this process alone, so that other processes on the machine do not count.
    """
    calls, started = 0, time.process_time()
    while True:
        action()
        calls += 1
        spent = time.process_time() - started
        if spent >= at_least or calls == _REPEATS:
            return spent / calls


def _cpu_time(
    name: str, action: Callable[..., object], *args: Any, **kwargs: Any
) -> dict[str, float]:
    return {name: cpu_seconds(partial(action, *args, **kwargs))}


def _by_contact(rows: Array, contact: npt.NDArray[np.bool_]) -> Iterator[tuple[bool, Array]]:
    """The rows with and without support contact, each as one array; no empty ones."""
    for kind in (False, True):
        chosen = np.ascontiguousarray(rows[contact == kind])
        if len(chosen):
            yield kind, chosen


def _edges_free(
    collision: ArmCollision | ExactCollision, edges: Array, contact: bool
) -> list[bool]:
    """Of (n, 2, dof) edges, by coal with samples every 5 mm, its default."""
    return [collision.edge_free(a, b, contact=contact) for a, b in edges]
