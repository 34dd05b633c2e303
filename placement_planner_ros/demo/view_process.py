"""The page in the browser beside the demonstration, as a process of its own."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

from placement_planner_ros.__main__ import VIEW_REMEDY
from placement_planner_ros.demo.errors import DemoError
from placement_planner_ros.demo.node_process import end_process, start_process
from placement_planner_ros.view.options import PORT

_HOST = "127.0.0.1"
_SERVES_WITHIN = 60.0
"""Seconds within which it serves."""


@contextmanager
def page_served(namespace: str, log: Path) -> Iterator[str]:
    """The page of the node in that namespace, meanwhile; its address.

    Raises:
        DemoError: it cannot be served.
    """
    if find_spec("viser") is None:
        raise DemoError("viser is missing, which draws the page", VIEW_REMEDY)
    port = _free_port()
    command = [sys.executable, "-m", "placement_planner_ros", "placement_view"]
    command += ["--host", _HOST, "--port", str(port), "--ros-args", "-r", f"__ns:={namespace}"]
    process = start_process(command, log)
    try:
        _await_page(process, port, log)
        yield f"http://{_HOST}:{port}"
    finally:
        end_process(process)


def wait_until_interrupted() -> None:
    """Return at Ctrl-C."""
    with contextlib.suppress(KeyboardInterrupt):
        while True:
            time.sleep(1.0)


def _free_port() -> int:
    """The usual one, or any where that is taken."""
    for port in (PORT, 0):
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((_HOST, port))
            return int(probe.getsockname()[1])
    return PORT


def _await_page(process: subprocess.Popen[bytes], port: int, log: Path) -> None:
    end = time.monotonic() + _SERVES_WITHIN
    while True:
        with contextlib.suppress(OSError), socket.create_connection((_HOST, port), 1.0):
            return
        if process.poll() is not None or time.monotonic() > end:
            raise DemoError("the page is not served", f"read {log}, or do without --view")
        time.sleep(0.1)
