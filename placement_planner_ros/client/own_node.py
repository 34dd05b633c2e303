"""The node of a client that was given none."""

from __future__ import annotations

import itertools
import os
import threading

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from placement_planner_ros.ros.spinning import spin_until

_NUMBERS = itertools.count()
"""Of the clients in this process, whose nodes must not have the same name."""


class OwnNode:
    """A node in a context of its own, which a thread of its own spins.

    So it neither needs `rclpy.init` nor ends with it: after Ctrl-C there is still time to stop a
    run.
    """

    def __init__(self) -> None:
        self._context = Context()
        rclpy.init(context=self._context)
        name = f"placement_client_{os.getpid()}_{next(_NUMBERS)}"
        self.node = Node(name, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._asked = threading.Event()
        told = (self._executor, self._asked, self._survive)
        self._thread = threading.Thread(
            target=spin_until, args=told, name="placement client", daemon=True
        )
        self._thread.start()

    def _survive(self, error: Exception) -> None:
        if self._context.ok():  # else a signal has ended it, and no message was dropped
            self.node.get_logger().error(f"a message was dropped: {type(error).__name__}: {error}")

    def close(self) -> None:
        """Spin no more."""
        # in this order: nobody may spin a node that is being destroyed
        self._asked.set()
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()  # a signal may have done so
