"""The yardstick of a case: the best placement that an exhaustive search finds, and a random one's.

Other code than the planner's samplers: a grid of poses that is refined wherever ξ, which changes by
little from a pose to its neighbours, may still be better; and every arm and grasp, from many starts
of the inverse kinematics, before a pose is given up.
"""

from __future__ import annotations

import heapq
import itertools
import math
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.cases import Case, build_problem, read_inputs
from benchmarks.machine import machine, versions
from benchmarks.record import RecordedSolution, warm_process
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.objective.objective import Objective, evaluate_batch
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.search.sampler import GoalChecker, SampleCount, as_drawn
from placement_planner_ros.core.types import Array, Goal, Verdict

_STEEPEST = 1.1
"""By how much ξ of clearance changes per metre that the object's points move; the raster of d_S is
steeper than 1 in places."""
_FINEST_M = 0.004
"""m between poses of the finest grid, a turn counted as what it moves the object's far end by."""
_SAME_PLACE_M, _SAME_TURN = 0.01, math.radians(10.0)
"""Poses that share their fate, and of which so many are tried before the others are passed over."""
_TRIES_PER_PLACE = 3
BETTER = 0.02
"""Share of ξ's size by which something must be better to be looked for."""
_IK_SEEDS = 256
"""Starts of the inverse kinematics, for each arm and grasp."""
_GOALS_PER_CALL = 4
_CELLS_AT_ONCE = 256
_LAST_ITERATIONS = 40_000
"""RRT iterations for goals that are left when no better pose is."""


@dataclass(frozen=True, slots=True)
class YardstickJob:
    """One case.

    Attributes:
        seconds: of processor time.
        random_placements: feasible placements drawn for the median.
    """

    case: Case
    seconds: float = 300.0
    random_placements: int = 200

    @property
    def work(self) -> float:
        """Seconds at most."""
        return self.seconds

    @property
    def key(self) -> str:
        """Tells jobs apart."""
        return str(self.case)


Cell = tuple[float, int, int, Array, Array, float]
"""What ξ does not exceed, negative; a number; pose set, middle, half sides; ξ where it is free."""


class RefinedGrid:
    """Goals from the poses in which ξ is largest, in the place of SampleGoals.

    A cell is a face, a plane and a box of x, y and θ, with the pose at its middle. That which may
    hold the best pose is cut in two across its longest side until none may hold a better one than
    ξ_best, or all that may are finer than the grid.

    Attributes:
        most: what ξ does not exceed in what is left.
        poses: looked at.
        unreached: the best ξ of a pose that is free and stands, and that no arm was found to reach.
    """

    def __init__(
        self,
        hierarchy: AfrHierarchy,
        checker: GoalChecker,
        constraints: PoseConstraints,
        objective: Objective,
    ) -> None:
        self.count = SampleCount()
        self.poses, self.unreached = 0, -math.inf
        self._checker, self._constraints, self._objective = checker, constraints, objective
        body = constraints.problem.body
        self._size = float(np.linalg.norm(np.ptp(body.vertices, axis=0)))
        self._sets = hierarchy.sets
        self._grasps = [
            (arm, grasp)
            for arm, grasps in enumerate(hierarchy.grasps_per_arm)
            for grasp in range(grasps)
        ]
        self._number = itertools.count()
        self._left: list[Cell] = []
        self._tried: Counter[tuple[int, ...]] = Counter()

    @property
    def most(self) -> float:
        """Of all cells that are left."""
        return -self._left[0][0] if self._left else -math.inf

    def finished(self, best: float) -> bool:
        """Whether nothing may be better by what counts."""
        return self.most <= best + BETTER * abs(best) if best > -math.inf else not self._left

    def sample_goals(self, best: float, should_stop: Callable[[], bool]) -> list[Goal]:
        """The next few goals better than `best`."""
        if self.poses == 0:
            sets = np.arange(len(self._sets))
            half = 0.5 * (self._sets.high - self._sets.low)
            self._look(sets, self._sets.low + half, half, np.full(len(sets), math.inf))
        goals: list[Goal] = []
        for _ in range(200):
            if len(goals) >= _GOALS_PER_CALL or self.finished(best) or should_stop():
                break
            number = min(_CELLS_AT_ONCE, len(self._left))
            taken = [heapq.heappop(self._left) for _ in range(number)]
            for each in sorted(taken, key=lambda cell: -cell[5]):
                if each[5] > best and len(goals) < _GOALS_PER_CALL and not should_stop():
                    goals += self._reached(each, best)
            self._halve(taken)
        return goals

    def _halve(self, taken: list[Cell]) -> None:
        scale = np.array([1.0, 1.0, self._size])
        parts = []
        for bound, _, of, middle, half, _ in taken:
            sides = half * scale
            if 2.0 * sides.max() > _FINEST_M:
                shift = np.where(np.arange(3) == sides.argmax(), 0.5 * half, 0.0)
                parts += [(of, middle + sign * shift, half - shift, -bound) for sign in (-1.0, 1.0)]
        if parts:
            of_each, middles, halves, bounds = zip(*parts, strict=True)
            self._look(np.array(of_each), np.array(middles), np.array(halves), np.array(bounds))

    def _look(
        self, sets: npt.NDArray[np.int64], middles: Array, halves: Array, bounds: Array
    ) -> None:
        """Keep cells, by what ξ and the checks say of their middles."""
        draws = self._sets.draws(sets, middles)
        verdicts, T = self._constraints.verdicts(
            draws.face, draws.contact, draws.angle, draws.slope
        )
        values = evaluate_batch(self._objective, T)
        self.poses += len(values)
        self.count.add(verdicts)
        moved = np.hypot(halves[:, 0], halves[:, 1]) + self._size * np.minimum(
            halves[:, 2], math.pi
        )
        bounds = np.minimum(bounds, values + _STEEPEST * moved)
        free = np.where(verdicts == Verdict.FEASIBLE, values, -math.inf)
        for k, bound in enumerate(bounds.tolist()):
            row = -bound, next(self._number), int(sets[k]), middles[k], halves[k], float(free[k])
            heapq.heappush(self._left, row)

    def _reached(self, cell: Cell, best: float) -> list[Goal]:
        """Goals at the middle of a cell, one for each arm and grasp that reaches it."""
        of, middle, value = cell[2], cell[3], cell[5]
        place = np.round(middle / (_SAME_PLACE_M, _SAME_PLACE_M, _SAME_TURN)).astype(int)
        key = (of, *place.tolist())
        if self._tried[key] >= _TRIES_PER_PLACE:
            return []
        self._tried[key] += 1
        draws = self._sets.draws(np.array([of]), middle[None])
        goals: list[Goal] = []
        for arm, grasp in self._grasps:
            one = replace(draws, arm=np.array([arm]), grasp=np.array([grasp]))
            outcome = self._checker.check_batch(one, best, 1, lambda: False, as_drawn)
            goals += outcome.goals
        if goals:
            self._tried[key] = _TRIES_PER_PLACE
        else:
            self.unreached = max(self.unreached, value)
        return goals


class ExhaustiveSearch(PlacementPlanner):
    """Algorithm 1 with `RefinedGrid` in place of SampleGoals."""

    def __init__(self, problem: Problem, objective: Objective) -> None:
        settings = PlannerSettings(ik_seeds=_IK_SEEDS)
        super().__init__(problem, objective, settings, np.random.default_rng(0))

    def make_sampler(
        self, hierarchy: AfrHierarchy, checker: GoalChecker, rng: np.random.Generator
    ) -> RefinedGrid:
        """The grid; nothing is drawn."""
        self._grid = RefinedGrid(hierarchy, checker, self._poses, self._objective)
        return self._grid

    def best(self, seconds: float) -> dict[str, Any]:
        """What the search comes to, as plain values.

        Keys: best (ξ, None where nothing was reached) and its solution; complete (whether no pose
        is left that may be better by 2 %); most (what ξ does not exceed in what is left);
        unreached (the best ξ of a pose that no arm was found to reach); poses (looked at).
        """
        deadline = time.process_time() + seconds
        best, since = -math.inf, 0

        def should_stop() -> bool:
            nonlocal since
            done = self._grid.poses > 0 and self._grid.finished(best)
            if not done:
                since = self.motion.iterations
            tried = self.motion.goals == 0 or self.motion.iterations > since + _LAST_ITERATIONS
            return (done and tried) or time.process_time() > deadline

        solution = None
        for placement in self.run(should_stop):
            best = placement.objective
            solution = RecordedSolution.of(placement, placement.search_time)
        grid = self._grid
        return {
            "best": solution and solution.objective,
            "solution": solution and asdict(solution),
            "complete": grid.finished(best) or bool(self.exhausted),
            "most": max(grid.most, best) if max(grid.most, best) > -math.inf else None,
            "unreached": grid.unreached if grid.unreached > best else None,
            "poses": grid.poses,
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
    cut_off = "" if entry["complete"] else " (cut off)"
    return f"{case_of(entry)!s:<62} best {best}{cut_off}  random {random}  {entry['poses']} poses"


def measure_yardstick(job: YardstickJob) -> list[dict[str, Any]]:
    """One record, as a dictionary of plain values.

    Keys: case; those of `ExhaustiveSearch.best`; random (median ξ of random feasible placements,
    None where there is none); random_placements (their number); seconds of processor time spent;
    machine, versions.
    """
    warm_process()
    rng = np.random.default_rng(0)
    started = time.process_time()
    problem, objective = build_problem(read_inputs(job.case, rng), job.case.objective)
    uniform = PlacementPlanner(problem, objective, PlannerSettings(sampler="uniform"), rng)
    random = sampled_placements(uniform, job.random_placements, job.seconds)
    entry: dict[str, Any] = {"case": asdict(job.case)}
    entry |= ExhaustiveSearch(problem, objective).best(job.seconds)
    entry |= {
        "random": float(np.median(random)) if len(random) else None,
        "random_placements": len(random),
        "seconds": time.process_time() - started,
        "machine": machine(),
        "versions": versions(),
    }
    return [entry]
