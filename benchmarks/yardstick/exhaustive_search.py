"""The yardstick of a case: the best placement that an exhaustive search finds, and a random one's.

Other code than the planner's samplers: a grid of all poses, the best first; and every arm and
grasp, from many starts of the inverse kinematics, before a pose is given up.
"""

from __future__ import annotations

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
from placement_planner_ros.core.objective.objective import Objective, estimate_batch
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.search.sampler import GoalChecker, SampleCount, as_drawn
from placement_planner_ros.core.types import Array, Goal, Verdict

_STEP_M = 0.008
"""m between poses of the grid; a turn counts as what it moves the object by in the mean."""
_REFINEMENTS, _REFINED = 3, 30_000
"""Times that the step is halved around poses, and around how many of them."""
_SAME_PLACE = 0.01, 0.01, math.radians(10.0)
"""m, m, rad between poses of the grid that share their fate, half of it on the next finer one, and
of which so many are tried before the others are passed over."""
_TRIES_PER_PLACE = 3
BETTER = 0.02
"""Of what the best is better than a random placement: by so much must something be to count."""
_IK_SEEDS = 256
"""Starts of the inverse kinematics, for each arm and grasp."""
_GOALS_PER_CALL = 4
_POSES_AT_ONCE = 50_000
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
    seconds: float = 900.0
    random_placements: int = 200

    @property
    def work(self) -> float:
        """Seconds at most."""
        return self.seconds

    @property
    def key(self) -> str:
        """Tells jobs apart."""
        return str(self.case)


_POSE = np.dtype([("value", "f4"), ("set", "i4"), ("place", "f8", 3)])
"""ξ, the pose set, and x, y and θ there."""


class PoseGrid:
    """Goals from the poses of a grid in which ξ is largest, in the place of SampleGoals.

    All poses of the grid are judged first; then those that are free and stand are tried, the best
    first, until none is better than ξ_best by what counts. Then the grid is made finer around those
    that are at most a step worse, since ξ changes by no more than the object moves.
    """

    def __init__(
        self,
        hierarchy: AfrHierarchy,
        checker: GoalChecker,
        constraints: PoseConstraints,
        objective: Objective,
        random: float,
    ) -> None:
        self.count = SampleCount()
        self._random = random
        self._checker, self._constraints, self._objective = checker, constraints, objective
        self._sets = hierarchy.sets
        self._arm = np.repeat(np.arange(len(hierarchy.grasps_per_arm)), hierarchy.grasps_per_arm)
        self._grasp = np.concatenate([np.arange(each) for each in hierarchy.grasps_per_arm])
        self._free = self._left = np.empty(0, dtype=_POSE)
        self._steps = [_STEP_M / 2**level for level in range(_REFINEMENTS)]
        self._same_place = np.array(_SAME_PLACE)
        self._tried: Counter[tuple[int, ...]] = Counter()

    @property
    def most(self) -> float:
        """ξ of the best pose that was not tried."""
        return float(self._left["value"][-1]) if len(self._left) else -math.inf

    def finished(self, best: float) -> bool:
        """Whether nothing is left that is better by what counts, nor may be on a finer grid."""
        return self._tried_enough(best) and (best == -math.inf or not self._steps)

    def _tried_enough(self, best: float) -> bool:
        return not len(self._left) or self.most <= best + BETTER * max(best - self._random, 0.0)

    def sample_goals(self, best: float, should_stop: Callable[[], bool]) -> list[Goal]:
        """The next few goals better than `best`."""
        if self.count.samples == 0:
            self._keep([self._free_poses(of) for of in range(len(self._sets))])
        while self._tried_enough(best) and not self.finished(best):
            self._refine(best, self._steps.pop(0))
        goals: list[Goal] = []
        while len(goals) < _GOALS_PER_CALL and not self._tried_enough(best) and not should_stop():
            pose, self._left = self._left[-1], self._left[:-1]
            goals += self._reached(pose, best)
        return goals

    def _keep(self, found: list[Any]) -> None:
        """More poses that are free and stand: to be tried, and to look around at."""
        self._left = np.sort(np.concatenate([self._left, *found]), order="value")
        self._free = np.concatenate([self._free, *found])

    def _refine(self, best: float, step: float) -> None:
        """Judge the poses half a step around those that are at most a step worse than `best`."""
        near = np.sort(self._free[self._free["value"] > best - step], order="value")[-_REFINED:]
        around = [sides for sides in itertools.product((-0.5, 0.0, 0.5), repeat=3) if any(sides)]
        found = []
        for of in np.unique(near["set"]):
            shifts = np.multiply(around, (step, step, step / self._radius(of)))
            places = (near["place"][near["set"] == of][:, None] + shifts).reshape(-1, 3)
            found.append(self._judged(of, np.unique(np.round(places, 6), axis=0)))
        self._keep(found)
        self._same_place, self._tried = self._same_place / 2.0, Counter()

    def _free_poses(self, of: int) -> Any:
        """(n,) of `_POSE`: those of the grid in a pose set that are free and stand."""
        low, high = self._sets.low[of], self._sets.high[of]
        step = np.array([_STEP_M, _STEP_M, _STEP_M / self._radius(of)])
        number = np.ceil((high - low) / step).astype(int)
        index = np.stack(np.unravel_index(np.arange(number.prod()), number.tolist()), axis=1)
        return self._judged(of, low + (index + 0.5) * (high - low) / number)

    def _judged(self, of: int, places: Array) -> Any:
        """(≤ n,) of `_POSE`: those at (n, 3) x, y, θ that are free and stand, and about their ξ."""
        found = []
        for some in np.split(places, range(_POSES_AT_ONCE, len(places), _POSES_AT_ONCE)):
            verdicts, T = self._at(of, some)
            self.count.add(verdicts)
            free = verdicts == Verdict.FEASIBLE
            poses = np.empty(int(free.sum()), dtype=_POSE)
            poses["set"], poses["place"] = of, some[free]
            poses["value"] = estimate_batch(self._objective, T[free])
            found.append(poses)
        return np.concatenate(found)

    def _at(self, of: int, places: Array) -> tuple[npt.NDArray[np.int64], Array]:
        """(n,) verdicts and (n, 4, 4) poses at the (n, 3) x, y, θ of a pose set."""
        draws = self._sets.draws(np.full(len(places), of), places)
        return self._constraints.verdicts(draws.face, draws.contact, draws.angle, draws.slope)

    def _radius(self, of: int) -> float:
        """m, of the object's points from the axis that a pose set turns about, in the mean."""
        half_turn = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, math.pi]])
        _, T = self._at(of, 0.5 * (self._sets.low[of] + self._sets.high[of]) + half_turn)
        points = self._constraints.problem.body.volume_points
        moved = (T[1, :3, :3] - T[0, :3, :3]) @ points.T + (T[1] - T[0])[:3, 3, None]
        return float(np.linalg.norm(moved, axis=0).mean() / 2.0)

    def _reached(self, pose: Any, best: float) -> list[Goal]:
        """Goals at one of `_POSE`, one for each arm and grasp that reaches it."""
        of = int(pose["set"])
        key = (of, *np.round(pose["place"] / self._same_place).astype(int).tolist())
        if self._tried[key] >= _TRIES_PER_PLACE:
            return []
        self._tried[key] += 1
        # Whether any arm and grasp reaches it at all, and then which.
        number, place = len(self._arm), pose["place"][None]
        one = self._sets.draws(np.array([of]), place)
        if not self._checker.check_batch(one, best, 1, lambda: False, as_drawn).goals:
            return []
        self._tried[key] = _TRIES_PER_PLACE
        draws = self._sets.draws(np.full(number, of), np.repeat(place, number, axis=0))
        draws = replace(draws, arm=self._arm, grasp=self._grasp)
        return self._checker.check_batch(draws, best, number, lambda: False, as_drawn).goals


class ExhaustiveSearch(PlacementPlanner):
    """Algorithm 1 with `PoseGrid` in place of SampleGoals.

    Args:
        random: ξ of a random placement.
    """

    def __init__(self, problem: Problem, objective: Objective, random: float) -> None:
        settings = PlannerSettings(ik_seeds=_IK_SEEDS)
        self._random = random
        super().__init__(problem, objective, settings, np.random.default_rng(0))

    def make_sampler(
        self, hierarchy: AfrHierarchy, checker: GoalChecker, rng: np.random.Generator
    ) -> PoseGrid:
        """The grid; nothing is drawn."""
        self._grid = PoseGrid(hierarchy, checker, self._poses, self._objective, self._random)
        return self._grid

    def _narrow(self, best: float) -> None:
        """No gap is asked for."""

    def best(self, seconds: float) -> dict[str, Any]:
        """What the search comes to, as plain values.

        Keys: best (ξ, None where nothing was reached) and its solution; complete (whether no pose
        of the grid is left that is better by what counts); most (the best ξ of what is left);
        poses (looked at).
        """
        deadline = time.process_time() + seconds
        best, since = -math.inf, 0

        def should_stop() -> bool:
            nonlocal since
            done = self._grid.count.samples > 0 and self._grid.finished(best)
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
            "poses": grid.count.samples,
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
    drawn = sampled_placements(uniform, job.random_placements, job.seconds)
    random = float(np.median(drawn)) if len(drawn) else None
    search = ExhaustiveSearch(problem, objective, math.inf if random is None else random)
    entry: dict[str, Any] = {"case": asdict(job.case), **search.best(job.seconds)}
    entry |= {
        "random": random,
        "random_placements": len(drawn),
        "seconds": time.process_time() - started,
        "machine": machine(),
        "versions": versions(),
    }
    return [entry]
