"""The planner as a library: nothing in here knows of ROS."""
