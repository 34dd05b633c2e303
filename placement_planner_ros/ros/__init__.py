"""The ROS 2 adapter around the planner: `node` and the programs that come with it.

Nothing outside this package imports ROS, or this package, but for `client`, which a user's program
loads beside it.
"""

import sys
from importlib.util import find_spec

from placement_planner_ros.__main__ import ROS_REMEDY

# While `python -m` looks for the program to start, that is all of the command line there is.
if sys.argv[:1] == ["-m"] and find_spec("rclpy") is None:
    sys.exit(f"rclpy is missing; {ROS_REMEDY}")
