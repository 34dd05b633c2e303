"""Work that can wait lets the answer to a call go first."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from placement_planner_ros.ros.patience import LOOK_S


class CallPriority:
    """Services that are being answered. Safe to use from several threads.

    A call is short, but what clouds bring takes cores and interpreter all the while: beside three
    of them, start took four times as long.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._open = 0
        self._none = threading.Event()
        self._none.set()

    @contextmanager
    def answering(self) -> Iterator[None]:
        """Within it a call is being answered."""
        with self._lock:
            self._open += 1
            self._none.clear()
        try:
            yield
        finally:
            with self._lock:
                self._open -= 1
                # the last answer given lets waiting work go on
                if not self._open:
                    self._none.set()

    def give_way(self) -> None:
        """Wait until none is, `LOOK_S` at most, so that a call that takes long holds nothing up."""
        self._none.wait(LOOK_S)
