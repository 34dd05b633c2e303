"""Reads mesh files in a process of its own, which may run out of memory or time, or die.

Whatever a file does to the loaders, the node lives and goes on answering, and reading can be ended
at any moment.
"""

from __future__ import annotations

import json
import os
import resource
import selectors
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import IO, Literal

import numpy as np

from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.mesh_files import Triangles, read_object

Loader = Literal["object", "link"]
"""As an object's mesh (trimesh), or as a link's (coal)."""

MAX_MEMORY = 2_000_000_000
"""Bytes that reading a mesh may take."""

MAX_TIME = 60.0
"""Seconds that reading a mesh may take."""

_LOOK = 0.05
"""Seconds between looks at whether to go on."""

_CHUNK = 1 << 20


class StoppedError(Exception):
    """Nobody wants the mesh any more."""


class MeshProcess:
    """Reads meshes one after the other, until closed; not for several threads at once.

    Args:
        should_stop: looked at while a mesh is read.
    """

    def __init__(self, should_stop: Callable[[], bool] = lambda: False) -> None:
        self._should_stop = should_stop
        self._child: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> MeshProcess:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the process, if there is one."""
        child, self._child = self._child, None
        if child is not None:
            child.kill()
            child.communicate()

    def read(self, path: Path, loader: Loader) -> tuple[Array, Triangles]:
        """Vertices (n, 3) and triangles (t, 3) of a file, in its unit.

        Raises:
            ValueError: it cannot be read; the message says why.
            StoppedError: `should_stop` said so.
        """
        if self._child is None:
            self._child = _spawn()
        child, end = self._child, time.monotonic() + MAX_TIME
        assert child.stdin is not None
        try:
            child.stdin.write(json.dumps([str(path), loader]).encode() + b"\n")
            child.stdin.flush()
            head = json.loads(self._take(child, None, end))
            if "error" in head:
                raise ValueError(head["error"])
            vertices = np.frombuffer(self._take(child, 24 * head["vertices"], end))
            triangles = np.frombuffer(self._take(child, 24 * head["triangles"], end), np.int64)
        except (EOFError, BrokenPipeError) as error:
            self.close()
            raise ValueError("reading it ended the process that did") from error
        except (StoppedError, TimeoutError):
            self.close()
            raise
        return vertices.reshape(-1, 3), triangles.reshape(-1, 3)

    def _take(self, child: subprocess.Popen[bytes], count: int | None, end: float) -> bytes:
        """So many bytes, or a line, as they come."""
        assert child.stdout is not None
        taken = bytearray()
        with selectors.DefaultSelector() as selector:
            selector.register(child.stdout, selectors.EVENT_READ)
            while count is None or len(taken) < count:
                if self._should_stop():
                    raise StoppedError
                if time.monotonic() > end:
                    raise TimeoutError(f"reading it took longer than {MAX_TIME:g} s")
                if not selector.select(_LOOK):
                    continue
                # A line is read byte by byte, to leave what follows it in the pipe.
                wanted = 1 if count is None else min(_CHUNK, count - len(taken))
                data = os.read(child.stdout.fileno(), wanted)
                if not data:
                    raise EOFError
                taken += data
                if count is None and data == b"\n":
                    break
        return bytes(taken)


def _spawn() -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", __name__],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        bufsize=0,
        start_new_session=True,  # a terminal's Ctrl-C is the node's to handle
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
    )


def _load(path: Path, loader: Loader) -> tuple[Array, Triangles]:
    if loader == "object":
        return read_object(path)
    from placement_planner_ros.core.robot.geometry import read_mesh

    return read_mesh(path)


def _answer(path: Path, loader: Loader, out: IO[bytes]) -> None:
    try:
        vertices, triangles = _load(path, loader)
    except MemoryError:
        words = f"it takes more than {MAX_MEMORY} bytes of memory to read"
        out.write(json.dumps({"error": words}).encode() + b"\n")
    except Exception as error:  # whatever loaders raise at what they are given
        words = " ".join(str(error).split())[:300] or "it holds what no such file does"
        known = isinstance(error, (ValueError, OSError))
        words = words if known else f"{type(error).__name__}: {words}"
        out.write(json.dumps({"error": words}).encode() + b"\n")
    else:
        counts = {"vertices": len(vertices), "triangles": len(triangles)}
        out.write(json.dumps(counts).encode() + b"\n")
        out.write(np.ascontiguousarray(vertices, np.float64).tobytes())
        out.write(np.ascontiguousarray(triangles, np.int64).tobytes())
    out.flush()


def main() -> None:
    """Read the files that lines of the standard input name."""
    resource.setrlimit(resource.RLIMIT_DATA, (MAX_MEMORY, MAX_MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # Loaders may print; what they print is no answer.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    for line in sys.stdin.buffer:
        # Should the node die without a word, this process does not read on for ever.
        resource.setrlimit(resource.RLIMIT_CPU, (int(time.process_time() + MAX_TIME) + 1, -1))
        path, loader = json.loads(line)
        _answer(Path(path), loader, out)


if __name__ == "__main__":
    main()
