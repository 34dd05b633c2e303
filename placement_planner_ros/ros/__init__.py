"""The ROS 2 adapter around the planner: `node` and the programs that come with it.

Nothing outside this package imports ROS, or this package, but for `client`, which a user's program
loads beside it.
"""
