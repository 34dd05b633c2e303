"""SIGINT and SIGTERM as an event, from the first moment of a program on."""

from __future__ import annotations

import signal
import threading

_ASKED = threading.Event()


def catch_signals() -> threading.Event:
    """An event that SIGINT and SIGTERM set; they do nothing else from now on.

    To be called before anything else is imported: an interrupt that came in the midst of that
    would end in a traceback, or be swallowed by what catches everything as it is loaded. For nodes
    initialised without rclpy's own signal handlers, which shut the context down under a spinning
    executor. A terminal's Ctrl-C reaches a node twice, directly and through its parent; so the
    second one cannot cut the teardown short.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: _ASKED.set())
    return _ASKED
