"""The search that is explained, and its progress."""

from __future__ import annotations

from dataclasses import dataclass, field

from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.contacts.support_settings import SupportSettings
from placement_planner_ros.core.grasp.settings import GraspSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.sample_goals.cell_bounds import BranchBounds
from placement_planner_ros.core.sample_goals.goals import GoalFinder
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.search.pruning import Ruling
from placement_planner_ros.core.search.sampler import SampleCount


@dataclass(frozen=True, slots=True, weakref_slot=True, eq=False)
class Search:
    """A search, as it was set up.

    Attributes:
        problem, settings, poses, hierarchy: its own.
        before: the environment without the boxes to keep out of.
        finder: holds the arms, and what became of the tries to reach poses.
        bounds: how far the arms reach.
        unusable: arms and grasps that were left out, in words.
        usual_support: the settings of s(x) by default.
    """

    problem: Problem
    before: Environment
    settings: GraspSettings
    poses: PoseConstraints
    finder: GoalFinder
    hierarchy: AfrHierarchy
    bounds: BranchBounds
    unusable: tuple[str, ...]
    usual_support: SupportSettings


@dataclass(frozen=True, slots=True, eq=False)
class Progress:
    """How far it has got.

    Attributes:
        count: samples and their verdicts.
        found: how many goals.
        iterations: of motion planning.
        unreached: motions that could not be certified.
        rulings: why nothing is left to look at; empty where something is.
    """

    count: SampleCount = field(default_factory=SampleCount)
    found: int = 0
    iterations: int = 0
    unreached: int = 0
    rulings: frozenset[Ruling] = frozenset()
