"""Settings of the node's process: its interpreter and its C library."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

import rclpy
from rclpy.signals import SignalHandlerOptions


def begin_ros(arguments: Sequence[str] | None) -> None:
    """Initialise rclpy, without signal handlers of its own.

    Args:
        arguments: of the command line, which None stands for.
    """
    given = None if arguments is None else list(arguments)
    rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO)


def share_heaps() -> None:
    """Let threads begun from now on share two heaps.

    With a heap for each thread, of which most is never given back, calls and clouds took 944 MB in
    the first minute and 1,127 MB in the third.
    """
    _ask_glibc("mallopt", -8, 2)  # M_ARENA_MAX of malloc.h


def shrink_heaps() -> None:
    """Give the system back what was freed, which else stays with the process in pieces."""
    _ask_glibc("malloc_trim", 0)


def _ask_glibc(name: str, *numbers: int) -> None:
    """Call a function of the C library for which Python has no name, where that is glibc."""
    with contextlib.suppress(AttributeError, OSError, TypeError):
        getattr(ctypes.CDLL(None), name)(*numbers)


def leave_at_once() -> NoReturn:
    """End the process under threads that are still at work.

    Ending the interpreter under a thread that is in compiled code would abort the process.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
