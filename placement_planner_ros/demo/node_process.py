"""The real node as a process of its own, and why it ended."""

from __future__ import annotations

import contextlib
import os
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

from placement_planner_ros.demo.errors import DemoError

_ENDS_WITHIN = 10.0
"""Seconds within which a process that is interrupted ends; after that it is killed."""
_TAIL = 15
"""Lines of its log that are shown where it has died."""


def node_arguments(file: Path, parameters: Mapping[str, object]) -> list[str]:
    """The node's arguments, without what only the demonstration needs."""
    given = [f"{name}:={_plain_value(value)}" for name, value in parameters.items()]
    return ["--params-file", str(file), *(word for each in given for word in ("-p", each))]


class NodeProcess:
    """A node that runs until this is left.

    Args:
        namespace: that it is in.
        arguments: those of `node_arguments`.
        log: file that all it says goes to.

    Raises:
        DemoError: it cannot be started.
    """

    def __init__(self, namespace: str, arguments: list[str], log: Path) -> None:
        self._log = log
        command = [*_node_program(), "--ros-args", "-r", f"__ns:={namespace}", *arguments]
        try:
            self._process = start_process(command, log)
        except OSError as error:
            raise DemoError(
                f"the node cannot be started: {error}",
                f"run it by hand: {shlex.join(command)}",
            ) from error

    def require_alive(self) -> None:
        """Find out that it has ended.

        Raises:
            DemoError: it has; with the end of its log.
        """
        code = self._process.poll()
        if code is None:
            return
        raise DemoError(
            f"the node ended {_end_words(code)}; its log ends:\n{self.tail()}",
            _end_remedy(code, self._log),
        )

    def tail(self) -> str:
        """The end of its log."""
        lines: list[str] = []
        with contextlib.suppress(OSError):
            lines = self._log.read_text(errors="replace").splitlines()
        return "\n".join(f"    {line}" for line in lines[-_TAIL:]) or "    (it is empty)"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        end_process(self._process)


def start_process(command: list[str], log: Path) -> subprocess.Popen[bytes]:
    """A process that writes all it says to the log, and that Ctrl-C in the terminal spares."""
    with log.open("wb") as stream:
        return subprocess.Popen(
            command, stdout=stream, stderr=subprocess.STDOUT, start_new_session=True
        )


def end_process(process: subprocess.Popen[bytes]) -> None:
    """Interrupt it, and kill it where that is not enough."""
    process.send_signal(signal.SIGINT)
    try:
        process.wait(_ENDS_WITHIN)
    except BaseException:  # interrupted once more, too: it must not be left running
        process.kill()
        process.wait()


def _node_program() -> list[str]:
    beside = Path(sys.executable).parent
    path = f"{beside}{os.pathsep}{os.environ.get('PATH', '')}"
    installed = shutil.which("placement_planner", path=path)
    return [installed] if installed else [sys.executable, "-m", "placement_planner_ros.ros.node"]


def _plain_value(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _end_words(code: int) -> str:
    if code >= 0:
        return f"with code {code}"
    with contextlib.suppress(ValueError):
        return f"by {signal.Signals(-code).name}"
    return f"by signal {-code}"


def _end_remedy(code: int, log: Path) -> str:
    if code == -signal.SIGKILL:
        return "something killed it, mostly for want of memory; end other programs and try again"
    return f"read all of {log}; docs/troubleshooting.md is keyed by its messages"
