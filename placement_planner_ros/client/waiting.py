"""Waiting for what the node says, in a thread or in asyncio.

What a client does is written once, as steps: a generator that yields whenever it has to wait. It
yields until when, and goes on once something was heard or that time has come.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Generator
from contextlib import closing
from typing import TypeVar

T = TypeVar("T")
Steps = Generator[float, None, T]
"""Yields the time of `time.monotonic` until which it waits at most; returns its result."""

LONGEST = 0.5
"""Seconds after which steps go on in any case, as a node that is gone tells nobody."""


class News:
    """Wakes who waits once something was heard. Safe to use from several threads."""

    def __init__(self) -> None:
        self._heard = threading.Condition()
        self._count = 0

    @property
    def count(self) -> int:
        """How often something was heard."""
        return self._count

    def tell(self, *_: object) -> None:
        """Something was heard."""
        with self._heard:
            self._count += 1
            self._heard.notify_all()

    def wait(self, count: int, until: float) -> None:
        """Until `count` is another, or that time has come."""
        with self._heard:
            seconds = max(0.0, min(until - time.monotonic(), LONGEST))
            self._heard.wait_for(lambda: self._count != count, seconds)


def wait_until(what: Callable[[], T | None], end: float) -> Steps[T | None]:
    """Steps until something is there, which they give, or that time has come: None."""
    while (found := what()) is None and time.monotonic() < end:
        yield end
    return found


def finish(steps: Steps[T], news: News) -> T:
    """Take steps to their end, in this thread. What interrupts it is raised in the steps."""
    interruption: BaseException | None = None
    with closing(steps):
        while True:
            count = news.count
            try:
                until = next(steps) if interruption is None else steps.throw(interruption)
            except StopIteration as end:
                result: T = end.value
                return result
            interruption = None
            try:
                news.wait(count, until)
            except BaseException as raised:
                interruption = raised


async def finish_async(steps: Steps[T], news: News) -> T:
    """The same in asyncio.

    Raises:
        RuntimeError: no loop of asyncio runs here.
    """
    interruption: BaseException | None = None
    with closing(steps):
        _require_asyncio()
        while True:
            count = news.count
            try:
                until = next(steps) if interruption is None else steps.throw(interruption)
            except StopIteration as end:
                result: T = end.value
                return result
            interruption = None
            try:
                await asyncio.to_thread(news.wait, count, until)
            except BaseException as raised:
                interruption = raised


def _require_asyncio() -> None:
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        raise RuntimeError(
            "AsyncPlacementClient is for asyncio; in a callback of rclpy use PlacementClient, with "
            "a MultiThreadedExecutor and the callback in a group of its own"
        ) from None
