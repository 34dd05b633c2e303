"""`placement_planner --compile`: compile all kernels now, for images and installations."""

from __future__ import annotations

import signal
import sys
import time

from placement_planner_ros.core.disk_cache import TROUBLES
from placement_planner_ros.core.warmup.compiling import CompilationError, compile_kernels
from placement_planner_ros.progress import ProgressLine

_WIDTH = 30
"""Characters of the bar."""
_REMEDY = (
    "  what to try: make room there, or name a folder that can be written in XDG_CACHE_HOME, and "
    "compile again; until then each start of the node compiles what is missing"
)


def main() -> int:
    """Compile; 0 where all kernels are on disk."""
    # As an exception, so that the processes that compile are ended too.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    line = ProgressLine()
    # what keeps kernels from being kept or loaded
    TROUBLES.listen(line.say)
    try:
        return _compile(line)
    except CompilationError as error:
        line.end()
        print(f"not all kernels are compiled and kept: {error}\n{_REMEDY}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        line.end()
        print("interrupted; placement_planner --compile goes on from there", file=sys.stderr)
        return 128 + signal.SIGINT


def _compile(line: ProgressLine) -> int:
    """Compile, with a bar in that line; 0.

    Raises:
        CompilationError: it failed, or nothing can be kept.
    """
    began = time.monotonic()
    print("compiling the planner's kernels, once per installation and machine", flush=True)

    def show(done: int, kernels: int) -> None:
        bar = ("#" * (_WIDTH * done // kernels)).ljust(_WIDTH, ".")
        line.show(f"[{bar}] {done} of {kernels} kernels compiled", always=done == kernels)

    compile_kernels(show)
    line.end()
    print(f"all kernels are compiled, after {time.monotonic() - began:.0f} s")
    return 0
