"""Rows measured on recorded queries: configurations, edges, kinematics."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from benchmarks.baselines.exact_collision import CollisionAgreement, ExactCollision, compare
from benchmarks.speed.recorder import Recording
from benchmarks.speed.rows import Entry
from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.collision.separation import COLLIDING, FREE
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.reach.ik import InverseKinematics
from placement_planner_ros.core.types import Array, Verdict

EXHAUSTIVE_SEEDS = 256
_REPEATS = 10_000
_STATES, _EDGES = 400, 60
"""Of a case that are put to coal too, which takes milliseconds for each."""
_COUNTED = ("free", "undecided", "ties", "contradictions")
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

    def _chosen(self, kind: str, most: int) -> Iterator[_Asked]:
        """So many states or edges of the run, by holding, with and without support contact."""
        every = max(1, sum(len(getattr(queries, kind)) for queries, _ in self._held))
        for queries, exact in self._held:
            rows = getattr(queries, kind)
            kept = self._choice(len(rows), -(-len(rows) * most // every))
            contacts = queries.contact if kind == "states" else queries.edge_contact
            for contact, chosen in _by_contact(rows[kept], contacts[kept]):
                yield queries.holding.collision, exact, contact, chosen

    def configurations(self) -> Entry:
        """The fast tier on every recorded configuration, in the order they came; then by answer."""
        parts = []
        for queries in self._recording.held:
            classify = queries.holding.collision.classify
            for contact, states in _by_contact(queries.states, queries.contact):
                answers = classify(states, contact=contact)
                clear = answers == FREE
                decided = clear | (answers == COLLIDING)
                parts.append(
                    {"queries": len(states), "free": int(clear.sum())}
                    | {"undecided": int((~decided).sum())}
                    | _cpu_time("seconds", classify, states, contact=contact)
                    | _cpu_time("free_seconds", classify, states[clear], contact=contact)
                    | _cpu_time("colliding_seconds", classify, states[~clear], contact=contact)
                )
        return self._entry("configurations", parts)

    def answers(self) -> Entry:
        """Configurations answered to the end, by the fast path and by coal alone."""
        parts = []
        for collision, exact, contact, states in self._chosen("states", _STATES):
            both = compare(collision, exact, states, contact=contact)
            parts.append(
                _agreement_counts(both, len(states))
                | _cpu_time("seconds", collision.free_batch, states, contact=contact)
                | _cpu_time("exact_seconds", exact.free_batch, states, contact=contact)
            )
        return self._entry("answers", parts)

    def edges(self) -> Entry:
        """Edges certified to the end beside coal's samples every 5 mm."""
        parts = []
        for collision, exact, contact, edges in self._chosen("edges", _EDGES):
            ours = _edges_free(collision, edges, contact)
            theirs = _edges_free(exact, edges, contact)
            parts.append(
                {"queries": len(edges), "certified": sum(ours), "sampled_free": sum(theirs)}
                | {"refuted": sum(a and not b for a, b in zip(ours, theirs, strict=True))}
                | _cpu_time("seconds", _edges_free, collision, edges, contact)
                | _cpu_time("exact_seconds", _edges_free, exact, edges, contact)
            )
        return self._entry("edges", parts)

    def kinematics(self) -> Entry:
        """Collision-free configurations for recorded poses, and what an exhaustive search adds.

        Timed is `Holding.configurations`, pose by pose as in the search, with its collision
        checks: of all recorded poses, and of those that the exhaustive search solves. That one
        keeps the solutions of all its seeds, but sweeps no self-motions.
        """
        settings, parts = self._recording.settings, []
        for queries, _ in self._held:
            holding, poses = queries.holding, list(queries.poses)
            if not poses:
                continue
            T = np.array([holding.tip_pose(x) for x in poses])

            def solve(poses: list[pin.SE3], holding: Holding = holding) -> npt.NDArray[np.int64]:
                found = [holding.configurations(x, settings.ik_seeds, self._rng) for x in poses]
                return np.array([0 if isinstance(q, Verdict) else len(q) for q in found])

            solver = InverseKinematics(
                holding.chain, replace(settings.ik, max_solutions=EXHAUSTIVE_SEEDS)
            )
            random = solver.random_seeds(self._rng, (len(T), EXHAUSTIVE_SEEDS))
            solvable = _free_counts(holding, *solver.solve_batch(T, random)) > 0
            ours = solve(poses)
            part = {"poses": len(T), "found": int(ours.sum()), **_cpu_time("seconds", solve, poses)}
            part |= {"reached": int((ours > 0).sum()), "exhaustive": int(solvable.sum())}
            part |= {"missed": int((solvable & (ours == 0)).sum())}
            part |= {"solvable_found": int(ours[solvable].sum()), "solvable_seconds": 0.0}
            if solvable.any():
                solved = [poses[i] for i in np.flatnonzero(solvable)]
                part |= _cpu_time("solvable_seconds", solve, solved)
            parts.append(part)
        return self._entry("ik", parts)

    def _choice(self, number: int, kept: int) -> npt.NDArray[np.int64]:
        """So many of range(number), in their order."""
        chosen = self._rng.choice(number, min(number, kept), replace=False)
        return np.sort(chosen).astype(np.int64)

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


def _agreement_counts(both: CollisionAgreement, queries: int) -> dict[str, float]:
    counts = {"queries": queries, "disagreements": len(both.disagreements)}
    return counts | {name: getattr(both, name) for name in _COUNTED}


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


def _free_counts(
    holding: Holding, solutions: Array, counts: npt.NDArray[np.int64]
) -> npt.NDArray[np.int64]:
    """(n,) how many of the solutions of each pose are free at contact."""
    filled = np.arange(solutions.shape[1]) < counts[:, None]
    free = np.zeros(filled.shape, dtype=np.int64)
    if filled.any():
        reserve = holding.collision.settings.planning_reserve
        free[filled] = holding.collision.free_batch(solutions[filled], reserve, contact=True)
    return np.asarray(free.sum(axis=1))
