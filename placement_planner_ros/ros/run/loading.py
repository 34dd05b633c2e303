"""The kernels of the node's own inputs, compiled or loaded."""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.warmup.known_robot import known_robot
from placement_planner_ros.ros.inputs import point_cloud
from placement_planner_ros.ros.inputs.self_filter import outside_robot
from placement_planner_ros.ros.run import surroundings


def load_input_kernels() -> None:
    """Read, filter and crop a cloud of one point."""
    robot, _ = known_robot()
    q = np.zeros(robot.model.nq)
    outside_robot(np.zeros((1, 3)), robot, q, (), None, 0.0)
    point_cloud.warm_up()
    surroundings.warm_up()
