"""The node that a client uses: the caller's, or one of its own."""

from __future__ import annotations

import atexit
import itertools
import os
import threading
from typing import Self

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from placement_planner_ros.client.session import Session
from placement_planner_ros.client.solution import Solution
from placement_planner_ros.client.status import Status, Validity
from placement_planner_ros.client.waiting import finish
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
        self._thread = threading.Thread(
            target=spin_until,
            args=(self._executor, self._asked, self._survive),
            name="placement client",
            daemon=True,
        )
        self._thread.start()

    def _survive(self, error: Exception) -> None:
        self.node.get_logger().error(f"a message was dropped: {type(error).__name__}: {error}")

    def close(self) -> None:
        """Spin no more."""
        self._asked.set()
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)


class Connection:
    """What blocking and asynchronous clients share.

    Args:
        node: one of the caller's, that somebody spins; without it the client has one of its own.
        planner: name of the planning node, in the namespace of `node` unless it begins with `/`.
    """

    def __init__(self, node: Node | None = None, planner: str = "placement_planner") -> None:
        self._own = OwnNode() if node is None else None
        used = self._own.node if self._own is not None else node
        assert used is not None
        self._conversation = Session(used, planner)
        self._closed = False
        if self._own is not None:  # whose thread, spinning as Python ends, would end it by a signal
            atexit.register(self.close)

    @property
    def status(self) -> Status | None:
        """The node's newest status; None before one has come."""
        return self._conversation.hearing.status

    def validity(self, solution: Solution) -> Validity:
        """Whether that solution can be carried out now. Look at it right before the robot moves.

        Not where a newer cloud cuts through its way, the robot has left the start, inputs have gone
        stale, robot or object were replaced, or another run has begun.
        """
        return self._conversation.hearing.validity(solution.run, solution.number)

    def improvement(self, run: int, number: int | None = None) -> Solution | None:
        """The best that the run has found so far, as far as it has come; for runs that `start`
        began.

        Args:
            number: that of an earlier one, counted from 1; it may have come and not be kept.
        """
        hearing = self._conversation.hearing
        return hearing.newest(run) if number is None else hearing.solution(run, number)

    def withdraw(self) -> None:
        """End every `place` that is under way, whose run is stopped: it raises `WITHDRAWN`.

        May be called from any thread, as by the cancel callback of an action server.
        """
        self._conversation.withdraw()

    def close(self) -> None:
        """Withdraw, and let go of the node. Where the client has a node of its own this is done as
        Python ends, too.
        """
        atexit.unregister(self.close)
        if self._closed:
            return
        self._closed = True
        self.withdraw()
        finish(self._conversation.settle(), self._conversation.news)
        self._conversation.close()
        if self._own is not None:
            self._own.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
