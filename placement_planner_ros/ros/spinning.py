"""Running an executor until the process is asked to end, and ending it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable

from rclpy.executors import Executor, MultiThreadedExecutor

PERIOD = 0.1
"""Seconds within which a signal is noticed."""


def catch_signals() -> threading.Event:
    """An event that SIGINT and SIGTERM set; they do nothing else from now on.

    For nodes initialised without rclpy's own signal handlers, which shut the context down under a
    spinning executor. A terminal's Ctrl-C reaches a node twice, directly and through its parent;
    so the second one cannot cut the teardown short.
    """
    asked = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: asked.set())
    return asked


def spin_until(
    executor: Executor,
    asked: threading.Event,
    on_error: Callable[[Exception], None] | None = None,
) -> None:
    """Spin until that event is set.

    Args:
        on_error: told of what a callback raises; without it, that ends the spinning.
    """
    while not asked.is_set():
        try:
            executor.spin_once(timeout_sec=PERIOD)
        except Exception as error:
            # The node's outermost frame. rclpy's own services raise here at a request they cannot
            # read, and no client's mistake may end a run of another.
            if on_error is None:
                raise
            on_error(error)


def callbacks_end(executor: MultiThreadedExecutor, patience: float) -> bool:
    """Begin no more callbacks; whether those in flight have ended within `patience` seconds.

    For an executor that nobody spins any more. Its own shutdown does not wait for callbacks in
    Jazzy, so that they would fail over what is destroyed next ("exception was never retrieved").
    """
    waiting = threading.Thread(
        target=executor._executor.shutdown, kwargs={"cancel_futures": True}, daemon=True
    )
    waiting.start()
    waiting.join(patience)
    if waiting.is_alive():
        return False
    for task in executor._futures:
        task.cancel()  # those not begun, whose coroutines Python would else report as never awaited
    return True
