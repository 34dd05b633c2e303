"""Settings of the node's process: its interpreter and its C library."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

import rclpy
from rclpy.signals import SignalHandlerOptions

ARENAS = 2
"""Heaps of the C library: by default each thread gets its own, most of it never given back."""
SWITCH_INTERVAL = 3e-5
"""Seconds after which a thread yields the interpreter to one that waits. The search leaves it for
every kernel, so it waits this long some ten thousand times a second while the executor is at work:
with a millisecond the node did half as many samples."""


def begin_ros(arguments: Sequence[str] | None) -> None:
    """Initialise rclpy, without signal handlers of its own.

    Args:
        arguments: of the command line, which None stands for.
    """
    given = sys.argv if arguments is None else arguments
    signals = SignalHandlerOptions.NO
    rclpy.init(args=[*given, *log_arguments()], signal_handler_options=signals)


def log_arguments() -> list[str]:
    """What to add to the command line where there is no room for ROS's log files.

    ROS would not start there; with this its lines go to the console and to `/rosout` only.
    """
    try:
        _require_log_folder()
    except OSError as error:
        print(f"no log file is written: {error}; set ROS_LOG_DIR", file=sys.stderr, flush=True)
        return ["--ros-args", "--disable-external-lib-logs"]
    return []


def _require_log_folder() -> None:
    """Make the folder that ROS writes its log to.

    Raises:
        OSError: there is none, or nothing can be written there.
    """
    folder = os.environ.get("ROS_LOG_DIR")
    if not folder:
        home = os.environ.get("HOME")
        ros = os.environ.get("ROS_HOME") or (home and f"{home}/.ros")
        if not ros:
            raise OSError("there is no home folder")
        folder = f"{ros}/log"
    path = Path(os.path.expanduser(folder))
    path.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=path) as stream:
        stream.write(b"\n")


def share_among_threads() -> None:
    """Let threads begun from now on share heaps, where the C library is glibc, and take turns."""
    m_arena_max = -8
    with contextlib.suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).mallopt(m_arena_max, ARENAS)
    sys.setswitchinterval(SWITCH_INTERVAL)


def give_memory_back() -> None:
    """Return what is free in the heaps, where the C library is glibc.

    What reading a large mesh took for a while stayed with the process: after three meshes of
    200,000 triangles some 300 MB.
    """
    with contextlib.suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


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
