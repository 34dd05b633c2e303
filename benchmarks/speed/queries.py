"""Rows measured on recorded queries: configurations, edges, agreement with coal, kinematics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from benchmarks.baselines.exact_collision import Agreement, ExactCollision, compare
from benchmarks.speed.measures import cpu_seconds
from benchmarks.speed.recorder import HeldQueries, Recording
from benchmarks.speed.rows import Entry
from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.collision.separation import COLLIDING, FREE
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.reach.ik import InverseKinematics
from placement_planner_ros.core.types import Array, Verdict

EXHAUSTIVE_SEEDS = 256
_NOISE = 0.05
"""rad, of configurations around recorded ones."""


@dataclass(frozen=True, slots=True)
class CompareSettings:
    """How many queries of a case are put to coal too, which takes milliseconds for each."""

    states: int = 400
    edges: int = 60
    poses: int = 600


class Bench:
    """The queries of one recorded run, put to the fast path and to coal alone.

    Args:
        rng: chooses what coal is asked too.
    """

    def __init__(
        self, recording: Recording, settings: CompareSettings, rng: np.random.Generator
    ) -> None:
        self._recording = recording
        self._settings = settings
        self._rng = rng
        self._exact: dict[int, ExactCollision] = {}

    def exact(self, queries: HeldQueries) -> ExactCollision:
        """coal alone for that arm and grasp."""
        if id(queries) not in self._exact:
            holding, recording = queries.holding, self._recording
            self._exact[id(queries)] = ExactCollision(
                holding.moving,
                holding.held,
                recording.problem.environment.obstacles,
                recording.settings.collision,
            )
        return self._exact[id(queries)]

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
                    | _timed("seconds", classify, states, contact=contact)
                    | _timed("free_seconds", classify, states[clear], contact=contact)
                    | _timed("colliding_seconds", classify, states[~clear], contact=contact)
                )
        return self._entry("configurations", parts)

    def answers(self) -> Entry:
        """Configurations answered to the end, by the fast path and by coal alone."""
        parts = []
        shares = _shares([len(q.states) for q in self._recording.held], self._settings.states)
        for queries, share in zip(self._recording.held, shares, strict=True):
            kept = self._choice(len(queries.states), share)
            exact, collision = self.exact(queries), queries.holding.collision
            for contact, states in _by_contact(queries.states[kept], queries.contact[kept]):
                parts.append(
                    _agreement(compare(collision, exact, states, contact=contact), len(states))
                    | _timed("seconds", collision.free_batch, states, contact=contact)
                    | _timed("exact_seconds", exact.free_batch, states, contact=contact)
                )
        return self._entry("answers", parts)

    def edges(self) -> Entry:
        """Edges certified to the end beside coal's samples every 5 mm."""
        parts = []
        shares = _shares([len(q.edges) for q in self._recording.held], self._settings.edges)
        for queries, share in zip(self._recording.held, shares, strict=True):
            kept = self._choice(len(queries.edges), share)
            exact, collision = self.exact(queries), queries.holding.collision
            for contact, edges in _by_contact(queries.edges[kept], queries.edge_contact[kept]):
                ours = _edges_free(collision, edges, contact)
                theirs = _edges_free(exact, edges, contact)
                parts.append(
                    {"queries": len(edges), "certified": sum(ours), "sampled_free": sum(theirs)}
                    | {"refuted": sum(a and not b for a, b in zip(ours, theirs, strict=True))}
                    | _timed("seconds", _edges_free, collision, edges, contact)
                    | _timed("exact_seconds", _edges_free, exact, edges, contact)
                )
        return self._entry("edges", parts)

    def kinematics(self) -> Entry:
        """Collision-free configurations for recorded poses, and what an exhaustive search adds.

        Timed is `Holding.configurations`, pose by pose as in the search, with its collision
        checks: of all recorded poses, and of those that the exhaustive search solves. That one
        keeps the solutions of all its seeds, but sweeps no self-motions.
        """
        settings, parts = self._recording.settings, []
        shares = _shares([len(q.poses) for q in self._recording.held], self._settings.poses)
        for queries, share in zip(self._recording.held, shares, strict=True):
            kept = self._choice(len(queries.poses), share)
            if not len(kept):
                continue
            holding = queries.holding
            poses = [queries.poses[i] for i in kept]
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
            part = {"poses": len(T), "found": int(ours.sum()), **_timed("seconds", solve, poses)}
            part |= {"reached": int((ours > 0).sum()), "exhaustive": int(solvable.sum())}
            part |= {"missed": int((solvable & (ours == 0)).sum())}
            part |= {"solvable_found": int(ours[solvable].sum()), "solvable_seconds": 0.0}
            if solvable.any():
                solved = [poses[i] for i in np.flatnonzero(solvable)]
                part |= _timed("solvable_seconds", solve, solved)
            parts.append(part)
        return self._entry("ik", parts)

    def agreement(self, number: int) -> Iterator[Entry]:
        """Fast answers beside coal's, half at random, half around recorded configurations.

        Args:
            number: of configurations in this case; with and without support contact in turn.
        """
        held = [queries for queries in self._recording.held if len(queries.states)]
        for queries, share in zip(held, _shares([1] * len(held), number), strict=True):
            exact, collision = self.exact(queries), queries.holding.collision
            arm = queries.holding.arm
            around = self._rng.choice(len(queries.states), share)
            states = queries.states[around] + self._rng.normal(0.0, _NOISE, (share, arm.dof))
            random = self._rng.uniform(arm.lower, arm.upper, states.shape)
            states = np.clip(states, arm.lower, arm.upper)
            states[::2] = random[::2]
            contact = self._rng.random(share) < 0.5
            both = [
                (len(group), compare(collision, exact, group, contact=kind))
                for kind, group in _by_contact(states, contact)
            ]
            yield {
                **self._entry("agreement", [_agreement(found, number) for number, found in both]),
                "arm": arm.name,
                "grasp": queries.holding.grasp,
                "where": [q for _, found in both for q in found.disagreements.tolist()],
            }

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


def _timed(name: str, action: Callable[..., object], *args: Any, **kwargs: Any) -> dict[str, float]:
    return {name: cpu_seconds(partial(action, *args, **kwargs))}


def _agreement(both: Agreement, queries: int) -> dict[str, float]:
    return {
        "queries": queries,
        "free": both.free,
        "undecided": both.undecided,
        "ties": both.ties,
        "contradictions": both.contradictions,
        "disagreements": len(both.disagreements),
    }


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


def _shares(sizes: list[int], total: int) -> list[int]:
    """`total` divided in proportion to the sizes, rounded up where there is anything."""
    every = max(1, sum(sizes))
    return [-(-size * total // every) for size in sizes]


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
