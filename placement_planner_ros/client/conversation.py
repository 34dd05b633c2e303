"""Requests to the node, what became of them, and the runs that were left."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import Trigger

from placement_planner_ros.client.answer import Answer
from placement_planner_ros.client.errors import NO_ANSWER, NO_NODE, WITHDRAWN, PlacementError
from placement_planner_ros.client.subscriptions import Subscriptions
from placement_planner_ros.client.waiting import News, T

Value = bool | int | float | str | Sequence[bool] | Sequence[int] | Sequence[float] | Sequence[str]
"""What a parameter may be; NumPy's arrays and numbers are taken too."""

ANSWER_WITHIN = 10.0
"""Seconds within which an answer must come. The node's own take 0.1 s, stop's a second; where the
middleware has lost one it is sent again after some."""

_NOT_SENT = (rclpy_implementation.InvalidHandle, rclpy_implementation.RCLError)
"""Raised where ROS has been shut down."""

_SERVICES = {
    "start_with": SetParametersAtomically,
    "stop_with": SetParametersAtomically,
    "confirm_placed_with": SetParametersAtomically,
    "remove_placed": SetParametersAtomically,
    "clear_environment": Trigger,
}


class Conversation:
    """With one planning node. Safe to use from several threads.

    Args:
        planner: the planning node's name.

    Attributes:
        news: told of whatever is heard.
        hearing: what the node publishes.
        withdrawals: how often `withdraw` was called.
        closed: whether nothing can be asked any more.
    """

    def __init__(self, node: Node, planner: str) -> None:
        # answers must come through while another callback of the client waits
        group = ReentrantCallbackGroup()
        self.news = News()
        self.hearing = Subscriptions(node, planner, group, self.news)
        self.withdrawals = 0
        self._node = node
        self._clients = {
            name: node.create_client(kind, f"{planner}/{name}", callback_group=group)
            for name, kind in _SERVICES.items()
        }
        self.closed = False

    def close(self) -> None:
        """Neither call nor listen any more."""
        self.closed = True
        for client in self._clients.values():
            self._node.destroy_client(client)
        self.hearing.close()

    def withdraw(self) -> None:
        """Have `heed` raise in whoever has begun before."""
        self.withdrawals += 1
        self.news.tell()

    def heed(self, withdrawals: int, run: int | None = None) -> None:
        """Give up where the client was told to since there were so many withdrawals.

        Raises:
            PlacementError: it was, WITHDRAWN.
        """
        if self.withdrawals != withdrawals:
            raise PlacementError(WITHDRAWN, "the client was told to withdraw", run)

    # --- asking

    def offered(self, name: str) -> bool:
        """Whether somebody offers the service."""
        return bool(self._clients[name].service_is_ready())

    def repeat(
        self,
        name: str,
        parameters: Mapping[str, Value],
        passing: frozenset[str],
        end: float,
        withdrawals: int,
    ) -> Answer:
        """The answer, asked for again while it is a refusal of a code that passes.

        Raises:
            PlacementError: it was refused.
        """
        while True:
            self.heed(withdrawals)
            answer = self.ask(name, parameters, end)
            if answer.success:
                return answer
            if answer.code not in passing or time.monotonic() >= end:
                raise answer.error
            # until the node tells something else, or a moment has passed
            self.news.wait(self.news.count, end)

    def ask(self, name: str, parameters: Mapping[str, Value], end: float | None = None) -> Answer:
        """The answer to one request, whatever it is.

        Args:
            end: until when the node is waited for where it is not there.
        """
        if self.closed:
            raise PlacementError(WITHDRAWN, "this client is closed; make another one")
        # a node that has just been started may offer its services in a moment
        end = time.monotonic() + ANSWER_WITHIN if end is None else end
        if self.news.wait_until(lambda: self.offered(name) or None, end) is None:
            raise self.no_node(name)
        try:
            future = self._send(name, parameters)
        except _NOT_SENT as error:
            raise PlacementError(NO_NODE, f"ROS has been shut down here: {error}") from error
        # however the wait ends, a run that was begun must not go on unheard
        try:
            self.hear(lambda: future.done() or None, f"{name} was not answered")
        except BaseException:
            if name == "start_with":
                self._leave_begun(future)
            raise
        return Answer.of(future.result())

    def hear(self, what: Callable[[], T | None], lacking: str) -> T:
        """What is published beside an answer, once it has come.

        Raises:
            PlacementError: it has not, with the words of what is lacking.
        """
        heard = self.news.wait_until(what, time.monotonic() + ANSWER_WITHIN)
        if heard is None:
            raise PlacementError(NO_ANSWER, self.unheard(lacking))
        return heard

    def _send(self, name: str, parameters: Mapping[str, Value]) -> Future:
        request: Any = _SERVICES[name].Request()
        if parameters:
            request.parameters = [parameter_message(*pair) for pair in parameters.items()]
        future = self._clients[name].call_async(request)
        # the thread that spins takes the answer, and wakes whoever waits for it
        future.add_done_callback(self.news.tell)
        return future

    # --- runs that nobody waits for any more

    def leave(self, run: int) -> None:
        """Stop a run, and wait until that is done or will hardly be any more."""
        with suppress(*_NOT_SENT):  # then it ends at its time limit
            self._await_answer(self._send("stop_with", {"run": run}))

    def _leave_begun(self, started: Future) -> None:
        """Stop the run that a start has begun, once its answer comes, if it does."""

        def stop(started: Future) -> None:
            response = started.result()  # None where it was cancelled
            # the run of a refusal is somebody else's
            if response is not None and (answer := Answer.of(response)).success:
                with suppress(*_NOT_SENT):
                    self._send("stop_with", {"run": answer.run or 0})

        started.add_done_callback(stop)
        self._await_answer(started)

    def _await_answer(self, future: Future) -> None:
        self.news.wait_until(
            # where the node is gone nothing is left to stop
            lambda: future.done() or not self.offered("stop_with") or None,
            time.monotonic() + ANSWER_WITHIN,
        )

    # --- what is wrong

    def no_node(self, name: str, run: int | None = None) -> PlacementError:
        """Nobody offers that service."""
        full_name = self._node.resolve_service_name(self._clients[name].srv_name)
        words = (
            f"nobody offers {full_name}; is the node running, with this name and namespace, and "
            "the same ROS_DOMAIN_ID?"
        )
        return PlacementError(NO_NODE, words, run)

    def unheard(self, words: str) -> str:
        """The words, and what may be the reason."""
        if self._node.executor is None:
            return f"{words}: nobody spins {self._node.get_fully_qualified_name()}"
        return (
            f"{words} within {ANSWER_WITHIN:g} s; has the node died, or the machine too much to "
            "do? Where a callback of this client's node waits, a MultiThreadedExecutor must spin it"
        )


def parameter_message(name: str, value: Any) -> ParameterMessage:
    """A parameter of a request.

    Raises:
        TypeError: the value is no parameter's.
    """
    try:
        # NumPy makes one kind of numbers of several, as ROS has lists of one kind only
        return Parameter(name, value=np.asarray(value).tolist()).to_parameter_msg()
    except (TypeError, ValueError):
        raise TypeError(
            f"{name} = {value!r}: give a bool, a number, a string or a flat list of one of these"
        ) from None
