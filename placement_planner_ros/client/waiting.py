"""Waiting for what the node says."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")

LONGEST = 0.5
"""Seconds after which who waits looks again in any case, as a node that is gone tells nobody."""


class News:
    """Wakes who waits once something was heard. Safe to use from several threads."""

    def __init__(self) -> None:
        self._heard = threading.Condition()
        self.count = 0

    def tell(self, *_: object) -> None:
        """Something was heard."""
        with self._heard:
            self.count += 1
            self._heard.notify_all()

    def wait(self, count: int, until: float) -> None:
        """Until `count` is another, or that time of `time.monotonic` has come."""
        with self._heard:
            seconds = max(0.0, min(until - time.monotonic(), LONGEST))
            self._heard.wait_for(lambda: self.count != count, seconds)

    def wait_until(self, what: Callable[[], T | None], end: float) -> T | None:
        """What is there, once it is; None where that time has come before."""
        while True:
            # before the look, so that nothing heard during it is missed
            count = self.count
            if (found := what()) is not None or time.monotonic() >= end:
                return found
            self.wait(count, end)
