"""Compile all kernels in processes of their own, before anybody waits for one.

A process that compiles keeps what the compiler took, for its life, and compiles on one core only.
Two processes begin with different stages of `KnownTask` and keep each kernel on disk as it is done,
where the other finds it. Both end where the process that began them does.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import IO

from placement_planner_ros.core.disk_cache import cache_folder
from placement_planner_ros.core.kernel_cache import claim_versions
from placement_planner_ros.core.kernels import not_kept
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.warmup.known_task import KnownTask
from placement_planner_ros.core.warmup.passing import load_passed, pass_every_stage

_LOOK_PERIOD_S = 0.5
"""Seconds between looks at how far the processes are."""

_KERNEL_BYTES = 30_000_000
"""Bytes that all kernels take at most."""

_SPARING = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING": "1",
}
"""For each process: one core, and no colours in what numba tells itself of what did not fit."""

_ORDERS = (
    (KnownTask.reach, KnownTask.carry, KnownTask.collision, KnownTask.swept),
    (KnownTask.distances,),
)
"""The stages that each process begins with: the robot's and the scene's take as long as each other.

A process that came to the stages of the other would catch up with it, as it loads what is there,
and from then on both would compile the same."""


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
    """Compile what is not on disk yet, all where that cannot be loaded; stoppable, as
    `core.stopping` says.

    Args:
        told: how far it is, whenever that changed.

    Raises:
        CompilationError: it failed, or what is compiled cannot be kept.
        StoppedError: nobody wants them any more.
    """
    if load_passed():
        return
    _require_room()
    missing, kernels = not_kept()
    began, before, said = time.monotonic(), kernels - len(missing), -1

    def tell(done: int) -> None:
        nonlocal said
        if done > said:
            said = done
            told(CompilationProgress(done, kernels, time.monotonic() - began, before))

    with tempfile.TemporaryFile() as errors:  # a file, since a pipe that nobody reads would fill
        _run_processes(errors, lambda: tell(kernels - len(not_kept()[0])))
    tell(kernels)


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
            process.kill()  # the copy of it ends as the pipe is closed
    if process.returncode != 0:
        errors.seek(0)
        last = " ".join(errors.read().decode(errors="replace").split())[-300:]
        raise CompilationError(f"a process that compiled ended by {process.returncode}: {last}")


def _require_room() -> None:
    """Find out at once that nothing can be kept.

    Raises:
        CompilationError: it cannot.
    """
    folder = cache_folder()
    if folder is None:
        raise CompilationError("there is no home folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(_KERNEL_BYTES))
    except OSError as error:
        raise CompilationError(f"{folder}: {error.strerror or error}") from error


def _spawn_process(errors: IO[bytes]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", __name__],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=errors,
        start_new_session=True,  # a terminal's Ctrl-C is the caller's to handle
        env={**os.environ, **_SPARING},
    )


def _compile_in_processes() -> int:
    """Compile in two processes, of which the second is a copy of what the first has imported.

    Returns:
        0 where neither failed.
    """
    claim_versions()
    other = os.fork()
    threading.Thread(target=_end_with_caller, daemon=True).start()
    pass_every_stage(_ORDERS[0 if other else 1])
    return os.waitstatus_to_exitcode(os.waitpid(other, 0)[1]) if other else 0


def _end_with_caller() -> None:
    """End this process once nobody has the other end of its standard input any more."""
    os.read(sys.stdin.fileno(), 1)
    os._exit(1)


if __name__ == "__main__":
    sys.exit(_compile_in_processes())
