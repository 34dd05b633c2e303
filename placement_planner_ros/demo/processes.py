"""The real node and the page as processes of their own, and why they ended."""

from __future__ import annotations

import contextlib
import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

from placement_planner_ros.__main__ import VIEW_REMEDY
from placement_planner_ros.core.child_process import child_environment

_HOST = "127.0.0.1"
_NODE = [sys.executable, "-m", "placement_planner_ros", "placement_planner"]
"""The program of the node."""


class DemoError(Exception):
    """The demonstration did not get through.

    Args:
        what: what happened.
        remedy: what to try.
    """

    def __init__(self, what: str, remedy: str) -> None:
        super().__init__(f"{what}\n  what to try: {remedy}")


def node_arguments(file: Path, parameters: Mapping[str, object]) -> list[str]:
    """The node's arguments, without what only the demonstration needs."""
    given = [f"{name}:={json.dumps(value)}" for name, value in parameters.items()]
    return ["--params-file", str(file), *(word for each in given for word in ("-p", each))]


@contextmanager
def node_running(namespace: str, arguments: list[str], log: Path) -> Iterator[Callable[[], None]]:
    """The node, meanwhile; what raises a `DemoError` where it has ended.

    Args:
        namespace: that it is in.
        arguments: those of `node_arguments`.
        log: file that all it says goes to.
    """
    command = [*_NODE, "--ros-args", "-r", f"__ns:={namespace}", *arguments]
    with _running(command, log) as process:
        yield lambda: _require_alive(process, log)


def _require_alive(process: subprocess.Popen[bytes], log: Path) -> None:
    code = process.poll()
    if code is None:
        return
    # its last words, mostly the reason
    said = log.read_text(errors="replace").splitlines()[-15:] or ["(it is empty)"]
    remedy = f"read all of {log}; docs/troubleshooting.md is keyed by its messages"
    if code == -signal.SIGKILL:
        remedy = "something killed it, mostly for want of memory; end other programs and try again"
    raise DemoError(
        "\n    ".join([f"the node ended with code {code}; its log ends:", *said]), remedy
    )


@contextmanager
def page_served(namespace: str, log: Path) -> Iterator[str]:
    """The page of the node in that namespace, meanwhile; its address.

    Raises:
        DemoError: it cannot be served.
    """
    if find_spec("viser") is None:
        raise DemoError("viser is missing, which draws the page", VIEW_REMEDY)
    # a port that is free
    with socket.create_server((_HOST, 0)) as probe:
        port = int(probe.getsockname()[1])
    command = [sys.executable, "-m", "placement_planner_ros", "placement_view"]
    command += ["--host", _HOST, "--port", str(port), "--ros-args", "-r", f"__ns:={namespace}"]
    with _running(command, log) as process:
        while not _serves(port):
            if process.poll() is not None:
                raise DemoError("the page is not served", f"read {log}, or do without --view")
            time.sleep(0.1)
        yield f"http://{_HOST}:{port}"


def _serves(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex((_HOST, port)) == 0


@contextmanager
def _running(command: list[str], log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A process that writes all it says to the log, and that Ctrl-C in the terminal spares."""
    # in a session of its own Ctrl-C does not reach it
    with log.open("wb") as stream:
        process = subprocess.Popen(
            command,
            stdout=stream,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env=child_environment(),
        )
    try:
        yield process
    finally:
        # as Ctrl-C would, so that the program ends its work in order
        process.send_signal(signal.SIGINT)
        try:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(10.0)
        finally:  # interrupted once more, too: it must not be left running
            process.kill()
            process.wait()
