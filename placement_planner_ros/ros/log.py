"""The node's log: a line for each event, at most one a second for what repeats."""

from __future__ import annotations

import threading
import time
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from placement_planner_ros.core.errors import sayable

PERIOD = 1.0
"""Least seconds between two lines of one kind."""

PAUSE = 60.0
"""Seconds without a message of a kind after which the same words are news again."""

LONGEST = 4000
"""Characters of a line, tracebacks aside."""

KNOWN_FAULTS = 32
"""Faults, the newest ones, whose traceback is not said again."""


class Logger(Protocol):
    """What rclpy's loggers are."""

    def info(self, message: str) -> bool: ...
    def warning(self, message: str) -> bool: ...
    def error(self, message: str) -> bool: ...


@dataclass(frozen=True, slots=True)
class _Line:
    """Something to say.

    Attributes:
        what: tells it from others; of a fault, where it happened.
        words: the line.
        rest: seconds for which the same is no news, from when it was heard of last.
    """

    what: object
    words: str
    rest: float
    is_fault: bool = False
    is_news: bool = False


@dataclass(slots=True)
class _Kind:
    """Of one kind, what was said last and what was left out since."""

    said: object = None
    said_at: float = float("-inf")
    heard_at: float = float("-inf")
    waiting: _Line | None = None
    left_out: int = field(default=0)


class Log:
    """A node's log. Safe to use from several threads; keeps one line of each kind.

    What repeats is said at most once every `PERIOD`; the next line tells how many were left out,
    and the newest of them is said by `flush`.

    Args:
        logger: where lines go.
        clock: seconds of a steady clock.
    """

    def __init__(self, logger: Logger, clock: Callable[[], float] = time.monotonic) -> None:
        self._logger = logger
        self._clock = clock
        self._lock = threading.Lock()
        self._kinds: dict[str, _Kind] = {}
        self._faults: deque[object] = deque(maxlen=KNOWN_FAULTS)

    def event(self, words: str) -> None:
        """Something that a person wants to know each time."""
        self._logger.info(sayable(_short(words)))

    def warn(self, words: str) -> None:
        """The same, of what may be a mistake."""
        self._logger.warning(sayable(_short(words)))

    def failure(self, words: str) -> None:
        """The same, of what went wrong."""
        self._logger.error(sayable(_short(words)))

    def news(self, kind: str, words: str) -> None:
        """An event that somebody else brings about, as often as they like: told each time, but for
        those in quick succession."""
        self._offer(kind, _Line(words, _short(words), 0.0, is_news=True))

    def refusal(self, kind: str, words: str) -> None:
        """A person's request was refused: told each time, but for those in quick succession."""
        self._offer(kind, _Line(words, _short(f"{kind}: {words}"), 0.0))

    def repeats(self, kind: str, words: str) -> None:
        """Something that goes on by itself; the same words are said once until it has paused.

        Args:
            kind: one of few, as something of each is kept.
        """
        self._offer(kind, _Line(words, _short(f"{kind}: {words}"), PAUSE))

    def fault(self, kind: str, error: BaseException) -> None:
        """A fault of the node's own: its traceback is said the first time that it happens there."""
        where = tuple(_frames(error))
        with self._lock:
            known = where in self._faults
        if known:
            words = _short(f"{kind}, as before: {type(error).__name__}: {error}")
            self._offer(kind, _Line(where, words, PAUSE))
        else:
            trace = "".join(traceback.format_exception(error))
            self._offer(kind, _Line(where, f"{kind}: {trace}", 0.0, is_fault=True))

    def flush(self) -> None:
        """Say what waits and is due; to be called about every `PERIOD`."""
        with self._lock:
            due = [
                (name, kind.waiting)
                for name, kind in self._kinds.items()
                if kind.waiting is not None and self._clock() - kind.said_at >= PERIOD
            ]
            lines = [self._taken(self._kinds[name], line) for name, line in due]
        for line, words in lines:
            self._write(line, words)

    def _offer(self, name: str, line: _Line) -> None:
        with self._lock:
            kind, now = self._kinds.setdefault(name, _Kind()), self._clock()
            early = now - kind.said_at < PERIOD
            known = line.what == kind.said and (early or now - kind.heard_at < line.rest)
            kind.heard_at = now
            kind.left_out += 1
            if known:
                return
            kind.waiting = line
            if early:
                return
            line, words = self._taken(kind, line)
        self._write(line, words)

    def _taken(self, kind: _Kind, line: _Line) -> tuple[_Line, str]:
        """That line, about to be said, and its words; lock held."""
        others = kind.left_out - 1
        kind.said, kind.said_at = line.what, self._clock()
        kind.waiting, kind.left_out = None, 0
        if line.is_fault and line.what not in self._faults:
            self._faults.append(line.what)
        return line, f"{line.words} ({others} more were left out)" if others > 0 else line.words

    def _write(self, line: _Line, words: str) -> None:
        words = sayable(words)
        # rclpy wants each level at a place of its own.
        if line.is_fault:
            self._logger.error(words)
        elif line.is_news:
            self._logger.info(words)
        else:
            self._logger.warning(words)


def _frames(error: BaseException) -> list[object]:
    """Where an error comes from, whatever it says."""
    cause = error.__cause__
    inner = [] if cause is None else _frames(cause)
    trace = traceback.walk_tb(error.__traceback__)
    return [type(error), *((frame.f_code, line) for frame, line in trace), *inner]


def _short(words: str) -> str:
    words = "; ".join(words.split("\n"))
    return words if len(words) <= LONGEST else f"{words[: LONGEST - 3]}..."
