"""One line that says how far something is, for people who wait."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable

PAUSE = 10.0
"""Seconds between lines where the output is no terminal."""


class ProgressLine:
    """Written over in a terminal; elsewhere a line now and then.

    Args:
        pause: seconds between lines where the output is no terminal.
    """

    def __init__(self, pause: float = PAUSE, clock: Callable[[], float] = time.monotonic) -> None:
        self._terminal = sys.stdout.isatty()
        self._pause, self._clock = pause, clock
        self._said_at = -float("inf")
        self._open = False

    def show(self, text: str, always: bool = False) -> None:
        """Show it, where it is no terminal only after the pause or `always`."""
        if self._terminal:
            width = shutil.get_terminal_size().columns - 1
            print(f"\r\033[K{text[:width]}", end="", flush=True)
            self._open = True
        elif always or self._clock() >= self._said_at + self._pause:
            self._said_at = self._clock()
            print(text, flush=True)

    def say(self, text: str) -> None:
        """Print a line that stays."""
        self.clear()
        print(text, flush=True)
        self._said_at = self._clock()

    def clear(self) -> None:
        """Take the line away, so that others can be printed."""
        if self._open:
            print("\r\033[K", end="", flush=True)
            self._open = False

    def end(self) -> None:
        """Leave the line as it is."""
        if self._open:
            print(flush=True)
            self._open = False
