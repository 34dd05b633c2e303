"""Keeps each test run's ROS traffic on this machine and apart from other runs."""

import os

# Before rclpy is first imported: it reads these when its context starts.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)

import pytest
import rclpy
from fakes import Bench


@pytest.fixture
def ros():
    """A running rclpy."""
    rclpy.init()
    yield
    rclpy.try_shutdown()


@pytest.fixture
def bench(ros):
    """Makes nodes with fake inputs, and closes them."""
    made = []

    def make(**parameters):
        made.append(Bench(**parameters))
        return made[-1]

    yield make
    for each in made:
        each.close()
