"""The anytime placement planner (Algorithm 1)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.arm import CollisionSettings
from placement_planner_ros.core.collision.object import ObjectCollision
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.errors import GraspError, ParameterError, RobotError, StartError
from placement_planner_ros.core.grasp.holding import ApproachSettings, Holding
from placement_planner_ros.core.grasp.open_hand import OpenHand, RetreatSettings
from placement_planner_ros.core.objective.ascent import AscentSettings
from placement_planner_ros.core.objective.objective import Objective
from placement_planner_ros.core.optimize_locally import LocalOptimizer
from placement_planner_ros.core.plan_motion.transit import (
    GoalPlanner,
    MotionPlanner,
    TransitSettings,
)
from placement_planner_ros.core.reach.ik import IKSettings
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.reach.seeds import seed_table
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.sample_goals.cell_bounds import BranchBounds
from placement_planner_ros.core.sample_goals.goals import GoalFinder
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.search.cells import CellSampler
from placement_planner_ros.core.search.hierarchy import AfrHierarchy, HierarchySettings
from placement_planner_ros.core.search.pruning import Remainder
from placement_planner_ros.core.search.sampler import (
    GoalChecker,
    GoalSampler,
    MctsSampler,
    SamplerSettings,
    UniformSampler,
)
from placement_planner_ros.core.statistics import Statistics
from placement_planner_ros.core.timing.trajectory_maker import ExecutionSettings, TrajectoryMaker
from placement_planner_ros.core.types import Array, Goal, Placement, TargetVolume

_LIMIT_INSET = 1e-3
"""rad or m, how far within the joint limits configurations are planned."""


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """One placement task.

    Attributes:
        arms: 𝒜, the arms that could be holding the object, each with its grasps.
        q_start: (nq,) q_0, every joint of the robot.
        body: the object o.
        volume: V.
        environment: the obstacle set, R and their support.
    """

    robot: Robot
    arms: tuple[Arm, ...]
    q_start: Array
    body: Body
    volume: TargetVolume
    environment: Environment

    def __post_init__(self) -> None:
        if not any(arm.grasps for arm in self.arms):
            raise RobotError(
                "arms", [arm.name for arm in self.arms], "give at least one arm with a grasp"
            )


@dataclass(frozen=True, slots=True)
class PlannerSettings:
    """How to search. Budgets count samples and iterations, so a seed fixes the result.

    Attributes:
        sampler: `mcts`, or `uniform` for the ablation.
        local_optimization: False for the ablation without OptimizeLocally.
        motion_iterations: m_max, RRT iterations per arm and grasp in one iteration of Algorithm 1.
        ik_seeds: starts of the inverse kinematics per sampled pose, beside q_0.
        gradient_sampling: whether samples that are stable and free first follow ∂ξ/∂(x, y, e_z),
            without the arm, as `ascent` says.
        min_improvement: ξ counts as better from this much.
        edge_margin: how far beyond each vertex of v(f) its support must still reach, metres.
        require_retreat: a goal counts only with certified approach, release and retreat; False: it
            may be without release and retreat.
    """

    sampler: Literal["mcts", "uniform"] = "mcts"
    local_optimization: bool = True
    motion_iterations: int = 50
    ik_seeds: int = 63
    min_improvement: float = 1e-4
    edge_margin: float = 0.003
    require_retreat: bool = True
    gradient_sampling: bool = False
    hierarchy: HierarchySettings = field(default_factory=HierarchySettings)
    sampling: SamplerSettings = field(default_factory=SamplerSettings)
    ik: IKSettings = field(default_factory=IKSettings)
    collision: CollisionSettings = field(default_factory=CollisionSettings)
    approach: ApproachSettings = field(default_factory=ApproachSettings)
    retreat: RetreatSettings = field(default_factory=RetreatSettings)
    transit: TransitSettings = field(default_factory=TransitSettings)
    ascent: AscentSettings = field(
        default_factory=lambda: AscentSettings(first_step=0.04, last_step=0.005, max_steps=30)
    )
    refine: AscentSettings = field(default_factory=AscentSettings)
    execution: ExecutionSettings = field(default_factory=ExecutionSettings)

    def __post_init__(self) -> None:
        if self.sampler not in ("mcts", "uniform"):
            raise ParameterError("sampler", self.sampler, "choose mcts or uniform")
        for name in ("motion_iterations", "ik_seeds"):
            if getattr(self, name) < 1:
                raise ParameterError(name, getattr(self, name), "must be at least 1")
        for name in ("min_improvement", "edge_margin"):
            if not getattr(self, name) >= 0.0:
                raise ParameterError(name, getattr(self, name), "must not be negative")


class PlacementPlanner:
    """Algorithm 1: sample goals, plan motions, optimise locally, publish, repeat.

    A variant samples or plans in another way by overriding `make_sampler` or `make_motion`, which
    are called once, when the planner is made.

    Args:
        objective: ξ.
        rng: every random choice of the run is drawn from it.

    Attributes:
        holdings: the usable arms with their grasps, by the arm's name and the grasp's number.
        sampler: SampleGoals.
        motion: PlanMotion.
        statistics: live counters, safe to read from other threads.
        exhausted: why there is nothing (left) to search, or '' while there is.
        unusable: why some of the arms and grasps are left out of the search.

    Raises:
        StartError: q_0 is not free for any arm and grasp.
        GraspError: in every grasp the object overlaps the arm.
        PlacementPlannerError: robot, object or settings are unusable.
    """

    def __init__(
        self,
        problem: Problem,
        objective: Objective,
        settings: PlannerSettings,
        rng: np.random.Generator,
    ) -> None:
        self._settings = settings
        rng_sampler, rng_ik, rng_motion, rng_paths = rng.spawn(4)
        environment, body = problem.environment, problem.body
        poses = PoseConstraints(
            body,
            environment,
            problem.volume,
            ObjectCollision(body, environment.obstacles, settings.collision),
            settings.collision.contact_tolerance,
            settings.edge_margin,
            settings.approach.approach_minimum,
        )
        holdings, self.unusable = _usable_holdings(problem, settings)
        self.holdings = {(r.arm.name, r.grasp): r for of_arm in holdings for r in of_arm}
        finder = GoalFinder(
            body,
            poses,
            holdings,
            objective,
            settings.ik_seeds,
            settings.min_improvement,
            rng_ik,
            settings.ascent if settings.gradient_sampling else None,
        )
        hierarchy = AfrHierarchy(
            [len(of_arm) for of_arm in holdings],
            len(body.faces),
            environment.regions,
            settings.hierarchy,
        )
        self.exhausted = _nothing_to_search(hierarchy)
        self._bounds = BranchBounds(
            body,
            environment,
            problem.volume,
            self.holdings.values(),
            objective,
            settings.collision.contact_tolerance,
            settings.edge_margin,
            settings.min_improvement,
            _pruning(settings),
        )
        self._remainder = Remainder(hierarchy, self._bounds)
        self.sampler = self.make_sampler(hierarchy, finder, rng_sampler)
        self.motion = self.make_motion(rng_motion)
        self._optimizer = LocalOptimizer(
            poses, objective, settings.min_improvement, settings.refine
        )
        self._trajectories = TrajectoryMaker(settings.execution, rng_paths)
        self.statistics = Statistics(self.sampler.count)

    def make_sampler(
        self, hierarchy: AfrHierarchy, checker: GoalChecker, rng: np.random.Generator
    ) -> GoalSampler:
        """SampleGoals, as the settings ask for it."""
        settings = self._settings
        if settings.sampler == "uniform":
            return UniformSampler(hierarchy, checker, settings.sampling, rng)
        if settings.sampling.selection == "ucb1":
            return MctsSampler(hierarchy, checker, settings.sampling, rng)
        return CellSampler(hierarchy, checker, settings.sampling, rng, self._bounds)

    def make_motion(self, rng: np.random.Generator) -> GoalPlanner:
        """PlanMotion over all of `holdings`."""
        return MotionPlanner(list(self.holdings.values()), self._settings.transit, rng)

    def run(self, should_stop: Callable[[], bool]) -> Iterator[Placement]:
        """Yield each placement strictly better than the one before until told to stop."""
        started = time.monotonic()
        best = -np.inf
        while not (self.exhausted or should_stop()):
            for goal in self.sampler.sample_goals(best, should_stop):
                self.motion.add(goal)
                self.statistics.goals += 1
            if self.motion.goals == 0:
                if self._remainder.empty(best):
                    self.exhausted = self._remainder.why_empty(best)
                continue
            found = self.motion.plan(self._settings.motion_iterations, should_stop)
            self.statistics.motion_iterations = self.motion.iterations
            if found is None:
                continue
            for placement in self._placements(*found, best, started, should_stop):
                best = placement.objective
                self.motion.retire_up_to(best + self._settings.min_improvement)
                self.statistics.best = best
                self.statistics.solutions += 1
                yield placement

    def _placements(
        self,
        goal: Goal,
        path: Array,
        best: float,
        started: float,
        should_stop: Callable[[], bool],
    ) -> Iterator[Placement]:
        """What a path to a goal gives: the locally optimised placement.

        Where nothing was found before, the placement as it was reached comes first, at once; else
        it comes where the optimised one cannot be timed.
        """
        self.motion.retire(goal)
        holding = self.holdings[goal.arm, goal.grasp]
        optimize = self._settings.local_optimization
        first = best == -np.inf
        reached = self._timed(path, goal, holding, started, should_stop) if first else None
        if reached is not None:
            yield reached
        if optimize and not should_stop():
            refined = self._optimizer.optimize(goal, holding, should_stop)
            if refined.goal is not goal:
                further = np.vstack([path, refined.slide[1:]])
                better = self._timed(further, refined.goal, holding, started, should_stop)
                if better is not None:
                    yield better
                    return
        if not first:
            reached = self._timed(path, goal, holding, started, should_stop)
            if reached is not None:
                yield reached

    def _timed(
        self,
        path: Array,
        goal: Goal,
        holding: Holding,
        started: float,
        should_stop: Callable[[], bool],
    ) -> Placement | None:
        """Shorten, time and certify; None where that fails."""
        made = self._trajectories.make(path, goal, holding, should_stop)
        if made is None:
            self.statistics.unreached += not should_stop()
            return None
        return Placement(
            goal,
            made.trajectory,
            made.approach_start,
            time.monotonic() - started,
            self.statistics.samples,
            made.retreat,
        )


def _usable_holdings(
    problem: Problem, settings: PlannerSettings
) -> tuple[list[list[Holding]], tuple[str, ...]]:
    """Per arm, its grasps for which q_0 is free, and why the others cannot be used."""
    holdings: list[list[Holding]] = []
    reasons: list[str] = []
    bad_grasps: list[GraspError] = []
    for arm in problem.arms:
        of_arm: list[Holding] = []
        q_start = problem.q_start[arm.q_index]
        beyond = np.flatnonzero((q_start < arm.lower) | (q_start > arm.upper))
        if len(beyond):
            joints = ", ".join(
                f"{arm.joints[j]} = {q_start[j]:.4f} is not in "
                f"[{arm.lower[j]:.4f}, {arm.upper[j]:.4f}]"
                for j in beyond
            )
            reasons.append(f"{arm.name}: beyond the joint limits: {joints}")
            holdings.append(of_arm)
            continue
        arm = _within_limits(arm, q_start)
        chain = Chain.from_robot(problem.robot, arm, problem.q_start)
        seeds = seed_table(chain)
        open_hand = OpenHand(
            problem.robot,
            arm,
            problem.body,
            problem.environment.obstacles,
            problem.q_start,
            settings.collision,
            settings.ik,
            settings.retreat,
        )
        for grasp in range(len(arm.grasps)):
            try:
                holding = Holding(
                    problem.robot,
                    arm,
                    grasp,
                    problem.body,
                    problem.environment.obstacles,
                    problem.q_start,
                    settings.collision,
                    settings.ik,
                    settings.approach,
                    seeds,
                    open_hand,
                    settings.require_retreat,
                )
            except GraspError as error:
                bad_grasps.append(error)
                continue
            reason = _why_not_free(holding)
            if reason:
                reasons.append(f"{arm.name} with grasp {grasp}: {reason}")
            else:
                of_arm.append(holding)
        holdings.append(of_arm)
    if not any(holdings):
        if not reasons:
            raise bad_grasps[0]
        raise StartError(
            "joint_states",
            "; ".join(reasons),
            "the start configuration must lie within the joint limits and keep collision_margin "
            "with the object in hand",
        )
    return holdings, (*map(str, bad_grasps), *reasons)


def _why_not_free(holding: Holding) -> str:
    """What q_0 collides with, '' where it is free."""
    alone = holding.collision.with_pairs(lambda a, b: True, environment=False)
    of_robot = alone.explain(holding.q_start)
    if of_robot:
        return f"in self-collision: {of_robot}"
    with_cloud = holding.collision.explain(holding.q_start)
    return f"in collision with the clouds: {with_cloud}" if with_cloud else ""


def _within_limits(arm: Arm, q_start: Array) -> Arm:
    """The arm with limits drawn in, so that a timed curve between them stays within the real ones.

    A curve may stray from its chords by up to the timing's `chord_tolerance`.
    """
    inset = np.minimum(_LIMIT_INSET, 0.25 * (arm.upper - arm.lower))
    return replace(
        arm,
        lower=np.minimum(arm.lower + inset, q_start),
        upper=np.maximum(arm.upper - inset, q_start),
    )


def _pruning(settings: PlannerSettings) -> SamplerSettings:
    """Following the gradient leads samples out of their cells: only s(x) is asked before that."""
    if not settings.gradient_sampling:
        return settings.sampling
    return replace(settings.sampling, prune_reach=False, prune_objective=False)


def _nothing_to_search(hierarchy: AfrHierarchy) -> str:
    if not hierarchy.regions:
        return (
            "no placement region: the clouds show no level surface inside target_volume; "
            "check the volume's corners and the clouds' frame"
        )
    if hierarchy.faces == 0:
        return "no placement face: the object can stand on none of its sides"
    return ""
