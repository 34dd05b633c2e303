"""The node's log: a line for each event, at most one a second for what repeats."""

from __future__ import annotations

import threading
import time
import traceback
from math import inf

from rclpy.impl.rcutils_logger import RcutilsLogger

from placement_planner_ros.ros.node_words import in_node_words

PERIOD_S = 1.0
"""Between two lines of one kind, at least, and without a message of a kind after which the same
words are news again."""


class Log:
    """A node's log. Safe to use from several threads.

    Args:
        logger: where lines go.
    """

    def __init__(self, logger: RcutilsLogger) -> None:
        self._logger = logger
        self._lock = threading.Lock()
        self._kinds: dict[str, tuple[str, float, float]] = {}
        self._faults: set[object] = set()

    def event(self, words: str) -> None:
        """Something that a person wants to know each time."""
        self._logger.info(_on_one_line(words))

    def warn(self, words: str) -> None:
        """The same, of what may be a mistake."""
        self._logger.warning(_on_one_line(words))

    def failure(self, words: str) -> None:
        """The same, of what went wrong."""
        self._logger.error(_on_one_line(words))

    def repeats(self, kind: str, words: str) -> None:
        """Warn of what goes on by itself: other words once every `PERIOD_S`, the same ones after a
        pause of that length.

        Args:
            kind: one of few, as something of each is kept.
        """
        with self._lock:
            now = time.monotonic()
            # the words of this kind that were said last, when that was, and when any came last
            said, said_at, heard_at = self._kinds.get(kind, ("", -inf, -inf))
            # other words are held back for a period, the same ones until there was a pause
            news = now - said_at >= PERIOD_S and (words != said or now - heard_at >= PERIOD_S)
            self._kinds[kind] = (words, now, now) if news else (said, said_at, now)
        # outside of the lock, as whoever writes the line may take a while
        if news:
            self.warn(f"{kind}: {words}")

    def fault(self, kind: str, error: BaseException) -> None:
        """A fault of the node's own: its traceback is said the first time that it happens there."""
        # known again by where it was raised, as its words may be others each time
        where = type(error), str(traceback.extract_tb(error.__traceback__))
        with self._lock:
            known = where in self._faults
            self._faults.add(where)
        if known:
            self.repeats(kind, f"as before: {type(error).__name__}")
        else:
            trace = "".join(traceback.format_exception(error))
            self._logger.error(in_node_words(f"{kind}: {trace}"))


def _on_one_line(words: str) -> str:
    return in_node_words("; ".join(words.split("\n")))
