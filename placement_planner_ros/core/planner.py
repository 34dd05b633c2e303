"""The anytime placement planner (Algorithm 1)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.carry.settings import CarrySettings, TiltLimit
from placement_planner_ros.core.collision.arm import CollisionSettings
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.contacts.support_settings import (
    CONTACTS,
    SUPPORTS,
    SupportName,
    SupportSettings,
)
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.explanation.constraint_table import shares_in_words
from placement_planner_ros.core.explanation.explain import explain_search
from placement_planner_ros.core.explanation.explanation import Explanation, Search
from placement_planner_ros.core.grasp.feasible_grasps import usable_holdings
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.grasp.settings import (
    ApproachSettings,
    GraspSettings,
    RetreatSettings,
)
from placement_planner_ros.core.objective.ascent import AscentSettings
from placement_planner_ros.core.objective.by_name import make_requirements
from placement_planner_ros.core.objective.objective import (
    Objective,
    ObjectiveContext,
    TermedObjective,
)
from placement_planner_ros.core.optimize_locally import LocalOptimizer
from placement_planner_ros.core.plan_motion.transit import (
    GoalPlanner,
    MotionPlanner,
    TransitSettings,
)
from placement_planner_ros.core.problem import Problem, with_exclusion_zones
from placement_planner_ros.core.reach.ik import IKSettings
from placement_planner_ros.core.sample_goals.cell_bounds import BranchBounds
from placement_planner_ros.core.sample_goals.goals import GoalFinder
from placement_planner_ros.core.sample_goals.remainder import Cause, Remainder
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.search.hierarchy import AfrHierarchy, HierarchySettings
from placement_planner_ros.core.search.mcts import MctsSampler, MctsSettings
from placement_planner_ros.core.search.optimistic import OptimisticSampler, OptimisticSettings
from placement_planner_ros.core.search.sampler import GoalChecker, GoalSampler, SamplerSettings
from placement_planner_ros.core.search.uniform import UniformSampler
from placement_planner_ros.core.settings import Settings, setting
from placement_planner_ros.core.statistics import Statistics
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.timing.timing import CurveSettings
from placement_planner_ros.core.timing.trajectory_maker import TimingSettings, TrajectoryMaker
from placement_planner_ros.core.types import MAX_BOXES, Array, Goal, Placement, TargetVolume
from placement_planner_ros.core.unseen_way import unseen_share
from placement_planner_ros.core.wishes import checks
from placement_planner_ros.core.wishes.settings import TurnSettings, WishSettings

_EXPLAINED_SAMPLES = 2000
"""Samples after which a search that has found nothing says why; again each time they doubled."""

SamplerName = Literal["optimistic", "mcts", "uniform"]
SupportRegionName = Literal["any", "largest"]
SUPPORT_REGIONS: tuple[SupportRegionName, ...] = get_args(SupportRegionName)
SAMPLERS: tuple[SamplerName, ...] = get_args(SamplerName)


@dataclass(frozen=True, slots=True)
class PlannerSettings(Settings):
    """How to search. Budgets count samples and iterations, so a seed fixes the result.

    Attributes:
        sampler: how SampleGoals chooses where to sample: `optimistic` search over cells, `mcts` as
            the paper does (Algorithms 2 and 3: UCB1 and H), or `uniform`, the ablation.
        local_optimization: False for the ablation without OptimizeLocally.
        motion_iterations: m_max, RRT iterations per arm and grasp in one iteration of Algorithm 1.
        ik_seeds: starts of the inverse kinematics per sampled pose, beside q_0.
        min_improvement: ξ counts as better from this much.
        require_retreat: False: a placement may be without release and retreat.
        keep_out: corners of boxes, six numbers each, that nothing which moves may enter.
        turns: how the object shall be turned.
        wishes: what a weighted objective is made of, and what is required.
        carry: by how much the object may lean, and be accelerated, on its way.
    """

    sampler: SamplerName = setting("optimistic", text="How goals are sampled.", choices=SAMPLERS)
    local_optimization: bool = setting(
        True, text="Whether placements after the first are optimised before they are published."
    )
    motion_iterations: int = setting(150, "[1, inf)")
    ik_seeds: int = setting(63, "[1, inf)")
    min_improvement: float = setting(1e-4, "[0, inf)")
    support: SupportName = setting(
        "vertices",
        text="When an object stands. vertices: all of the face that it stands on has support at "
        "its corners (the paper's). polygon: the centre of mass lies inside the hull of those "
        "contact points that are supported, and the object can be tipped by 5 degrees; for racks, "
        "bridges, small pedestals and overhang.",
        choices=SUPPORTS,
    )
    support_margin: float = setting(
        0.01,
        "[0, 0.2]",
        "m",
        "With support: polygon, distance that the centre of mass keeps from the end of the hull of "
        "what is supported; it takes the place of edge_margin.",
    )
    edge_margin: float = setting(
        0.003,
        "[0, 0.2]",
        "m",
        "With support: vertices, distance that what the object stands on keeps from the end of its "
        "support: where the surface drops or was not seen, not where a thing stands.",
    )
    support_region: SupportRegionName = setting(
        "any",
        text="On which surfaces in `volume` an object is placed. largest: only on the largest "
        "and what is level with it, so not on top of other things; any: on all of them.",
        choices=SUPPORT_REGIONS,
    )
    contacts: tuple[str, ...] = setting(
        ("face",),
        text="Contact classes that are looked for. face: a face of the object on a surface; lean: "
        "an edge on a surface, the object against a wall. None is slot, as no straight way "
        "opens contacts with two walls at once: in a slot, lean finds what rests against one wall.",
        choices=CONTACTS,
    )
    friction: float = setting(
        0.3, "[0.05, 2]", text="With contacts: lean, friction coefficient of surfaces; walls: 0."
    )
    stability_margin: float = setting(
        0.05,
        "[0, 1]",
        text="With contacts: lean, the share of its weight that a leaning object bears in any "
        "horizontal direction besides, with 3 degrees of tilt.",
    )
    require_retreat: bool = setting(
        True, text="Whether a placement counts only with a certified release and retreat."
    )
    keep_out: tuple[float, ...] = setting(
        (),
        unit="m",
        text="Minimum and maximum corner of a box in `root frame` that moving links, hand and "
        "object keep out of, with their margin; or those of several boxes, one after the other, up "
        f"to {MAX_BOXES}. They carry nothing and do not count for clearance.",
    )
    turns: TurnSettings = field(default_factory=TurnSettings)
    wishes: WishSettings = field(default_factory=WishSettings)
    hierarchy: HierarchySettings = field(default_factory=HierarchySettings)
    optimistic: OptimisticSettings = field(default_factory=OptimisticSettings)
    mcts: MctsSettings = field(default_factory=MctsSettings)
    uniform: SamplerSettings = field(default_factory=SamplerSettings)
    ik: IKSettings = field(default_factory=IKSettings)
    collision: CollisionSettings = field(default_factory=CollisionSettings)
    approach: ApproachSettings = field(default_factory=ApproachSettings)
    retreat: RetreatSettings = field(default_factory=RetreatSettings)
    transit: TransitSettings = field(default_factory=TransitSettings)
    ascent: AscentSettings = field(default_factory=AscentSettings)
    timing: TimingSettings = field(default_factory=TimingSettings)
    carry: CarrySettings = field(default_factory=CarrySettings)

    @property
    def tilt(self) -> TiltLimit | None:
        """Of these, by how much the held object may lean; None for any.

        Raises:
            ParameterError: carry.max_tilt is set, but object.up is not.
        """
        return self.carry.tilt_limit(self.turns.up)

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        checks.check_boxes("keep_out", self.keep_out)
        if not self.contacts:
            raise ParameterError("contacts", (), f"name at least one of {', '.join(CONTACTS)}")

    def context(
        self, environment: Environment, volume: TargetVolume, body: Body
    ) -> ObjectiveContext:
        """What objectives and terms are made of, with what these settings say of them."""
        tolerance = self.collision.contact_tolerance
        return ObjectiveContext(environment, volume, body, self.wishes, self.support, tolerance)

    @property
    def turns_at_rest(self) -> TurnSettings:
        """How the object shall be turned, and that it leans there no more than on its way."""
        tilt = self.tilt
        if tilt is None:
            return self.turns
        return replace(self.turns, up_tolerance=min(self.turns.up_tolerance, tilt.at_rest))

    @property
    def footing(self) -> SupportSettings:
        """Of these, what s(x) is asked by."""
        tolerance = self.collision.contact_tolerance
        return SupportSettings(
            self.support,
            tolerance,
            self.edge_margin,
            self.support_margin,
            self.contacts,
            self.friction,
            self.stability_margin,
        )

    @property
    def grasp(self) -> GraspSettings:
        """Of these, what holding, approach, release and retreat are checked by."""
        return GraspSettings(
            self.collision,
            self.ik,
            self.approach,
            self.retreat,
            self.require_retreat,
            self.tilt,
            CurveSettings().chord_tolerance,
        )


class PlacementPlanner:
    """Algorithm 1: sample goals, plan motions, optimise locally, publish, repeat.

    A variant samples or plans in another way by overriding `make_sampler` or `make_motion`, which
    are called once, when the planner is made.

    Args:
        objective: ξ.
        rng: every random choice of the run is drawn from it.

    Attributes:
        environment: as given, without the boxes to keep out of.
        holdings: the usable arms with their grasps, by the arm's name and the grasp's number.
        sampler: SampleGoals.
        motion: PlanMotion.
        statistics: live counters, safe to read from other threads.
        exhausted: why there is nothing to search, or '' while there is; `cause` is the same for
            programs.
        unusable: why some of the arms and grasps are left out of the search.
        explanation: what `explain` said last, the run itself having asked at times.

    Raises:
        StartError: q_0 is not free for any arm and grasp, or far beyond the joints' limits.
        GraspError: in every grasp the object overlaps the arm.
        ParameterError: settings do not fit each other.
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
        # Refuse what cannot be planned for.
        settings.wishes.require_consistent()
        used = [joint for arm in problem.arms for joint in arm.used_joints]
        problem.robot.require_plausible(problem.q_start, used)
        # Whole turns of joints are taken off, and put back in each placement.
        unwound = problem.robot.unwound(problem.q_start)
        self._turned = {arm.name: (problem.q_start - unwound)[arm.q_index] for arm in problem.arms}
        self.environment = problem.environment
        # What nothing may enter, and the regions that are left.
        problem = with_exclusion_zones(replace(problem, q_start=unwound), settings.keep_out)
        if settings.support_region == "largest":
            environment = problem.environment.with_largest_region()
            problem = replace(problem, environment=environment)
        # Each part draws from a generator of its own.
        rng_sampler, rng_ik, rng_motion, rng_paths = rng.spawn(4)
        poses = PoseConstraints(
            problem,
            settings.collision,
            settings.footing,
            settings.approach.approach_minimum,
            settings.turns_at_rest,
            make_requirements(settings.context(self.environment, problem.volume, problem.body)),
        )
        self._poses, self._objective = poses, objective
        # Arms and grasps that can be used, and what checks their samples.
        holdings, self.unusable = usable_holdings(problem, settings.grasp)
        self.holdings = {(r.arm.name, r.grasp): r for of_arm in holdings for r in of_arm}
        finder = GoalFinder(poses, holdings, objective, settings.ik_seeds, rng_ik)
        # What is searched, and what can be proven of it; the middle is that of the object's box.
        middle = np.quantile(problem.body.vertices, (0.0, 1.0), axis=0).mean(axis=0)
        hierarchy = AfrHierarchy(
            [len(of_arm) for of_arm in holdings],
            len(poses.contacts.references),
            poses.contacts.regions,
            settings.hierarchy,
            poses.contacts.ranges,
            [0j if T is None else complex(*T.act(middle)[:2]) for T in poses.contacts.frames],
        )
        self.cause: Cause | None = None if hierarchy.usable else Cause.NO_FACE
        if not hierarchy.regions:
            self.cause = Cause.NO_REGION
        step("making the bounds of the search")
        self._bounds = BranchBounds(poses, self.holdings.values(), hierarchy.sets, objective)
        self._remainder = Remainder(hierarchy, self._bounds)
        step("making the sampler")
        self.sampler = self.make_sampler(hierarchy, finder, rng_sampler)
        self.motion = self.make_motion(rng_motion)
        self._optimizer = LocalOptimizer(
            poses, objective, settings.min_improvement, settings.ascent
        )
        self._unoptimized: tuple[Goal, Array] | None = None  # the first placement, and the path
        self._trajectories = TrajectoryMaker(
            settings.timing, settings.carry.max_acceleration, rng_paths
        )
        self.statistics = Statistics(self.sampler.count)
        self._search = Search(
            problem,
            self.environment,
            settings.grasp,
            poses,
            finder,
            hierarchy,
            self.unusable,
            PlannerSettings().footing,
        )
        self.explanation = Explanation("")
        self.exhausted = self.explain().short if self.cause else ""

    def make_sampler(
        self, hierarchy: AfrHierarchy, checker: GoalChecker, rng: np.random.Generator
    ) -> GoalSampler:
        """SampleGoals, as the settings ask for it."""
        settings = self._settings
        if settings.sampler == "mcts":
            return MctsSampler(hierarchy, checker, settings.mcts, rng)
        if settings.sampler == "uniform":
            return UniformSampler(hierarchy, checker, settings.uniform, rng)
        return OptimisticSampler(hierarchy, checker, settings.optimistic, rng, self._bounds)

    def make_motion(self, rng: np.random.Generator) -> GoalPlanner:
        """PlanMotion over all of `holdings`."""
        return MotionPlanner(list(self.holdings.values()), self._settings.transit, rng)

    def run(self, should_stop: Callable[[], bool]) -> Iterator[Placement]:
        """Yield each placement strictly better than the one before (ξ_best) until told to stop
        (Terminate)."""
        started = time.monotonic()
        best = -np.inf
        explain_at = _EXPLAINED_SAMPLES
        while not (self.exhausted or should_stop()):
            # Sample goals that are better than what is known.
            bound = best + self._settings.min_improvement  # what every sample is held against
            for goal in self.sampler.sample_goals(bound, should_stop):
                self.motion.add(goal)
                self.statistics.goals += 1
            # Now and then say why nothing has been found.
            if best == -np.inf and self.statistics.samples >= explain_at:
                explain_at = 2 * self.statistics.samples
                self.explain()
            # Rule out what cannot be better.
            if best > -np.inf:
                self._narrow(best)
            # Without a goal sample on, unless it is proven that there is none.
            if self.motion.goals == 0 and best == -np.inf and self._remainder.empty():
                self.cause = self._remainder.cause
                self.exhausted = self.explain().short
            # Some more iterations of planning to the goals; where none is reached, what was
            # placed first is optimised.
            found = None
            if self.motion.goals > 0:
                found = self.motion.plan(self._settings.motion_iterations, should_stop)
                self.statistics.motion_iterations = self.motion.iterations
            found = found or self._unoptimized
            if found is None:
                continue
            # Optimise, time and publish; goals that are no better now are dropped.
            for placement in self._placements(*found, best, started, should_stop):
                best = placement.objective
                self.motion.retire_up_to(best + self._settings.min_improvement)
                self.statistics.best = best
                self.statistics.solutions += 1
                yield placement

    def _narrow(self, best: float) -> None:
        """Look closer at where something better may be; the end where that is nowhere."""
        smallest = self._settings.min_improvement
        self._remainder.narrow(best + smallest, self.statistics.samples)
        self.statistics.gap = self._remainder.gap(best, smallest)
        if self.statistics.gap == smallest and self.motion.goals == 0:
            self.exhausted = f"no placement can be better by more than {smallest:g}"

    def explain(self) -> Explanation:
        """Why nothing was found, or where something was, what refused most samples.

        In the thread that runs the search, or once that has ended.
        """
        statistics = self.statistics
        if statistics.solutions:
            self.explanation = Explanation(shares_in_words(statistics.count.verdicts))
            return self.explanation
        rulings = self._remainder.rulings if self.cause else frozenset()
        self.explanation = explain_search(self._search, statistics, rulings)
        return self.explanation

    def _placements(
        self, goal: Goal, path: Array, best: float, started: float, should_stop: Callable[[], bool]
    ) -> Iterator[Placement]:
        """What a path to a goal gives: the locally optimised placement, or the one that was reached
        where that cannot be timed.

        Where nothing was found before it is the one that was reached, at once, which is optimised
        once no better goal is reached at once.
        """
        self.motion.retire(goal)
        holding = self.holdings[goal.arm, goal.grasp]
        self._unoptimized = None
        if best == -np.inf:
            first = self._timed(path, goal, holding, started, should_stop)
            if first is not None:
                self._unoptimized = goal, path
                yield first
                return
        if self._settings.local_optimization and not should_stop():
            refined, slide = self._optimizer.optimize(goal, holding, should_stop)
            if refined is not goal:
                further = np.vstack([path, slide[1:]])
                better = self._timed(further, refined, holding, started, should_stop)
                if better is not None:
                    yield better
                    return
        if -np.inf < best < goal.objective:
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
        placement = Placement(
            goal,
            made.trajectory,
            made.approach_start,
            time.monotonic() - started,
            self.statistics.samples,
            made.retreat,
            self._terms(goal),
            unseen_share(
                self._poses.problem,
                holding.moving.arm,
                holding.grasp,
                made.trajectory,
                made.retreat,
            ),
            self._remainder.gap(goal.objective, self._settings.min_improvement),
            self._poses.contacts.resting(goal.T_world_object, goal.face),
        )
        return placement.turned(self._turned[goal.arm])

    def _terms(self, goal: Goal) -> tuple[tuple[str, float], ...]:
        """What a placement there is judged by, and what is required of it, by name."""
        found: dict[str, float] = {}
        for of in (self._poses.required, self._objective):
            if isinstance(of, TermedObjective):
                found |= of.terms(goal.T_world_object)
        return tuple(found.items())
