"""Goal-set RRT and shortcutting beside OMPL's RRTConnect and path simplifier, in one run.

Both planners, both ways of shortening and the timing ask the same edge test. OMPL draws from its
own generator, which is seeded once per process at most: its figures vary from run to run.
"""

from __future__ import annotations

import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from ompl import base as ob
from ompl import geometric as og

from placement_planner_ros.core.collision.arm import ArmCollision, CollisionSettings
from placement_planner_ros.core.motion.birrt import GoalSetRRT, GoalSetRRTSettings
from placement_planner_ros.core.motion.shortcut import shorten
from placement_planner_ros.core.timing.timing import parameterize
from placement_planner_ros.core.timing.trajectory_maker import ExecutionSettings
from placement_planner_ros.core.types import Array, Trajectory
from placement_planner_ros.experiments.motion.problems import MotionProblem

_UNBOUNDED = 2**31
"""Iterations: time limits end the searches."""


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """What one planner made of one problem.

    Attributes:
        seconds: until the path, or until it gave up.
        path: (n, dof), or None.
        edges: edges checked.
    """

    problem: str
    seconds: float
    path: Array | None
    edges: int


@dataclass(frozen=True, slots=True, eq=False)
class Shortened:
    """What became of one planned path.

    Attributes:
        seconds: spent on shortening, timing excluded.
        length: radians, norm over the joints.
        trajectory: timed and certified; None where no timed curve could be.
    """

    problem: str
    seconds: float
    path: Array
    length: float
    trajectory: Trajectory | None


class Workbench:
    """One problem, its edge test and the two planners.

    Args:
        limit: seconds either planner may search.
    """

    def __init__(
        self,
        problem: MotionProblem,
        limit: float = 10.0,
        settings: CollisionSettings | None = None,
    ) -> None:
        self.problem = problem
        self.collision: ArmCollision = problem.collision(settings)
        self._limit = limit
        self._reserve = self.collision.settings.planning_reserve
        self._edges = 0
        self.edge_free(problem.start, problem.start)  # so that compiling is not timed

    @cached_property
    def _space(self) -> ob.SpaceInformation:
        return _space_information(self)

    def edge_free(self, a: Array, b: Array) -> bool:
        """Whether the whole straight motion is free, with what planning keeps in reserve."""
        self._edges += 1
        return self.collision.edge_free(a, b, reserve=self._reserve)

    def goal_set_rrt(self, seed: int) -> Planned:
        """This project's search."""
        arm = self.problem.arm
        self._edges = 0
        started = time.perf_counter()
        search = GoalSetRRT(
            arm.lower,
            arm.upper,
            self.problem.start,
            self.edge_free,
            GoalSetRRTSettings(),
            np.random.default_rng(seed),
        )
        search.add_goal(0, self.problem.q_goal)
        found = search.solve(_UNBOUNDED, lambda: time.perf_counter() - started > self._limit)
        path = None if found is None else found[1]
        return Planned(self.problem.name, time.perf_counter() - started, path, self._edges)

    def rrt_connect(self, max_step: float = 0.0) -> Planned:
        """OMPL's.

        Args:
            max_step: its longest edge, radians; 0 leaves that to OMPL.
        """
        query = ob.ProblemDefinition(self._space)
        query.setStartAndGoalStates(
            self._state(self.problem.start), self._state(self.problem.q_goal)
        )
        planner = og.RRTConnect(self._space)
        planner.setRange(max_step)
        planner.setProblemDefinition(query)
        planner.setup()
        self._edges = 0
        started = time.perf_counter()
        exact = planner.solve(self._limit).getStatus() == ob.PlannerStatus.EXACT_SOLUTION
        seconds = time.perf_counter() - started
        path = self._values(query.getSolutionPath()) if exact else None
        return Planned(self.problem.name, seconds, path, self._edges)

    def shorten(self, path: Array, seed: int) -> Shortened:
        """This project's shortcutting, as much of it as planning does."""
        attempts = ExecutionSettings().shortcut_attempts
        rng = np.random.default_rng(seed)
        return self._timed(lambda: shorten(path, self.edge_free, rng, attempts))

    def simplify(self, path: Array) -> Shortened:
        """OMPL's simplifier, to its end."""

        def simplified() -> Array:
            geometric = og.PathGeometric(self._space)
            for q in path:
                geometric.append(self._state(q))
            og.PathSimplifier(self._space).simplifyMax(geometric)
            return self._values(geometric)

        return self._timed(simplified)

    def _timed(self, make: Callable[[], Array]) -> Shortened:
        started = time.perf_counter()
        path = make()
        seconds = time.perf_counter() - started
        arm = self.problem.arm
        acceleration = np.broadcast_to(ExecutionSettings().acceleration_limits, arm.velocity.shape)

        def timed_free(a: Array, b: Array, deviation: Array) -> bool:
            return self.collision.edge_free(a, b, deviation=deviation)

        trajectory = parameterize(path, arm.joints, arm.velocity, acceleration, timed_free)
        return Shortened(self.problem.name, seconds, path, path_length(path), trajectory)

    def _state(self, q: Array) -> ob.State:
        state = self._space.allocState()
        for i, x in enumerate(q.tolist()):
            state[i] = x
        return state

    def _values(self, path: og.PathGeometric) -> Array:
        joints = range(self.problem.arm.dof)
        return np.array([[state[i] for i in joints] for state in path.getStates()])


def path_length(path: Array) -> float:
    """Radians, norm over the joints."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


class _EdgeTest(ob.MotionValidator):
    """An edge test as OMPL asks for it.

    Its bindings never free the space information and its validator, hence the weak reference.
    """

    def __init__(self, space: ob.SpaceInformation, bench: Workbench) -> None:
        super().__init__(space)
        self._joints = range(bench.problem.arm.dof)
        self._edge_free = weakref.WeakMethod(bench.edge_free)

    def checkMotion(self, a: ob.State, b: ob.State, last_valid: object = None) -> bool:
        edge_free = self._edge_free()
        assert edge_free is not None
        p, q = np.array([a[i] for i in self._joints]), np.array([b[i] for i in self._joints])
        return edge_free(p, q)


def _space_information(bench: Workbench) -> ob.SpaceInformation:
    arm = bench.problem.arm
    space = ob.RealVectorStateSpace(arm.dof)
    bounds = ob.RealVectorBounds(arm.dof)
    for i, (low, high) in enumerate(zip(arm.lower.tolist(), arm.upper.tolist(), strict=True)):
        bounds.setLow(i, low)
        bounds.setHigh(i, high)
    space.setBounds(bounds)
    information = ob.SpaceInformation(space)
    information.setMotionValidator(_EdgeTest(information, bench))
    information.setStateValidityChecker(lambda state: True)  # edges include their ends
    information.setup()
    return information


def planning_table(runs: Mapping[str, Sequence[Planned]]) -> str:
    """Times of the same queries by planner, unsolved ones counted at their limit.

    Ratios are those to the first planner's: of the medians, the 95th percentiles and the sums.
    """
    rows = [
        "planner                solved      median ms     95 % ms    edges  length rad"
        "   ratio: median   95 %    sum"
    ]
    first = _summary(next(iter(runs.values())))
    for name, planned in runs.items():
        paths = [run.path for run in planned if run.path is not None]
        lengths = [path_length(path) for path in paths]
        own = _summary(planned)
        ratios = "".join(f"{a / b:8.2f}" for a, b in zip(own, first, strict=True))
        rows.append(
            f"{name:<21} {len(paths):4d} of {len(planned):3d} {1e3 * own[0]:12.1f} "
            f"{1e3 * own[1]:11.1f} {np.median([run.edges for run in planned]):8.0f} "
            f"{np.median(lengths) if lengths else np.nan:11.2f}       {ratios}"
        )
    return "\n".join(rows)


def _summary(runs: Sequence[Planned]) -> tuple[float, float, float]:
    """Median, 95th percentile and sum of the times, seconds."""
    seconds = np.array([run.seconds for run in runs])
    return float(np.median(seconds)), float(np.percentile(seconds, 95)), float(seconds.sum())


def shortening_table(ours: Sequence[Shortened], theirs: Sequence[Shortened]) -> str:
    """Length and duration of the same paths after either way of shortening, and the ratios."""
    rows = ["shortened by     timed      median ms   length rad   duration s   (means)"]
    for name, runs in (("shorten", ours), ("OMPL simplifyMax", theirs)):
        durations = [run.trajectory.duration for run in runs if run.trajectory is not None]
        rows.append(
            f"{name:<16} {len(durations):3d} of {len(runs):3d} "
            f"{1e3 * np.median([run.seconds for run in runs]):9.1f} "
            f"{np.mean([run.length for run in runs]):12.3f} "
            f"{np.mean(durations) if durations else np.nan:12.3f}"
        )
    both = [
        (a.length / b.length, a.trajectory.duration / b.trajectory.duration)
        for a, b in zip(ours, theirs, strict=True)
        if a.trajectory is not None and b.trajectory is not None
    ]
    if both:
        length, duration = np.array([a for a, _ in both]), np.array([b for _, b in both])
        rows.append(
            f"ratio shorten : simplifyMax   length median {np.median(length):.3f} worst "
            f"{length.max():.3f}   duration median {np.median(duration):.3f} worst "
            f"{duration.max():.3f}   shorter {np.mean(length <= 1.0):.0%}, "
            f"faster {np.mean(duration <= 1.0):.0%}"
        )
    return "\n".join(rows)


def compare(
    problems: Sequence[MotionProblem],
    seeds: Sequence[int],
    paths: int,
    limit: float,
    tell: Callable[[str], None],
) -> bool:
    """Plan and shorten in both ways, and tell the tables.

    Args:
        paths: how many of the planned paths, spread over the problems, are shortened.
        limit: seconds a search may take.

    Returns:
        Whether the goal-set RRT solved every problem with every seed.
    """
    step = GoalSetRRTSettings().max_step
    ours, stock, same_step = "goal-set RRT", "OMPL RRTConnect", f"the same, {step:g} rad steps"
    runs: dict[str, list[Planned]] = {ours: [], stock: [], same_step: []}
    shortened: list[Shortened] = []
    simplified: list[Shortened] = []
    wanted = set(np.linspace(0, len(problems) - 1, min(paths, len(problems))).astype(int).tolist())
    for number, problem in enumerate(problems):
        bench = Workbench(problem, limit)
        if number == 0:  # fill caches
            warm = bench.goal_set_rrt(0).path
            bench.rrt_connect()
            if warm is not None:
                bench.shorten(warm, 0)
        for seed in seeds:
            runs[ours].append(bench.goal_set_rrt(seed))
            runs[stock].append(bench.rrt_connect())
            runs[same_step].append(bench.rrt_connect(step))
        path = runs[ours][-1].path
        if number in wanted and path is not None:
            shortened.append(bench.shorten(path, seeds[-1]))
            simplified.append(bench.simplify(path))
        latest = ", ".join(f"{name} {1e3 * each[-1].seconds:.1f} ms" for name, each in runs.items())
        tell(f"[{number + 1}/{len(problems)}] {problem.name}: {latest}")
    tell(planning_table(runs))
    if shortened:
        tell(shortening_table(shortened, simplified))
    return all(run.path is not None for run in runs[ours])
