"""Giving up work of many steps, however deep in it.

Much of what is made before a search is remembered by its arguments, and nothing may be remembered
by who asked for it. So whoever may lose interest says so around the work, and not in arguments.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar


class StoppedError(Exception):
    """Nobody wants the result any more; the message says what was being done, as `making …`."""


_should_stop: ContextVar[Callable[[], bool] | None] = ContextVar("should_stop", default=None)


@contextmanager
def stoppable(should_stop: Callable[[], bool]) -> Iterator[None]:
    """Within it and in this thread, `step` raises `StoppedError` once `should_stop` says so."""
    token = _should_stop.set(should_stop)
    try:
        yield
    finally:
        _should_stop.reset(token)


def step(doing: str) -> None:
    """To be called before each step of long work.

    Args:
        doing: what comes next, in words, as `making the covers of link hand`.

    Raises:
        StoppedError: nobody wants the result any more.
    """
    should_stop = _should_stop.get()
    if should_stop is not None and should_stop():
        raise StoppedError(doing)
