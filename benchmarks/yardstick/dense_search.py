"""The yardstick of a case: the best placement of a dense offline search, and a random one's ξ."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.cases import Case, build_problem, read_inputs
from benchmarks.machine import machine, versions
from benchmarks.record import RecordedSolution, warm_process
from benchmarks.yardstick.placement_grid import GridPlacements, GridResolution, grid_placements
from placement_planner_ros.core.objective.objective import Objective
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.search.sampler import Draws, GoalChecker, SampleCount
from placement_planner_ros.core.types import Array, Goal

_SIGNS = {"maximize_clearance": 1.0, "minimize_clearance": -1.0}
_CELL = 0.02
_CELL_ANGLE = np.radians(15.0)
_TRIES_PER_CELL = 8
_GOALS_PER_CALL = 8
_CANDIDATES_PER_CALL = 2000
_LAST_ITERATIONS = 40_000
_IK_SEEDS = 32
"""Starts of the inverse kinematics per pose."""


@dataclass(frozen=True, slots=True)
class YardstickJob:
    """One scene and object; both objectives share the grid.

    Attributes:
        seconds: of processor time for inverse kinematics and motion planning, per objective.
        random_placements: feasible placements drawn for the median.
    """

    scene: str
    object: str
    objectives: tuple[str, ...] = tuple(_SIGNS)
    resolution: GridResolution = field(default_factory=GridResolution)
    seconds: float = 300.0
    random_placements: int = 200

    @property
    def work(self) -> float:
        """Seconds at most."""
        return self.seconds * len(self.objectives)

    @property
    def key(self) -> str:
        """Tells jobs apart."""
        return f"{self.scene}/{self.object}/{', '.join(self.objectives)}"


class DescendingSampler:
    """Goals from a grid of placements, the best first: the dense search's place for SampleGoals.

    Faces take turns, each with its best placements first: where the best of all stand on a face
    that no grasp can put down, they would keep the search from all others. Neighbouring poses share
    their fate: a holding gets one goal per cell of 2 cm and 15°, and a cell that failed it eight
    times is passed over. Local optimisation makes up for the rest.

    Attributes:
        finished: whether nothing better than the last ξ_best is left on the grid.
    """

    def __init__(
        self,
        checker: GoalChecker,
        grasps_per_arm: Sequence[int],
        placements: GridPlacements,
        values: Array,
    ) -> None:
        self.count = SampleCount()
        self.finished = False
        self._checker = checker
        self._holdings = [
            (arm, grasp) for arm, grasps in enumerate(grasps_per_arm) for grasp in range(grasps)
        ]
        self._placements = placements
        self._values = values
        order = np.argsort(-values, kind="stable")
        of = placements.face[order]
        self._by_face = deque(deque(order[of == face].tolist()) for face in np.unique(of))
        self._tries: dict[tuple[int, ...], int] = {}

    def sample_goals(self, best: float, should_stop: Callable[[], bool]) -> list[Goal]:
        """The next few goals, all better than `best`."""
        goals: list[Goal] = []
        for _ in range(_CANDIDATES_PER_CALL):
            if len(goals) >= _GOALS_PER_CALL or should_stop():
                break
            row = self._next_row(best)
            self.finished = row is None
            if row is None:
                break
            goals += self._goals_at(row, best, should_stop)
        return goals

    def _next_row(self, best: float) -> int | None:
        """The best that is left of the face whose turn it is; None where none is above `best`."""
        while self._by_face:
            rows = self._by_face.popleft()
            row = rows.popleft()
            if not self._values[row] > best:
                continue  # nor is any other of that face, now and later
            if rows:
                self._by_face.append(rows)
            return row
        return None

    def _goals_at(self, row: int, best: float, should_stop: Callable[[], bool]) -> list[Goal]:
        placements = self._placements
        face, contact = int(placements.face[row]), placements.contact[row]
        angle = np.asarray(placements.angle[row])
        place = (*np.round(contact / _CELL).astype(int).tolist(), int(angle // _CELL_ANGLE), face)
        goals = []
        for arm, grasp in self._holdings:
            cell = (arm, grasp, *place)
            tries = self._tries.get(cell, 0)
            if tries >= _TRIES_PER_CELL:
                continue
            draw = Draws(
                np.array([arm]),
                np.array([grasp]),
                np.array([face]),
                contact[None],
                angle.reshape(1),
            )
            outcome = self._checker.check_batch(draw, best, 1, should_stop)
            self.count.add(outcome.verdicts, face)
            if outcome.goals:
                goals += outcome.goals
                tries = _TRIES_PER_CELL
            self._tries[cell] = tries + 1
        return goals


class DenseSearch(PlacementPlanner):
    """Algorithm 1 with the grid's placements, best first, in place of SampleGoals."""

    def __init__(
        self,
        problem: Problem,
        objective: Objective,
        settings: PlannerSettings,
        placements: GridPlacements,
        values: Array,
    ) -> None:
        self._grid = placements
        self._grid_values = values
        settings = replace(settings, ik_seeds=_IK_SEEDS)
        super().__init__(problem, objective, settings, np.random.default_rng(0))
        if len(values) == 0:
            self.exhausted = "no pose of the grid is stable and free"

    def make_sampler(
        self, hierarchy: AfrHierarchy, checker: GoalChecker, rng: np.random.Generator
    ) -> DescendingSampler:
        """The grid's placements; nothing is drawn."""
        self._dense = DescendingSampler(
            checker, hierarchy.grasps_per_arm, self._grid, self._grid_values
        )
        return self._dense

    def best(self, seconds: float) -> dict[str, Any]:
        """What the search comes to, as plain values.

        Goals better than the best are planned for until `seconds` of processor time are over or a
        large number of further iterations has reached none of them. Keys: best (ξ, None where
        nothing was reached) and its solution; complete (whether no better pose of the grid was left
        untried); free_poses (of the grid: stable and free of collision without regard to the arms)
        and best_free_pose (the best ξ of those).
        """
        deadline = time.process_time() + seconds
        since = 0

        def should_stop() -> bool:
            nonlocal since
            if not self._dense.finished:
                since = self.motion.iterations
            tried = self.motion.goals == 0 or self.motion.iterations > since + _LAST_ITERATIONS
            return (self._dense.finished and tried) or time.process_time() > deadline

        best = None
        for placement in self.run(should_stop):
            best = RecordedSolution.of(placement, placement.search_time)
        values = self._grid_values
        return {
            "best": best and best.objective,
            "solution": best and asdict(best),
            "complete": self._dense.finished or bool(self.exhausted),
            "free_poses": len(values),
            "best_free_pose": float(np.max(values)) if len(values) else None,
        }


def sampled_placements(planner: PlacementPlanner, number: int, seconds: float) -> Array:
    """(≤ number,) ξ of placements that satisfy every constraint of the sampling problem.

    Args:
        seconds: of processor time.
    """
    deadline = time.process_time() + seconds
    values: list[float] = []
    while not planner.exhausted and len(values) < number and time.process_time() < deadline:
        goals = planner.sampler.sample_goals(-np.inf, lambda: time.process_time() > deadline)
        values += [goal.objective for goal in goals]
    return np.array(values)


def case_of(entry: Mapping[str, Any]) -> Case:
    """The case that an entry is of."""
    return Case(**entry["case"])


def describe_yardstick(entry: Mapping[str, Any]) -> str:
    """One line for the terminal."""
    best, random = (
        "none" if entry[key] is None else f"{entry[key]:+.4f}" for key in ("best", "random")
    )
    return (
        f"{case_of(entry)!s:<62} best {best}{'' if entry['complete'] else ' (cut off)'}"
        f"  random {random}  {entry['free_poses']} free poses"
    )


def measure_yardstick(job: YardstickJob) -> list[dict[str, Any]]:
    """One record for each objective, as dictionaries of plain values.

    Keys: case; those of `DenseSearch.best`; random (median ξ of random feasible placements, None
    where there is none); random_placements (their number); grid_poses; resolution; seconds of
    processor time spent; machine, versions.
    """
    warm_process()
    rng = np.random.default_rng(0)
    settings = PlannerSettings()
    inputs = read_inputs(Case(job.scene, job.object, job.objectives[0]), rng)
    started = time.process_time()
    problem, objective = build_problem(inputs, job.objectives[0])
    placements = grid_placements(problem, job.resolution, settings)
    uniform = replace(settings, sampler="uniform")
    planner = PlacementPlanner(problem, objective, uniform, rng)
    random = sampled_placements(planner, job.random_placements, job.seconds)
    random *= _SIGNS[job.objectives[0]]
    shared = time.process_time() - started
    records = []
    for name in job.objectives:
        started = time.process_time()
        problem, objective = build_problem(inputs, name)
        values = _SIGNS[name] * placements.clearance
        search = DenseSearch(problem, objective, settings, placements, values)
        entry = {"case": asdict(Case(job.scene, job.object, name)), **search.best(job.seconds)}
        entry |= {
            "random": float(_SIGNS[name] * np.median(random)) if len(random) else None,
            "random_placements": len(random),
            "grid_poses": placements.tried,
            "resolution": asdict(job.resolution),
            "seconds": shared + time.process_time() - started,
            "machine": machine(),
            "versions": versions(),
        }
        records.append(entry)
    return records
