"""SIGINT and SIGTERM from the first moment of a program on: the end of loading, then an event."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Iterator

_ASKED = threading.Event()
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextlib.contextmanager
def ended_while_loading(code: int | None = None) -> Iterator[None]:
    """Within it both end the process at once and without a word; nothing has been begun yet.

    An interrupt in the midst of an import would end in a traceback, or be swallowed by what catches
    everything as it is loaded; and to load all takes longer on a busy machine than a launch waits
    from one signal to the next.

    Args:
        code: that the process ends with; what shells expect of a signal where it is None.
    """
    before = [
        signal.signal(each, lambda number, _: os._exit(128 + number if code is None else code))
        for each in _SIGNALS
    ]
    try:
        yield
    finally:
        for each, handler in zip(_SIGNALS, before, strict=True):
            signal.signal(each, handler)


def catch_signals() -> threading.Event:
    """An event that SIGINT and SIGTERM set; they do nothing else from now on.

    For nodes initialised without rclpy's own signal handlers, which shut the context down under a
    spinning executor. A terminal's Ctrl-C reaches a node twice, directly and through its parent; so
    the second one cannot cut the teardown short.
    """

    def ask(*_: object) -> None:
        # By a thread: a signal may come while the main one is within the event's lock, in `wait`.
        if not _ASKED.is_set():
            threading.Thread(target=_ASKED.set).start()

    for number in _SIGNALS:
        signal.signal(number, ask)
    return _ASKED
