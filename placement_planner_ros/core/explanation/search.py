"""What an explanation is made from: a search, and how far it has got."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.grasp.settings import GraspSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.sample_goals.cell_bounds import BranchBounds
from placement_planner_ros.core.sample_goals.goals import GoalFinder
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.search.pruning import Ruling
from placement_planner_ros.core.search.sampler import SampleCount
from placement_planner_ros.core.types import Goal


@dataclass(frozen=True, slots=True, weakref_slot=True, eq=False)
class Search:
    """A search, as it was set up.

    Attributes:
        problem, settings, poses, hierarchy: its own.
        before: the environment without the boxes to keep out of.
        finder: holds the arms, and what became of the tries to reach poses.
        bounds: how far the arms reach.
        unusable: arms and grasps that were left out, in words.
        up_tolerance: how far from the vertical `object.up` might be at rest but for the limit on
            the tilt, rad.
    """

    problem: Problem
    before: Environment
    settings: GraspSettings
    poses: PoseConstraints
    finder: GoalFinder
    hierarchy: AfrHierarchy
    bounds: BranchBounds
    unusable: tuple[str, ...]
    up_tolerance: float


@dataclass(frozen=True, slots=True, eq=False)
class Progress:
    """How far it has got.

    Attributes:
        count: samples and their verdicts.
        found: how many goals, of which `goals` are the last.
        iterations: of motion planning.
        unreached: motions that could not be certified.
        rulings: why nothing is left to look at; empty where something is.
    """

    count: SampleCount = field(default_factory=SampleCount)
    found: int = 0
    goals: Sequence[Goal] = ()
    iterations: int = 0
    unreached: int = 0
    rulings: frozenset[Ruling] = frozenset()
