"""Compile all kernels in processes of their own, before anybody waits for one.

A process that compiles keeps what the compiler took, for its life, and compiles on one core only.
As many as there are cores pass the stages of `KnownTask`, each beginning with another one. A kernel
is compiled by one of them: the others turn to another stage meanwhile, or wait, and then find it on
disk. All end where the process that began them does.
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
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from filelock import FileLock, Timeout
from numba.core import event

from placement_planner_ros.core.child_process import child_environment
from placement_planner_ros.core.disk_cache import bypassed_cache
from placement_planner_ros.core.kernels import kernel_folder, kernel_names
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.warmup.known_task import STAGES, KnownTask
from placement_planner_ros.core.warmup.loading import CORE_PACKAGE, keep_passed, passed_file

_LOOK_PERIOD_S = 0.5
"""Seconds between looks at how far the processes are."""

_KERNEL_BYTES = 100_000_000
"""Bytes that all kernels take at most."""

_SPARING = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""For each process: one core."""


class CompilationError(Exception):
    """The processes ended without all kernels."""


@dataclass(frozen=True, slots=True)
class CompilationProgress:
    """How far compiling is.

    Attributes:
        done: kernels that are compiled.
        kernels: how many there are.
        seconds: since it began.
        before: kernels that were compiled when it began.
    """

    done: int
    kernels: int
    seconds: float
    before: int = 0

    @property
    def left(self) -> float | None:
        """Seconds that it will take still, as far as can be told."""
        made = self.done - self.before
        return None if made < 10 else self.seconds * (self.kernels - self.done) / made

    def __str__(self) -> str:
        told = self.left is not None and self.done < self.kernels
        left = f", some {max(self.left or 0.0, 1.0):.0f} s left" if told else ""
        return f"{self.done} of {self.kernels} kernels compiled{left}"


def compile_kernels(told: Callable[[CompilationProgress], None]) -> None:
    """Compile what is not on disk yet; stoppable, as `core.stopping` says.

    Args:
        told: how far it is, whenever that changed.

    Raises:
        CompilationError: it failed, or what is compiled cannot be kept.
        StoppedError: nobody wants them any more.
    """
    # Nothing is missing where every stage was passed before.
    passed = passed_file()
    if passed is not None and passed.is_file():
        return
    folder = _folder_with_room()
    kernels, began, before, said = len(kernel_names()), time.monotonic(), _compiled_in(folder), -1

    def tell(done: int) -> None:
        nonlocal said
        if done > said:
            said = done
            told(CompilationProgress(done, kernels, time.monotonic() - began, before))

    # Processes compile, and the folder tells how far they are.
    with tempfile.TemporaryFile() as errors:  # a file, since a pipe that nobody reads would fill
        _run_processes(errors, lambda: tell(_compiled_in(folder)))
    tell(kernels)


def _compiled_in(folder: Path) -> int:
    """How many kernels a folder has in one version or more; it may have others, which are only
    written into these unless Python calls them."""
    return len(kernel_names() & {path.name.partition("-")[0] for path in folder.glob("*/*.nbi")})


def _run_processes(errors: IO[bytes], look: Callable[[], None]) -> None:
    """Have the processes work to their end, and look at them meanwhile.

    Raises:
        CompilationError: one failed.
        StoppedError: nobody wants them any more.
    """
    with _spawn_process(errors) as process:
        try:
            while process.poll() is None:
                step("compiling kernels")
                look()
                time.sleep(_LOOK_PERIOD_S)
        finally:
            process.kill()  # the copies of it end as the pipe is closed
    if process.returncode != 0:
        # The last that they said.
        errors.seek(0)
        last = " ".join(errors.read().decode(errors="replace").split())[-300:]
        raise CompilationError(f"a process that compiled ended by {process.returncode}: {last}")


def _folder_with_room() -> Path:
    """Find out at once that nothing can be kept.

    Raises:
        CompilationError: it cannot.
    """
    folder = kernel_folder()
    if folder is None:
        raise CompilationError("there is no home folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(_KERNEL_BYTES))
    except OSError as error:
        raise CompilationError(f"{folder}: {error.strerror or error}") from error
    return folder


def _spawn_process(errors: IO[bytes]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", __name__],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=errors,
        start_new_session=True,  # a terminal's Ctrl-C is the caller's to handle
        env={**child_environment(), **_SPARING, "NUMBA_CACHE_DIR": str(kernel_folder())},
    )


class _Elsewhere(BaseException):
    """Another process compiles what this one needs."""


class _Turns(event.Listener):
    """Has a kernel compiled by one process at a time, as numba's index of its versions needs, too.

    Attributes:
        patient: whether what another process compiles is waited for, before `_Elsewhere` is raised.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self.patient = folder, False
        self._held: list[FileLock] = []
        self._done: list[FileLock] = []

    def on_start(self, told: Any) -> None:
        """A kernel is not on disk, and would be compiled."""
        # What was compiled before is written by now.
        self.give_back()
        kernel = told.data["dispatcher"].py_func
        lock = FileLock(self._folder / f"{kernel.__module__}.{kernel.__name__}.lock")
        self._held.append(lock)  # numba tells the end of whatever it told the start of
        if not kernel.__module__.startswith(CORE_PACKAGE):
            return  # numba's own, which is not kept
        try:
            # Ours to compile, or another one is at it.
            lock.acquire(timeout=0)
        except Timeout:
            if self.patient:
                lock.acquire()
            raise _Elsewhere from None

    def on_end(self, told: Any) -> None:
        """It was compiled; numba writes it now, before it begins anything else."""
        self._done.append(self._held.pop())

    def give_back(self) -> None:
        """Let others have what has been written."""
        while self._done:
            self._done.pop().release()


def _pass_stages(first: int) -> None:
    """Pass all stages, from that one on."""
    folder = kernel_folder()
    assert folder is not None
    turns = _Turns(folder)
    event.register("numba:compile", turns)
    # Stages in turn; those that wait for another process come again later.
    waiting, put_off = deque(STAGES[first:] + STAGES[:first]), 0
    task: KnownTask | None = None
    with bypassed_cache():
        while waiting:
            # All were put off: wait for the first of them.
            turns.patient = put_off >= len(waiting)
            try:
                task = task or KnownTask()
                waiting[0](task)
            except _Elsewhere:
                waiting.rotate(-1)
                put_off += 1
            else:
                waiting.popleft()
                put_off = 0
            turns.give_back()


def _compile_in_processes() -> int:
    """Compile in as many processes as there are cores, copies of what this one has imported.

    Returns:
        0 where none failed.
    """
    # A copy for each further core, beginning with another stage.
    count = len(os.sched_getaffinity(0))
    others: list[int] = []
    while len(others) < count - 1:
        others.append(os.fork())
        if others[-1] == 0:  # this is the copy
            threading.Thread(target=_end_with_caller, daemon=True).start()
            _pass_stages(len(others) * len(STAGES) // count)
            return 0
    threading.Thread(target=_end_with_caller, daemon=True).start()
    # This process does its share, then waits for the copies.
    _pass_stages(0)
    codes = [os.waitstatus_to_exitcode(os.waitpid(other, 0)[1]) for other in others]
    keep_passed()
    return next((code for code in codes if code), 0)


def _end_with_caller() -> None:
    """End this process once nobody has the other end of its standard input any more."""
    os.read(sys.stdin.fileno(), 1)
    os._exit(1)


if __name__ == "__main__":
    sys.exit(_compile_in_processes())
