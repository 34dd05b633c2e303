"""The kernels of the node's own inputs, compiled or loaded."""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.scene.extent import cropped
from placement_planner_ros.core.scene.grid import GridSettings
from placement_planner_ros.core.warmup.known_robot import known_robot
from placement_planner_ros.ros.inputs import point_cloud
from placement_planner_ros.ros.inputs.self_filter import Outline, near_points


def load_input_kernels() -> None:
    """Read, filter and crop a cloud of one point."""
    robot, _ = known_robot()
    q = np.zeros(robot.model.nq)
    near_points(np.zeros((1, 3)), Outline.of_robot(robot, q, 0.0), {}, 0.0, GridSettings())
    point_cloud.warm_up()
    cropped(np.zeros(3), np.ones(3), np.zeros((1, 3)), 1.0)
