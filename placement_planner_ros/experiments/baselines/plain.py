"""The plain path: uniform samples, stock RRTConnect and coal, one configuration at a time."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.objective.objective import Objective
from placement_planner_ros.core.planner import PlannerSettings, Problem
from placement_planner_ros.core.types import Array
from placement_planner_ros.experiments.baselines.exact_collision import ExactCollision, box_tree
from placement_planner_ros.experiments.baselines.rrt_connect import BaselinePlanner

STEP = 0.005
"""m that any point of arm and object may move between two checked configurations."""

EdgeFree = Callable[[Array, Array], bool]


class CoalCollision:
    """`ArmCollision` as most systems have it: coal alone, edges by samples, nothing certified."""

    def __init__(self, exact: ExactCollision) -> None:
        self.settings = exact.settings
        self._exact = exact

    def free(self, q: Array, reserve: float = 0.0, contact: bool = False) -> bool:
        """As `ArmCollision.free`."""
        return self._exact.free(q, reserve, contact)

    def free_batch(
        self, Q: Array, reserve: float = 0.0, contact: bool = False
    ) -> npt.NDArray[np.bool_]:
        """As `ArmCollision.free_batch`, one after the other."""
        return np.array([self._exact.free(q, reserve, contact) for q in Q], dtype=np.bool_)

    def hand_collides(self, *_: object, **__: object) -> bool:
        """As `ArmCollision.hand_collides`: coal alone has no such check."""
        return False

    def edge_free(
        self,
        a: Array,
        b: Array,
        *,
        contact: bool = False,
        deviation: Array | None = None,
        reserve: float = 0.0,
    ) -> bool:
        """Samples every 5 mm; how far the motion may stray from the line is left out."""
        return self._exact.edge_free(a, b, STEP, reserve, contact)


class PlainPlanner(BaselinePlanner):
    """Uniform samples, IK, stock RRTConnect; the arm is checked by coal alone.

    Shared with the planner, in favour of the plain path: support, the object's own check c_f,
    inverse kinematics, release and retreat, and timing.
    """

    def __init__(
        self,
        problem: Problem,
        objective: Objective,
        settings: PlannerSettings,
        rng: np.random.Generator,
    ) -> None:
        super().__init__(problem, objective, settings, rng)
        for holding in self.holdings.values():
            holding.collision = CoalCollision(  # type: ignore[assignment]  # same methods
                ExactCollision(
                    problem.robot,
                    holding.arm,
                    holding.grasp,
                    problem.body,
                    problem.environment.obstacles,
                    problem.q_start,
                    settings.collision,
                )
            )

    @staticmethod
    def register(problem: Problem) -> None:
        """Register the environment's boxes with coal, as a system does when a cloud arrives."""
        box_tree(problem.environment.obstacles)


def rrt_connect(
    holding: Holding, goals: Sequence[Array], edge_free: EdgeFree, limit: float
) -> Array | None:
    """A path (n, dof) from q_0 to one of the goals (dof,) by OMPL's RRTConnect as it comes.

    Args:
        edge_free: whether a straight motion is free, its ends included.
        limit: seconds.
    """
    ou.setLogLevel(ou.LOG_ERROR)
    dof = len(holding.q_start)
    space = ob.RealVectorStateSpace(dof)
    bounds = ob.RealVectorBounds(dof)
    for i, (low, high) in enumerate(zip(holding.arm.lower, holding.arm.upper, strict=True)):
        bounds.setLow(i, float(low))
        bounds.setHigh(i, float(high))
    space.setBounds(bounds)
    information = ob.SpaceInformation(space)

    def state(q: Array) -> ob.State:
        made = space.allocState()
        for i, x in enumerate(q.tolist()):
            made[i] = x
        return made

    class Validator(ob.MotionValidator):
        def checkMotion(self, a: ob.State, b: ob.State, last_valid: object = None) -> bool:
            return edge_free(_values(a, dof), _values(b, dof))

    information.setMotionValidator(Validator(information))
    information.setStateValidityChecker(lambda state: True)  # every edge's ends are checked with it
    information.setup()
    problem = ob.ProblemDefinition(information)
    problem.addStartState(state(holding.q_start))
    region = ob.GoalStates(information)
    for q in goals:
        region.addState(state(q))
    problem.setGoal(region)
    planner = og.RRTConnect(information)
    planner.setProblemDefinition(problem)
    planner.setup()
    deadline = time.perf_counter() + limit
    status = planner.solve(ob.PlannerTerminationCondition(lambda: time.perf_counter() > deadline))
    if status.getStatus() != ob.PlannerStatus.EXACT_SOLUTION:
        return None
    return np.array([_values(each, dof) for each in problem.getSolutionPath().getStates()])


def _values(state: ob.State, dof: int) -> Array:
    return np.array([state[i] for i in range(dof)])
