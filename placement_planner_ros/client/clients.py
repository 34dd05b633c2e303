"""The clients, blocking and for asyncio, and the node that they use."""

from __future__ import annotations

import asyncio
import atexit
import itertools
import os
import threading
from collections.abc import Mapping, Sequence
from typing import Self

import rclpy
from geometry_msgs.msg import Pose
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from placement_planner_ros.client.calls import Value
from placement_planner_ros.client.session import Enough, Session
from placement_planner_ros.client.solution import Solution
from placement_planner_ros.client.status import Status, Validity
from placement_planner_ros.client.waiting import Steps, T, finish, finish_async
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


class PlacementClient(Connection):
    """Plans placements with the node `placement_planner`, and waits for the results.

    Safe to use from several threads. In a callback of `node` its methods may only be called where a
    `MultiThreadedExecutor` spins it and the callback is in a group of its own.
    """

    def wait_until_ready(self, seconds: float) -> Status:
        """The node's status, once it could begin a run at once: nothing is compiled or read any
        more, clouds and joint states arrive.

        Raises:
            PlacementError: not within that time: NO_NODE, or NOT_READY with what is lacking.
        """
        return self._finish(self._conversation.until_ready(seconds))

    def place(
        self,
        parameters: Mapping[str, Value] | None = None,
        deadline: float = 30.0,
        until: Enough | None = None,
    ) -> Solution:
        """Where and how to put down what the robot holds: the best found by the deadline.

        Refusals that pass by themselves are repeated until the deadline: NOT_READY while something
        is read, ROBOT_MOVING right after a motion, STOPPING while the run before ends. Where the
        robot leaves its start, planning begins again from where it then rests. However this is
        left, by an exception too, the run is stopped.

        Args:
            parameters: the node's, by name, for this run only.
            deadline: seconds from now on; `math.inf` for none. Then follows what stopping takes, a
                second at most.
            until: told of each improvement in this thread, as far as it comes in time; where it
                returns true the search ends. The solution that is returned may be a better one that
                came meanwhile.

        Returns:
            The run's best solution. It may not be valid any more: ask `validity` before moving.

        Raises:
            PlacementError: there is none, with the node's code and words, such as NO_CLOUD and
                BAD_VOLUME of a refused start, NO_SOLUTION and OUT_OF_REACH of a search.
            ValueError: the deadline is no time to come.
        """
        return self._finish(self._conversation.place(parameters or {}, deadline, until))

    def start(self, parameters: Mapping[str, Value] | None = None, patience: float = 0.0) -> int:
        """Begin a run (`~/start_with`) and leave it running; its number.

        Args:
            parameters: for this run only; its `time_limit` is the node's unless it is among them.
            patience: seconds for which refusals that pass are repeated, as by `place`.

        Raises:
            PlacementError: it was refused.
        """
        return self._finish(self._conversation.start(parameters or {}, patience))

    def stop(self, run: int) -> Solution:
        """End that run (`~/stop_with`), if it has not ended yet; the best it has found.

        Raises:
            PlacementError: it has found nothing, or the robot has left its start, or the node's
                last run is another (WRONG_RUN).
        """
        return self._finish(self._conversation.stop(run))

    def confirm_placed(
        self, solution: Solution | None = None, pose: Pose | Sequence[float] | None = None
    ) -> int:
        """The object stands there now: it becomes obstacle and support. The run's number.

        Args:
            solution: which one of the last run was carried out (`~/confirm_placed_with`); without
                it the best of the last run (`~/confirm_placed`).
            pose: where the object was measured, in the planning frame: m, or x y z qx qy qz qw.

        Raises:
            PlacementError: it was refused.
        """
        return self._finish(self._conversation.confirm(solution, pose))

    def remove_placed(self, placed: Solution | int) -> None:
        """The object that this solution, or run, placed has been taken away (`~/remove_placed`).

        Raises:
            PlacementError: nothing of that run stands (WRONG_RUN).
        """
        self._finish(self._conversation.remove(placed))

    def clear_environment(self) -> None:
        """Forget accumulated points and all objects that were placed (`~/clear_environment`).

        Raises:
            PlacementError: it was refused.
        """
        self._finish(self._conversation.clear())

    def _finish(self, steps: Steps[T]) -> T:
        return finish(steps, self._conversation.news)


class AsyncPlacementClient(Connection):
    """`PlacementClient` for asyncio: the same methods, to be awaited. Cancelling a task that awaits
    `place` stops the run. A node of the caller's must be spun in a thread.
    """

    async def wait_until_ready(self, seconds: float) -> Status:
        """See `PlacementClient.wait_until_ready`."""
        return await self._finish(self._conversation.until_ready(seconds))

    async def place(
        self,
        parameters: Mapping[str, Value] | None = None,
        deadline: float = 30.0,
        until: Enough | None = None,
    ) -> Solution:
        """See `PlacementClient.place`; `until` is called in the loop."""
        return await self._finish(self._conversation.place(parameters or {}, deadline, until))

    async def start(
        self, parameters: Mapping[str, Value] | None = None, patience: float = 0.0
    ) -> int:
        """See `PlacementClient.start`."""
        return await self._finish(self._conversation.start(parameters or {}, patience))

    async def stop(self, run: int) -> Solution:
        """See `PlacementClient.stop`."""
        return await self._finish(self._conversation.stop(run))

    async def confirm_placed(
        self, solution: Solution | None = None, pose: Pose | Sequence[float] | None = None
    ) -> int:
        """See `PlacementClient.confirm_placed`."""
        return await self._finish(self._conversation.confirm(solution, pose))

    async def remove_placed(self, placed: Solution | int) -> None:
        """See `PlacementClient.remove_placed`."""
        await self._finish(self._conversation.remove(placed))

    async def clear_environment(self) -> None:
        """See `PlacementClient.clear_environment`."""
        await self._finish(self._conversation.clear())

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await asyncio.to_thread(self.close)

    async def _finish(self, steps: Steps[T]) -> T:
        return await finish_async(steps, self._conversation.news)
