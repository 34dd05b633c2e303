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
        self._edge_free = edge_free
        space = ob.RealVectorStateSpace(len(lower))
        bounds = ob.RealVectorBounds(len(lower))
        for i, (low, high) in enumerate(zip(lower, upper, strict=True)):
            bounds.setLow(i, float(low))
            bounds.setHigh(i, float(high))
        space.setBounds(bounds)
        self.information = ob.SpaceInformation(space)
        self.information.setMotionValidator(_EdgeTest(self))
        self.information.setStateValidityChecker(lambda state: True)  # edges include their ends
        self.information.setup()

    def free(self, a: ob.State, b: ob.State) -> bool:
        """The edge test."""
        self.edges += 1
        return bool(self._edge_free(joints_of(self.information, a), joints_of(self.information, b)))

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
        problem.addStartState(state_of(self.information, start))
        region = ob.GoalStates(self.information)
        for q in goals:
            region.addState(state_of(self.information, q))
        problem.setGoal(region)
        planner = make(self.information)
        planner.setProblemDefinition(problem)
        planner.setup()

        def solve(until: float | Callable[[], bool]) -> Array | None:
            end = ob.PlannerTerminationCondition(until) if callable(until) else until
            if planner.solve(end).getStatus() != ob.PlannerStatus.EXACT_SOLUTION:
                return None
            return path_joints(self.information, problem.getSolutionPath())

        return solve


def state_of(information: ob.SpaceInformation, q: Array) -> ob.State:
    """Joint values (dof,) as a state of OMPL."""
    state = information.allocState()
    for i, x in enumerate(q.tolist()):
        state[i] = x
    return state


def joints_of(information: ob.SpaceInformation, state: ob.State) -> Array:
    """(dof,) joint values of a state of OMPL."""
    return np.array([state[i] for i in range(information.getStateDimension())])


def path_joints(information: ob.SpaceInformation, path: og.PathGeometric) -> Array:
    """(n, dof) joint values of OMPL's path."""
    return np.array([joints_of(information, state) for state in path.getStates()])


class _EdgeTest(ob.MotionValidator):
    """OMPL's bindings never free the space information and its validator, hence the weak one."""

    def __init__(self, space: EdgeSpace) -> None:
        super().__init__(space.information)
        self._space = weakref.ref(space)

    def checkMotion(self, a: ob.State, b: ob.State, last_valid: object = None) -> bool:
        space = self._space()
        assert space is not None
        return space.free(a, b)
