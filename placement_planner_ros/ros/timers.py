"""Timers that go on whatever time it is said to be."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node


def every(node: Node, seconds: float, act: Callable[[], None]) -> None:
    """Do that again and again, by a steady clock, one at a time.

    A node's own clock stands still with `use_sim_time` while nobody publishes /clock.
    """
    steady = Clock(clock_type=ClockType.STEADY_TIME)
    node.create_timer(seconds, act, callback_group=MutuallyExclusiveCallbackGroup(), clock=steady)
