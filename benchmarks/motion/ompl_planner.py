"""The goal-set bidirectional RRT as an OMPL planner.

For use wherever OMPL takes a planner: `SimpleSetup`, comparison with its own planners on the same
`SpaceInformation`, its simplifiers. The search itself is `birrt.GoalSetRRT`, which keeps its nodes
in arrays instead of one OMPL state each.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from ompl import base as ob

from benchmarks.motion.ompl_space import joints_of, ompl_path, state_of
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.motion.birrt import GoalSetRRT, GoalSetRRTSettings
from placement_planner_ros.core.types import Array

_UNBOUNDED = 2**62  # iterations: the termination condition ends the search


class GoalSetPlanner(ob.Planner):
    """`GoalSetRRT` over an OMPL `RealVectorStateSpace`, edges checked by its `MotionValidator`.

    The problem definition gives one start and goal states; the n-th goal gets key n. State is kept
    between calls of `solve`, as OMPL planners do; goal states that the problem definition gained
    meanwhile are added. `search` gives access to the goal set itself.
    """

    def __init__(
        self,
        si: ob.SpaceInformation,
        settings: GoalSetRRTSettings,
        rng: np.random.Generator,
        max_goals: int = 500,
    ) -> None:
        """Make a planner without a problem.

        Args:
            si: space information of a bounded `RealVectorStateSpace`, set up, with a motion
                validator.
            settings: how the trees grow.
            rng: the only source of randomness; OMPL's own is not used.
            max_goals: goals taken from a goal region that could be sampled for ever.

        Raises:
            ParameterError: the space is of another kind.
        """
        super().__init__(si, "GoalSetRRT")
        if not isinstance(si.getStateSpace(), ob.RealVectorStateSpace):
            raise ParameterError("si", type(si.getStateSpace()).__name__, "needs real vectors")
        self._settings = settings
        self._rng = rng
        self._max_goals = max_goals
        self._goals_read = 0
        self._search: GoalSetRRT | None = None

    @property
    def search(self) -> GoalSetRRT | None:
        """The search, once `solve` has seen a start state."""
        return self._search

    def solve(self, ptc: float | Callable[[], bool]) -> ob.PlannerStatus:
        """Search until one more goal is reached; the path goes to the problem definition.

        Args:
            ptc: seconds, or what returns True when to stop (a `PlannerTerminationCondition` does).
        """
        status = ob.PlannerStatus.PlannerStatusType
        inputs = self.getPlannerInputStates()
        if self._search is None:
            start = inputs.nextStart()
            if start is None:
                return ob.PlannerStatus(status.INVALID_START)
            self._search = self._plant(joints_of(self.getSpaceInformation(), start))
        while self._goals_read < self._max_goals and (goal := inputs.nextGoal()) is not None:
            self._search.add_goal(self._goals_read, joints_of(self.getSpaceInformation(), goal))
            self._goals_read += 1
        if self._goals_read == 0:
            return ob.PlannerStatus(status.INVALID_GOAL)
        if callable(ptc):
            found = self._search.solve(_UNBOUNDED, ptc)
        else:
            deadline = time.monotonic() + ptc
            found = self._search.solve(_UNBOUNDED, lambda: time.monotonic() >= deadline)
        if found is None:
            return ob.PlannerStatus(status.TIMEOUT)
        path = ompl_path(self.getSpaceInformation(), found[1])
        self.getProblemDefinition().addSolutionPath(path, False, 0.0, self.getName())
        return ob.PlannerStatus(status.EXACT_SOLUTION)

    def clear(self) -> None:
        """Forget the problem's states and all trees."""
        super().clear()
        self._goals_read = 0
        self._search = None

    def _plant(self, start: Array) -> GoalSetRRT:
        si = self.getSpaceInformation()
        bounds = si.getStateSpace().getBounds()
        validator = si.getMotionValidator()

        def edge_is_free(a: Array, b: Array) -> bool:
            return bool(validator.checkMotion(state_of(si, a), state_of(si, b)))

        lower, upper = np.array(list(bounds.low)), np.array(list(bounds.high))
        return GoalSetRRT(lower, upper, start, edge_is_free, self._settings, self._rng)
