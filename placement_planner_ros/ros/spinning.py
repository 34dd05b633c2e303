"""Running an executor until the process is asked to end, and ending it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from typing import Any, TypeVar

from rclpy.executors import Executor, ExternalShutdownException, ShutdownException, TimeoutException
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.task import Task

from placement_planner_ros.ros.call_priority import CallPriority
from placement_planner_ros.ros.patience import LOOK_S, REST_S

Made = TypeVar("Made")


class PooledExecutor(Executor):
    """Callbacks in threads, like rclpy's `MultiThreadedExecutor`, but with an end to wait for.

    In Jazzy that one neither waits for callbacks when it is shut down nor says whether any is in
    flight, so that they would fail over what is destroyed next. This one also rests between looks:
    each takes rclpy the better part of a millisecond of the interpreter, which the search waits
    for, and else there are two or three for each message, as it comes, as it is taken, as its
    callback ends. Where messages come faster than it looks, callbacks take those `waiting` too.

    Args:
        calls: hears of services while they are being answered.
    """

    def __init__(self, threads: int, calls: CallPriority | None = None) -> None:
        super().__init__()
        self._calls = calls or CallPriority()
        self._pool = ThreadPoolExecutor(threads)
        self._begun: list[Task] = []
        self._rested = 0.0

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Hand one callback that is ready to a thread; raise what one that has ended raised."""
        task: Task
        entity: object
        try:
            task, entity, _ = self.wait_for_ready_callbacks(
                timeout_sec=timeout_sec, condition=self._rest
            )
        except (ExternalShutdownException, ShutdownException, TimeoutException):
            pass
        else:
            if task not in self._begun:  # rclpy hands out a task until it has begun
                self._begun.append(task)
                self._pool.submit(self._work, task, isinstance(entity, Service))
                self._rested = time.monotonic() + REST_S
        # what a callback has raised is raised here, in the thread that spins
        for task in list(self._begun):
            if task.done():
                self._begun.remove(task)
                task.result()

    def _work(self, task: Task, is_call: bool) -> None:
        with self._calls.answering() if is_call else nullcontext():
            task()  # which sends the answer too

    def _rest(self) -> bool:
        """Asked by rclpy before each look; never a reason to look no more."""
        time.sleep(max(0.0, self._rested - time.monotonic()))
        return False

    def finish(self, patience: float) -> bool:
        """Begin no more callbacks; whether those in flight have ended within `patience` seconds.

        For an executor that nobody spins any more.
        """
        # the pool's own shutdown has no time limit, so a thread waits in its place
        waiting = threading.Thread(
            target=self._pool.shutdown, kwargs={"cancel_futures": True}, daemon=True
        )
        waiting.start()
        waiting.join(patience)
        if waiting.is_alive():
            return False
        for task in self._begun:
            task.cancel()  # those not begun, whose coroutines Python would else report
        return True


def survive(act: Callable[[], Made], on_error: Callable[[BaseException], None]) -> Made | None:
    """What that gives; None, once the error was told, where it raises anything at all.

    For the outermost frames of the node's threads, and around what others wrote: the only place
    where whatever is raised is caught.
    """
    try:
        return act()
    except BaseException as error:
        on_error(error)
        return None


def waiting(subscription: Subscription, most: int) -> Iterator[Any]:
    """Messages that have come since, oldest first; to be taken in the subscription's callback.

    Args:
        most: of them, as who sends without a rest would be listened to for ever.
    """
    # past the executor, which hands out one message at a time
    with subscription.handle:
        for _ in range(most):
            taken = subscription.handle.take_message(subscription.msg_type, False)
            if taken is None:
                return
            yield taken[0]


def spin_until(
    executor: Executor,
    asked: threading.Event,
    on_error: Callable[[BaseException], None] | None = None,
) -> None:
    """Spin until that event is set, or ROS is shut down.

    Args:
        on_error: told of what a callback raises; without it, that ends the spinning.
    """
    while executor.context.ok() and not asked.is_set():
        if on_error is None:
            executor.spin_once(timeout_sec=LOOK_S)
        else:
            # rclpy's own services raise here at a request they cannot read, and no client's
            # mistake may end a run of another.
            survive(lambda: executor.spin_once(timeout_sec=LOOK_S), on_error)
