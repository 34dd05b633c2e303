"""`placement_planner --compile`: compile all kernels now, for images and installations."""

from __future__ import annotations

import signal
import sys
import time

from placement_planner_ros.core.disk_cache import TROUBLES
from placement_planner_ros.core.warmup.compiling import (
    CompilationError,
    CompilationProgress,
    compile_kernels,
)
from placement_planner_ros.progress import ProgressLine

_WIDTH = 30
"""Characters of the bar."""
_INTERRUPTED = 130
_REMEDY = (
    "  what to try: make room there, or name a folder that can be written in XDG_CACHE_HOME, and "
    "run placement_planner --compile again; until then each start of the node compiles what is "
    "missing"
)


class _Bar:
    """Shows how far it is."""

    def __init__(self) -> None:
        self._line = ProgressLine()

    def show(self, progress: CompilationProgress) -> None:
        """Show it."""
        filled = _WIDTH * progress.done // progress.kernels
        line = f"[{'#' * filled}{'.' * (_WIDTH - filled)}] {progress}"
        self._line.show(line, always=progress.done == progress.kernels)

    def say(self, words: str) -> None:
        """Say what keeps kernels from being kept or loaded."""
        self._line.say(words)

    def end(self) -> None:
        """Leave the line."""
        self._line.end()


def main() -> int:
    """Compile; 0 where all kernels are on disk."""
    # As an exception, so that the processes that compile are ended too.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    bar = _Bar()
    TROUBLES.listen(bar.say)
    try:
        return _compile(bar)
    except CompilationError as error:
        bar.end()
        print(f"not all kernels are compiled and kept: {error}\n{_REMEDY}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        bar.end()
        print(
            "interrupted; what is compiled is kept, placement_planner --compile goes on from there",
            file=sys.stderr,
        )
        return _INTERRUPTED


def _compile(bar: _Bar) -> int:
    """Compile with that bar; 0.

    Raises:
        CompilationError: it failed, or nothing can be kept.
    """
    began = time.monotonic()
    print("compiling the planner's kernels, once per installation and machine", flush=True)
    compile_kernels(bar.show)
    bar.end()
    print(f"all kernels are compiled, after {time.monotonic() - began:.0f} s")
    return 0
