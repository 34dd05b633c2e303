"""What the node's process needs of its interpreter and its C library."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import sys
from typing import NoReturn

ARENAS = 2
"""Heaps of the C library: by default each thread gets its own, most of it never given back."""
SWITCH_INTERVAL = 3e-5
"""Seconds after which a thread yields the interpreter to one that waits. The search leaves it for
every kernel, so it waits this long some ten thousand times a second while the executor is at work:
with a millisecond the node did half as many samples."""


def share_among_threads() -> None:
    """Let threads begun from now on share heaps, where the C library is glibc, and take turns."""
    m_arena_max = -8
    with contextlib.suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).mallopt(m_arena_max, ARENAS)
    sys.setswitchinterval(SWITCH_INTERVAL)


def spare_what_is_loaded() -> None:
    """Have no garbage collection look at what is loaded by now.

    A full one would take 0.1 s, in which no other thread runs: stop would have to wait for it.
    """
    gc.collect()
    gc.freeze()


def leave_at_once() -> NoReturn:
    """End the process under threads that are still at work.

    Ending the interpreter under a thread that is in compiled code would abort the process.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
