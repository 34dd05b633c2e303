"""How the node's process begins and ends."""

from __future__ import annotations

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


def leave_at_once() -> NoReturn:
    """End the process under threads that are still at work.

    Ending the interpreter under a thread that is in compiled code would abort the process.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
