"""Whether it is the limit on the tilt that leaves no way to placements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.explanation.explanation import Remedy
from placement_planner_ros.core.explanation.search import Search
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.grasp.start_state_check import in_degrees
from placement_planner_ros.core.motion.birrt import GoalSetRRT, GoalSetRRTSettings
from placement_planner_ros.core.types import Goal

_ITERATIONS = 100
"""Of a second search, without the limit."""


@dataclass(frozen=True, slots=True)
class Blame:
    """What the limit has to do with it.

    Attributes:
        cause: how the cause goes on.
        certain: whether there is a way without the limit.
        seen: what the second search showed.
    """

    cause: str
    certain: bool
    remedy: Remedy
    seen: str


def tilted_way(search: Search, goals: Sequence[Goal]) -> Blame | None:
    """Search for ways to the goals that may tilt the object; None where any may."""
    limit = search.settings.tilt
    if limit is None:
        return None
    most = in_degrees(limit.most)
    cause = f", with object.up within {most} of the vertical all the way (carry.max_tilt)"
    words = "raise it, or start with the object nearer to upright, or with the arm elsewhere"
    remedy = Remedy("carry.max_tilt", words)
    for holding in search.finder.holdings:
        own = [g for g in goals if (g.arm, g.grasp) == (holding.arm.name, holding.grasp)]
        if own and _reached(holding, own):
            said = f"without carry.max_tilt, there is a way to one of them for arm {own[0].arm}"
            return Blame(cause, True, remedy, said)
    said = f"without carry.max_tilt, none was found in {_ITERATIONS} iterations either"
    return Blame(cause, False, remedy, said)


def _reached(holding: Holding, goals: Sequence[Goal]) -> bool:
    search = GoalSetRRT(
        holding.arm.lower,
        holding.arm.upper,
        holding.q_start,
        holding.edge_free,
        GoalSetRRTSettings(),
        np.random.default_rng(0),
    )
    for key, goal in enumerate(goals):
        search.add_goal(key, goal.q_raised)
    return search.solve(_ITERATIONS) is not None
