"""Clouds of real sensors: a table found in each, put before the robot, and objects placed there."""
