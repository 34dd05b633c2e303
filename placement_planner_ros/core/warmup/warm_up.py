"""Load (or compile) every kernel before the first search needs it."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.grasp.feasible_grasps import within_limits
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.reach.seeds import seed_table
from placement_planner_ros.core.robot.arm import MovingArm
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.warmup.known_task import KnownTask


def warm_up(robot: Robot, arms: Sequence[Arm], q_robot: Array) -> None:
    """Load what every stage of a search needs, and make what depends on the robot alone.

    Args:
        q_robot: (nq,) any configuration of the robot.

    Raises:
        WarmupError: the known task was not solved.
        PlacementPlannerError: robot or arms are unusable.
    """
    _solve_once()
    for arm in (within_limits(each, PlannerSettings().grasp) for each in arms):
        seed_table(Chain.from_robot(robot, arm, q_robot))
        somewhere = ObstacleSet.from_points(np.zeros((1, 3)))
        ArmCollision(MovingArm(robot, arm, q_robot), None, somewhere)


@functools.cache
def _solve_once() -> None:
    """Solve the known task, once in a process."""
    KnownTask().solve()
