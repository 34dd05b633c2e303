"""Joint space as OMPL's planners see it, with an edge test for their motion validator."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence

import numpy as np
from ompl import base as ob
from ompl import geometric as og

from placement_planner_ros.core.types import Array

EdgeFree = Callable[[Array, Array], bool]


class EdgeSpace:
    """A box of joint values whose motions are asked for with an edge test.

    Args:
        lower, upper: (dof,) joint limits, rad.
        edge_free: whether a straight motion is free, its ends included.

    Attributes:
        information: for whatever of OMPL takes a `SpaceInformation`.
        edges: how many motions were asked for.
    """

    def __init__(self, lower: Array, upper: Array, edge_free: EdgeFree) -> None:
        self.edges = 0
        self._dof = len(lower)
        self._edge_free = edge_free
        space = ob.RealVectorStateSpace(self._dof)
        bounds = ob.RealVectorBounds(self._dof)
        for i in range(self._dof):
            bounds.setLow(i, float(lower[i]))
            bounds.setHigh(i, float(upper[i]))
        space.setBounds(bounds)
        self.information = ob.SpaceInformation(space)
        self.information.setMotionValidator(_EdgeTest(self))
        self.information.setStateValidityChecker(lambda state: True)  # edges include their ends
        self.information.setup()

    def free(self, a: ob.State, b: ob.State) -> bool:
        """The edge test."""
        self.edges += 1
        return bool(self._edge_free(self._joints(a), self._joints(b)))

    def planner(
        self,
        make: Callable[[ob.SpaceInformation], ob.Planner],
        start: Array,
        goals: Sequence[Array],
    ) -> Callable[[float | Callable[[], bool]], Array | None]:
        """A planner that OMPL has set up for a problem, ready to go.

        Args:
            start: (dof,).
            goals: (dof,) each, any of which will do.

        Returns:
            What takes seconds, or what is True when to stop, and gives a path (n, dof) or None.
        """
        problem = ob.ProblemDefinition(self.information)
        problem.addStartState(self._state(start))
        region = ob.GoalStates(self.information)
        for q in goals:
            region.addState(self._state(q))
        problem.setGoal(region)
        planner = make(self.information)
        planner.setProblemDefinition(problem)
        planner.setup()

        def solve(until: float | Callable[[], bool]) -> Array | None:
            end = ob.PlannerTerminationCondition(until) if callable(until) else until
            if planner.solve(end).getStatus() != ob.PlannerStatus.EXACT_SOLUTION:
                return None
            return self._values(problem.getSolutionPath())

        return solve

    def simplified(self, path: Array) -> Array:
        """A path (n, dof) after OMPL's simplifier has done all it can."""
        geometric = og.PathGeometric(self.information)
        for q in path:
            geometric.append(self._state(q))
        og.PathSimplifier(self.information).simplifyMax(geometric)
        return self._values(geometric)

    def _state(self, q: Array) -> ob.State:
        state = self.information.allocState()
        for i, x in enumerate(q.tolist()):
            state[i] = x
        return state

    def _joints(self, state: ob.State) -> Array:
        return np.array([state[i] for i in range(self._dof)])

    def _values(self, path: og.PathGeometric) -> Array:
        return np.array([self._joints(state) for state in path.getStates()])


class _EdgeTest(ob.MotionValidator):
    """OMPL's bindings never free the space information and its validator, hence the weak one."""

    def __init__(self, space: EdgeSpace) -> None:
        super().__init__(space.information)
        self._space = weakref.ref(space)

    def checkMotion(self, a: ob.State, b: ob.State, last_valid: object = None) -> bool:
        space = self._space()
        assert space is not None
        return space.free(a, b)
