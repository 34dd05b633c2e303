"""Settings of the node's process: its interpreter and its C library."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

import rclpy
from rclpy.signals import SignalHandlerOptions


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


def share_heaps() -> None:
    """Let threads begun from now on share two heaps, where the C library is glibc.

    With a heap for each thread, of which most is never given back, calls and clouds took 944 MB in
    the first minute and 1,127 MB in the third.
    """
    m_arena_max = -8
    with contextlib.suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).mallopt(m_arena_max, 2)


def give_memory_back() -> None:
    """Return what is free in the heaps, where the C library is glibc.

    After an object of 200,000 triangles was read, the node kept 19 % more memory without (823 MB
    beside 694).
    """
    with contextlib.suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


def leave_at_once() -> NoReturn:
    """End the process under threads that are still at work.

    Ending the interpreter under a thread that is in compiled code would abort the process.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
