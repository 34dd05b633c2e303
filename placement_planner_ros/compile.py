"""`placement_planner --compile`: compile all kernels now, for images and installations."""

from __future__ import annotations

import contextlib
import sys
import time
from importlib import import_module

from placement_planner_ros.core.practice.compiling import (
    CompilationError,
    Progress,
    compile_kernels,
)
from placement_planner_ros.progress import ProgressLine

_WIDTH = 30
"""Characters of the bar."""


class _Bar:
    """Shows how far it is."""

    def __init__(self) -> None:
        self._line = ProgressLine()

    def show(self, progress: Progress) -> None:
        """Show it."""
        filled = _WIDTH * progress.done // progress.kernels
        line = f"[{'#' * filled}{'.' * (_WIDTH - filled)}] {progress}"
        self._line.show(line, always=progress.done == progress.kernels)

    def end(self) -> None:
        """Leave the line."""
        self._line.end()


def main() -> int:
    """Compile; 0 where all kernels are on disk."""
    began = time.monotonic()
    bar = _Bar()
    print("compiling the planner's kernels, once per installation and machine", flush=True)
    try:
        compile_kernels(bar.show)
    except CompilationError as error:
        bar.end()
        print(f"they are compiled as they are needed, for: {error}", file=sys.stderr)
        return 1
    bar.end()
    with contextlib.suppress(ModuleNotFoundError):  # no ROS here
        import_module(f"{__package__}.ros.run.loading").load_input_kernels()
    print(f"all kernels are compiled, after {time.monotonic() - began:.0f} s")
    return 0
