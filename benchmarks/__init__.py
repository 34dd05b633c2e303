"""Measurements of the planner, started by `python -m benchmarks`."""

from placement_planner_ros.core.kernels import use_kernel_folder

use_kernel_folder()
