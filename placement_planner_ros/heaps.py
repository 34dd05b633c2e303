"""The C library's heaps, of which a process has one for each thread, where that is glibc."""

from __future__ import annotations

import contextlib
import ctypes


def share_heaps() -> None:
    """Let all threads share one heap, where no second one has been begun yet.

    With a heap for each thread, of which most is never given back, calls and clouds took 944 MB in
    the first minute and 1,127 MB in the third. rclpy begins two as it is imported.

    Arrays of a megabyte and more lie outside of it, for the system to have back once they are gone:
    else they leave holes between what stays, 20 MB of them in a search. Smaller ones are given back
    once they come to as much at its end.
    """
    # M_ARENA_MAX, M_MMAP_THRESHOLD and M_TRIM_THRESHOLD of malloc.h
    for option, value in (-8, 1), (-3, 1_000_000), (-1, 1_000_000):
        _ask_glibc("mallopt", option, value)


def shrink_heaps() -> None:
    """Give the system back what was freed, which else stays with the process in pieces."""
    _ask_glibc("malloc_trim", 0)


def _ask_glibc(name: str, *numbers: int) -> None:
    """Call a function of the C library for which Python has no name, where that is glibc."""
    with contextlib.suppress(AttributeError, OSError, TypeError):
        getattr(ctypes.CDLL(None), name)(*numbers)
