"""Compile all kernels in processes of their own, before anybody waits for one.

A process that compiles keeps what the compiler took, for its life, and compiles on one core only.
As many as there are cores pass the stages of `KnownTask`, each beginning with another one. A kernel
is compiled by one of them: the others turn to another stage meanwhile, and find it on disk when
they come back. All end where the process that began them does.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout
from numba.core import event

from placement_planner_ros.core.child_process import child_environment
from placement_planner_ros.core.kernels import (
    are_all_kept,
    kernel_folder,
    kernel_names,
    note_all_kept,
)
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.warmup.known_task import STAGES, KnownTask

_LOOK_PERIOD_S = 0.5
"""Seconds between looks at how far the processes are, and at what another one compiles."""


class CompilationError(Exception):
    """The processes ended without all kernels."""


def compile_kernels(told: Callable[[int, int], None]) -> None:
    """Compile what is not on disk yet; stoppable, as `core.stopping` says.

    Args:
        told: gets how many kernels are compiled, and of how many, whenever that changed.

    Raises:
        CompilationError: it failed, or what is compiled cannot be kept.
        StoppedError: nobody wants them any more.
    """
    folder = kernel_folder()
    if folder is None:
        raise CompilationError("there is no home folder")
    if are_all_kept(folder):
        return
    kernels, said = kernel_names(), -1

    def look() -> None:
        # Others in there are only written into these, unless Python calls them.
        nonlocal said
        done = len(kernels & {path.name.partition("-")[0] for path in folder.glob("*/*.nbi")})
        if done > said:
            said = done
            told(done, len(kernels))

    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as aside:
            _run_processes(folder, Path(aside), look)
        look()
        note_all_kept(folder)
    except OSError as error:
        raise CompilationError(f"{folder}: {error.strerror or error}") from error


def _run_processes(folder: Path, aside: Path, look: Callable[[], None]) -> None:
    """Have processes compile, and look at them meanwhile.

    Args:
        aside: an empty folder.

    Raises:
        CompilationError: it failed.
        StoppedError: nobody wants them any more.
    """
    errors = aside / "errors"
    with ExitStack() as ended, errors.open("wb") as output:
        processes: list[subprocess.Popen[bytes]] = []
        for number in range(len(os.sched_getaffinity(0))):
            process = _spawn_process(number, folder, aside, output.fileno())
            processes.append(ended.enter_context(process))
            ended.callback(process.kill)
        # What has passed all stages has found, or made, all kernels.
        while processes[0].poll() is None:
            step("compiling kernels")
            look()
            time.sleep(_LOOK_PERIOD_S)
    code = processes[0].returncode
    if code != 0:
        last = " ".join(errors.read_text(errors="replace").split())[-300:]
        raise CompilationError(f"a process that compiled ended by {code}: {last}")


def _spawn_process(number: int, folder: Path, aside: Path, errors: int) -> subprocess.Popen[bytes]:
    """One that passes all stages on one core, beginning with another one than others do."""
    # It finds no results on disk, as what makes these has kernels, too.
    own = {"NUMBA_CACHE_DIR": str(folder), "XDG_CACHE_HOME": str(aside / f"{number}")}
    one_core = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, "-m", __name__, f"{number}"],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=errors,
        start_new_session=True,  # a terminal's Ctrl-C is the caller's to handle
        env={**child_environment(), **own, **one_core},
    )


class _Elsewhere(BaseException):
    """Another process compiles what this one needs."""


class _Turns(event.Listener):
    """Has a kernel compiled by one process at a time; numba's index of its versions needs that."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._held: list[FileLock] = []
        self._done: list[FileLock] = []

    def on_start(self, told: Any) -> None:
        """A kernel is not on disk, and would be compiled."""
        # What was compiled before is written by now.
        self.give_back()
        kernel = told.data["dispatcher"].py_func
        lock = FileLock(self._folder / f"{kernel.__module__}.{kernel.__name__}.lock")
        self._held.append(lock)  # numba tells the end of whatever it told the start of
        if not kernel.__module__.startswith(__package__.rpartition(".")[0]):
            return  # numba's own, which is not kept
        try:
            lock.acquire(timeout=0)
        except Timeout:
            raise _Elsewhere from None

    def on_end(self, told: Any) -> None:
        """It was compiled; numba writes it now, before it begins anything else."""
        self._done.append(self._held.pop())

    def give_back(self) -> None:
        """Let others have what has been written."""
        while self._done:
            self._done.pop().release()


def _pass_stages(first: int) -> None:
    """Pass all stages, from that one on; those that another process is at come again later."""
    turns = _Turns(Path(os.environ["NUMBA_CACHE_DIR"]))
    event.register("numba:compile", turns)
    waiting = deque(STAGES)
    waiting.rotate(-first)
    task: KnownTask | None = None
    while waiting:
        try:
            waiting[0](task or KnownTask())
        except _Elsewhere:
            waiting.rotate(-1)
            turns.give_back()
            time.sleep(_LOOK_PERIOD_S)
        else:
            waiting.popleft()
            turns.give_back()


def _end_with_caller() -> None:
    """End this process once nobody has the other end of its standard input any more."""
    os.read(sys.stdin.fileno(), 1)
    os._exit(1)


if __name__ == "__main__":
    threading.Thread(target=_end_with_caller, daemon=True).start()
    _pass_stages(int(sys.argv[1]) * len(STAGES) // len(os.sched_getaffinity(0)))
