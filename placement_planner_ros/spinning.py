"""Running an executor until the process is asked to end."""

from __future__ import annotations

import signal
import threading

from rclpy.executors import Executor

PERIOD = 0.1
"""Seconds within which a signal is noticed."""


def spin_until_signalled(executor: Executor) -> None:
    """Spin until SIGINT or SIGTERM; further ones change nothing, so that teardown is not cut short.

    For nodes initialised without rclpy's own signal handlers, which shut the context down under a
    spinning executor. A terminal's Ctrl-C reaches a node twice, directly and through its parent.
    """
    asked = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: asked.set())
    while not asked.is_set():
        executor.spin_once(timeout_sec=PERIOD)
