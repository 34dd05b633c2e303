"""`python -m benchmarks motion`: the goal-set RRT and shortcutting beside OMPL's own, in one run.

The goal-set RRT runs as it is and as a planner of OMPL (`GoalSetPlanner`), which adds what OMPL's
states and Python bindings cost; RRTConnect is driven through the same interface. All planners,
both ways of shortening and the timing ask the same edge test. OMPL draws from its own generator,
which is seeded once per process at most: its figures vary from run to run.
"""

from __future__ import annotations

import argparse
import functools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from benchmarks.jobs import Tell, WorkProgress, say
from benchmarks.motion.ompl_planner import GoalSetPlanner
from benchmarks.motion.ompl_space import EdgeSpace
from benchmarks.motion.problems import MotionProblem, panda_problems
from benchmarks.text_table import TextTable
from placement_planner_ros.core.motion.birrt import GoalSetRRT, GoalSetRRTSettings
from placement_planner_ros.core.motion.shortcut import shorten_path
from placement_planner_ros.core.timing.timing import parameterize_path
from placement_planner_ros.core.timing.trajectory_maker import TimingSettings
from placement_planner_ros.core.types import Array, Trajectory

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

    seconds: float
    path: Array
    length: float
    trajectory: Trajectory | None


class Workbench:
    """One problem, its edge test and the planners.

    Args:
        limit: seconds a planner may search.
    """

    def __init__(self, problem: MotionProblem, limit: float = 10.0) -> None:
        self.problem = problem
        self.collision = problem.collision()
        self._limit = limit
        self._edges = 0
        self._edge_free = functools.partial(
            self.collision.edge_free, reserve=self.collision.settings.planning_reserve
        )
        self.edge_free(problem.start, problem.start)  # so that compiling is not timed
        self._space = EdgeSpace(problem.arm.lower, problem.arm.upper, self._edge_free)

    def edge_free(self, a: Array, b: Array) -> bool:
        """Whether the whole straight motion is free, with what planning keeps in reserve."""
        self._edges += 1
        return self._edge_free(a, b)

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
        return Planned(time.perf_counter() - started, path, self._edges)

    def goal_set_planner(self, seed: int) -> Planned:
        """The same search as one of OMPL's planners."""
        rng = np.random.default_rng(seed)
        return self._by_ompl(lambda space: GoalSetPlanner(space, GoalSetRRTSettings(), rng))

    def rrt_connect(self, max_step: float = 0.0) -> Planned:
        """OMPL's.

        Args:
            max_step: its longest edge, radians; 0 leaves that to OMPL.
        """

        def make(space: ob.SpaceInformation) -> ob.Planner:
            planner = og.RRTConnect(space)
            planner.setRange(max_step)
            return planner

        return self._by_ompl(make)

    def _by_ompl(self, make: Callable[[ob.SpaceInformation], ob.Planner]) -> Planned:
        solve = self._space.planner(make, self.problem.start, [self.problem.q_goal])
        self._space.edges = 0
        started = time.perf_counter()
        path = solve(self._limit)
        seconds = time.perf_counter() - started
        return Planned(seconds, path, self._space.edges)

    def shorten(self, path: Array, seed: int) -> Shortened:
        """This project's shortcutting, as much of it as planning does."""
        attempts = TimingSettings().shortcut_attempts
        rng = np.random.default_rng(seed)
        return self._timed(lambda: shorten_path(path, self.edge_free, rng, attempts))

    def simplify(self, path: Array) -> Shortened:
        """OMPL's simplifier, to its end."""
        return self._timed(lambda: self._space.simplified(path))

    def _timed(self, make: Callable[[], Array]) -> Shortened:
        started = time.perf_counter()
        path = make()
        seconds = time.perf_counter() - started
        arm = self.problem.arm
        acceleration = np.broadcast_to(TimingSettings().acceleration_limits, arm.velocity.shape)

        def timed_free(a: Array, b: Array, deviation: Array) -> bool:
            return self.collision.edge_free(a, b, deviation=deviation)

        trajectory = parameterize_path(path, arm.joints, arm.velocity, acceleration, timed_free)
        return Shortened(seconds, path, path_length(path), trajectory)


def path_length(path: Array) -> float:
    """Radians, norm over the joints."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def planning_table(runs: Mapping[str, Sequence[Planned]]) -> str:
    """Times of the same queries by planner, unsolved ones counted at their limit.

    Ratios are those to the first planner's: of the medians, the 95th percentiles and the sums.
    """
    rows = []
    first = _time_summary(next(iter(runs.values())))
    for name, planned in runs.items():
        lengths = [path_length(run.path) for run in planned if run.path is not None]
        own = _time_summary(planned)
        told = (
            name,
            f"{len(lengths)} of {len(planned)}",
            *(f"{1e3 * seconds:.1f}" for seconds in own[:2]),
            f"{np.median([run.edges for run in planned]):.0f}",
            f"{np.median(lengths) if lengths else np.nan:.2f}",
            *(f"{a / b:.2f}" for a, b in zip(own, first, strict=True)),
        )
        rows.append(told)
    header = ("planner", "solved", "median ms", "95 % ms", "edges", "length rad", "ratio: median",
              "95 %", "sum")  # fmt: skip
    return TextTable(header, rows).markdown()


def _time_summary(runs: Sequence[Planned]) -> tuple[float, float, float]:
    """Median, 95th percentile and sum of the times, seconds."""
    seconds = np.array([run.seconds for run in runs])
    return float(np.median(seconds)), float(np.percentile(seconds, 95)), float(seconds.sum())


def shortening_table(ours: Sequence[Shortened], theirs: Sequence[Shortened]) -> str:
    """Length and duration of the same paths after either way of shortening, and the ratios."""
    rows = []
    for name, runs in (("shorten", ours), ("OMPL simplifyMax", theirs)):
        durations = [run.trajectory.duration for run in runs if run.trajectory is not None]
        told = (
            name,
            f"{len(durations)} of {len(runs)}",
            f"{1e3 * np.median([run.seconds for run in runs]):.1f}",
            f"{np.mean([run.length for run in runs]):.3f}",
            f"{np.mean(durations) if durations else np.nan:.3f}",
        )
        rows.append(told)
    both = [
        (a.length / b.length, a.trajectory.duration / b.trajectory.duration)
        for a, b in zip(ours, theirs, strict=True)
        if a.trajectory is not None and b.trajectory is not None
    ]
    note = " ".join(
        f"{what}, shorten : simplifyMax: median {np.median(ratio):.3f}, worst {ratio.max():.3f}, "
        f"at most 1 in {np.mean(ratio <= 1.0):.0%}."
        for what, ratio in zip(("Length", "Duration"), np.array(both).T, strict=False)
    )
    header = ("shortened by", "timed", "median ms", "length rad, mean", "duration s, mean")
    return TextTable(header, rows, note).markdown()


def compare_planners(
    problems: Sequence[MotionProblem], seeds: Sequence[int], paths: int, limit: float, tell: Tell
) -> bool:
    """Plan and shorten in all ways, and tell the tables.

    Args:
        paths: how many of the planned paths, spread over the problems, are shortened.
        limit: seconds a search may take.

    Returns:
        Whether the goal-set RRT solved every problem with every seed, both as it is and by OMPL.
    """
    step = GoalSetRRTSettings().max_step
    planners: dict[str, Callable[[Workbench, int], Planned]] = {
        "goal-set RRT": Workbench.goal_set_rrt,
        "the same as a planner of OMPL": Workbench.goal_set_planner,
        "OMPL RRTConnect": lambda bench, _: bench.rrt_connect(),
        f"the same, {step:g} rad steps": lambda bench, _: bench.rrt_connect(step),
    }
    runs: dict[str, list[Planned]] = {name: [] for name in planners}
    ours, by_ompl = list(runs.values())[:2]
    shortened: list[Shortened] = []
    simplified: list[Shortened] = []
    wanted = set(np.linspace(0, len(problems) - 1, min(paths, len(problems))).astype(int).tolist())
    progress = WorkProgress([1.0] * len(problems), tell)
    for number, problem in enumerate(problems):
        bench = Workbench(problem, limit)
        if number == 0:  # fill caches
            warm, *_ = [plan(bench, 0).path for plan in planners.values()]
            if warm is not None:
                bench.shorten(warm, 0)
        for seed in seeds:
            for name, plan in planners.items():
                runs[name].append(plan(bench, seed))
        path = ours[-1].path
        if number in wanted and path is not None:
            shortened.append(bench.shorten(path, seeds[-1]))
            simplified.append(bench.simplify(path))
        latest = ", ".join(
            f"{name} {1e3 * each[-1].seconds:.1f} ms{' FAILED' if each[-1].path is None else ''}"
            for name, each in runs.items()
        )
        progress.done(f"{problem.name}: {latest}")
    tell(planning_table(runs))
    if shortened:
        tell(shortening_table(shortened, simplified))
    return all(run.path is not None for run in [*ours, *by_ompl])


def add_motion_command(commands: Any) -> None:
    """Add `motion`, which sets `command_function`.

    Args:
        commands: what `ArgumentParser.add_subparsers` returned.
    """
    motion = commands.add_parser(
        "motion", help="motion planning and shortening on MoveIt problems, beside OMPL's own"
    )
    motion.add_argument(
        "data", type=Path, help="folder with problems/*/scene*.yaml and robots/panda_description"
    )
    motion.add_argument("--seeds", type=int, default=3, help="per problem (default %(default)s)")
    motion.add_argument("--paths", type=int, default=20, help="paths to shorten in both ways")
    motion.add_argument("--limit", type=float, default=10.0, help="seconds a search may take")
    motion.set_defaults(command_function=_run_motion)


def _run_motion(arguments: argparse.Namespace) -> int:
    """1 where the goal-set RRT left a problem unsolved."""
    ou.setLogLevel(ou.LogLevel.LOG_WARN)
    problems = panda_problems(arguments.data)
    for note in dict.fromkeys(note for problem in problems for note in problem.notes):
        say(f"start states: {note}")
    solved = compare_planners(
        problems, range(arguments.seeds), arguments.paths, arguments.limit, say
    )
    return 0 if solved else 1
