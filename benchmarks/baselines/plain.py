"""The plain path: uniform samples, stock RRTConnect and coal, one configuration at a time."""

from __future__ import annotations

import numpy as np

from benchmarks.baselines.exact_collision import ExactCollision, box_tree
from benchmarks.baselines.rrt_connect import BaselinePlanner
from benchmarks.record import boxes_ready
from placement_planner_ros.core.objective.objective import Objective
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.problem import Problem


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
            exact = ExactCollision(
                holding.moving, holding.held, problem.environment.obstacles, settings.collision
            )
            holding.collision = exact  # type: ignore[assignment]  # same methods

    @staticmethod
    def register(problem: Problem) -> None:
        """Register the environment's boxes with coal too, as a system does when a cloud arrives."""
        boxes_ready(problem)
        box_tree(problem.environment.obstacles)
