"""The plain baseline: place as most systems do, with a stock planner, one goal at a time."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.objective.objective import Objective
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings, Problem
from placement_planner_ros.core.types import Array, Goal

SECONDS_PER_GOAL = 5.0
"""How long RRTConnect may take for one goal, of processor time, as in the paper's experiments."""


class _EdgeValidator(ob.MotionValidator):
    """The certified edge check of the planner; counts how often it is asked."""

    def __init__(self, si: ob.SpaceInformation, holding: Holding) -> None:
        super().__init__(si)
        self._free = holding.transit_free
        self._dof = len(holding.q_start)
        self.asked = 0

    def checkMotion(self, a: ob.State, b: ob.State, last_valid: object = None) -> bool:
        self.asked += 1
        return bool(self._free(_values(a, self._dof), _values(b, self._dof)))


def _values(state: ob.State, dof: int) -> Array:
    return np.array([state[i] for i in range(dof)])


class RRTConnectMotion:
    """PlanMotion with OMPL's RRTConnect as it comes: a new search for every goal, in their order.

    Takes the place of `MotionPlanner`. OMPL draws from its own generator, so that runs of the
    baseline do not repeat exactly.
    """

    def __init__(self, holdings: Mapping[tuple[str, int], Holding]) -> None:
        ou.setLogLevel(ou.LOG_ERROR)
        self._holdings = holdings
        self._waiting: list[Goal] = []
        self.iterations = 0

    @property
    def goals(self) -> int:
        """Goals not tried yet."""
        return len(self._waiting)

    def add(self, goal: Goal) -> None:
        """One more goal to try."""
        self._waiting.append(goal)

    def retire(self, goal: Goal) -> None:
        """Forget a goal."""
        self._waiting = [g for g in self._waiting if g is not goal]

    def retire_up_to(self, bound: float) -> None:
        """Forget the goals with ξ ≤ bound."""
        self._waiting = [g for g in self._waiting if g.objective > bound]

    def plan(
        self, max_iterations: int, should_stop: Callable[[], bool]
    ) -> tuple[Goal, Array] | None:
        """Try the first goal until it is reached or `SECONDS_PER_GOAL` have passed.

        Args:
            max_iterations: not used; a stock planner is given time.

        Returns:
            The goal and the path (n, dof) from q_0 to its raised pre-placement, or None.
        """
        goal = self._waiting.pop(0)
        holding = self._holdings[goal.arm, goal.grasp]
        deadline = time.process_time() + SECONDS_PER_GOAL
        space = ob.RealVectorStateSpace(len(holding.q_start))
        bounds = ob.RealVectorBounds(len(holding.q_start))
        for i, (low, high) in enumerate(zip(holding.arm.lower, holding.arm.upper, strict=True)):
            bounds.setLow(i, float(low))
            bounds.setHigh(i, float(high))
        space.setBounds(bounds)
        si = ob.SpaceInformation(space)
        validator = _EdgeValidator(si, holding)
        si.setMotionValidator(validator)
        si.setStateValidityChecker(lambda state: True)  # every edge's ends are checked with it
        si.setup()
        problem = ob.ProblemDefinition(si)
        start, end = space.allocState(), space.allocState()
        for i, (a, b) in enumerate(zip(holding.q_start, goal.q_raised, strict=True)):
            start[i], end[i] = float(a), float(b)
        problem.setStartAndGoalStates(start, end)
        planner = og.RRTConnect(si)
        planner.setProblemDefinition(problem)
        planner.setup()
        status = planner.solve(
            ob.PlannerTerminationCondition(lambda: should_stop() or time.process_time() > deadline)
        )
        self.iterations += validator.asked
        if status.getStatus() != ob.PlannerStatus.EXACT_SOLUTION:
            return None
        states = problem.getSolutionPath().getStates()
        return goal, np.array([_values(state, len(holding.q_start)) for state in states])


class BaselinePlanner(PlacementPlanner):
    """Uniform samples of position and yaw on the surfaces, IK, RRTConnect, the best is kept.

    Samples that are no better than the best placement so far are not planned for. Everything but
    the way of sampling and planning, checks and timing included, is the planner's own.
    """

    def __init__(
        self,
        problem: Problem,
        objective: Objective,
        settings: PlannerSettings,
        rng: np.random.Generator,
    ) -> None:
        plain = replace(
            settings, sampler="uniform", local_optimization=False, gradient_sampling=False
        )
        super().__init__(problem, objective, plain, rng)

    def make_motion(self, rng: np.random.Generator) -> RRTConnectMotion:
        """One goal at a time, without `rng`, which OMPL does not draw from."""
        return RRTConnectMotion(self.holdings)
