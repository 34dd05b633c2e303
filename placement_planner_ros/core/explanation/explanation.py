"""A search that is explained; a cause, what to try, and the numbers behind it."""

from __future__ import annotations

from dataclasses import dataclass

from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.contacts.support_settings import SupportSettings
from placement_planner_ros.core.grasp.settings import GraspSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.sample_goals.goals import GoalFinder
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.search.hierarchy import AfrHierarchy

SENSOR = "sensor pose"
"""What says where a sensor is."""


@dataclass(frozen=True, slots=True)
class Remedy:
    """Something to try.

    Attributes:
        parameter: what to change, as a setting or an input is called; several with commas between.
        words: to what, or how.
    """

    parameter: str
    words: str

    def __str__(self) -> str:
        return f"{quoted(self.parameter)}: {self.words}"


@dataclass(frozen=True, slots=True)
class Explanation:
    """Why nothing was found.

    Attributes:
        cause: the main one, a sentence with its numbers.
        remedies: what to try, the most promising first.
        details: further sentences.
    """

    cause: str
    remedies: tuple[Remedy, ...] = ()
    details: tuple[str, ...] = ()

    @property
    def short(self) -> str:
        """Cause and remedies on one line."""
        tries = "; or ".join(map(str, self.remedies))
        return f"{self.cause}; try {tries}" if tries else self.cause

    def __str__(self) -> str:
        return "\n".join([self.cause, *(f"try {each}" for each in self.remedies), *self.details])


@dataclass(frozen=True, slots=True, weakref_slot=True, eq=False)
class Search:
    """A search, as it was set up.

    Attributes:
        problem, settings, poses, hierarchy: its own.
        before: the environment without the boxes to keep out of.
        finder: holds the arms, and what became of the tries to reach poses.
        unusable: arms and grasps that were left out, in words.
        usual_support: the settings of s(x) by default.
    """

    problem: Problem
    before: Environment
    settings: GraspSettings
    poses: PoseConstraints
    finder: GoalFinder
    hierarchy: AfrHierarchy
    unusable: tuple[str, ...]
    usual_support: SupportSettings


def quoted(names: str) -> str:
    """Names of settings and inputs, in the backticks by which they are known as such."""
    # what an arm has is named with its arm, which is no part of the name
    parts = (name.partition(" of arm ") for name in names.split(", "))
    return ", ".join(f"`{name}`{of}{arm}" for name, of, arm in parts)
