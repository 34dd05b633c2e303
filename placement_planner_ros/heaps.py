"""The C library's heaps, of which a process has one for each thread, where that is glibc."""

from __future__ import annotations

import contextlib
import ctypes


def share_heaps() -> None:
    """Let all threads share one heap, where no second one has been begun yet.

    With a heap for each thread, of which most is never given back, calls and clouds took 944 MB in
    the first minute and 1,127 MB in the third. rclpy begins two as it is imported.
    """
    _ask_glibc("mallopt", -8, 1)  # M_ARENA_MAX of malloc.h


def shrink_heaps() -> None:
    """Give the system back what was freed, which else stays with the process in pieces."""
    _ask_glibc("malloc_trim", 0)


def _ask_glibc(name: str, *numbers: int) -> None:
    """Call a function of the C library for which Python has no name, where that is glibc."""
    with contextlib.suppress(AttributeError, OSError, TypeError):
        getattr(ctypes.CDLL(None), name)(*numbers)
