"""Reads mesh files, and covers meshes, in a process of its own, which may run out of memory or
time, or die.

Whatever a file does to the loaders, the node lives and goes on answering, and the work can be ended
at any moment.
"""

from __future__ import annotations

import json
import os
import resource
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.convex_cover import Cover, convex_cover
from placement_planner_ros.core.meshes.read import Triangles, content_digest, read_mesh
from placement_planner_ros.core.types import Array

Bytes = npt.NDArray[Any]
"""As it is in memory."""

MAX_MEMORY = 2_000_000_000
"""Bytes that reading or covering a mesh may take."""

MAX_TIME = 60.0
"""Seconds that reading a mesh may take; of processor time, what covering one may."""

MAX_WAIT = 240.0
"""Seconds to wait for a cover, since a busy machine gives its process less than a core."""

_LOOK = 0.05
"""Seconds between looks at whether to go on."""

_CHUNK = 1 << 20


class MeshProcessStoppedError(Exception):
    """Nobody wants the mesh any more."""


class ProcessorTimeError(TimeoutError):
    """The work took more processor time than it may."""


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

    def read(self, path: Path) -> tuple[Array, Triangles]:
        """Vertices (n, 3) and triangles (t, 3) of a file, as `read_mesh` has them.

        Raises:
            ValueError: it cannot be read; the message says why.
            StoppedError: `should_stop` said so.
        """
        vertices, triangles, _ = self.read_with_digest(path)
        return vertices, triangles

    def read_with_digest(self, path: Path) -> tuple[Array, Triangles, bytes]:
        """`read`, and the `content_digest` of what the file held as it was read.

        Raises:
            ValueError: it cannot be read; the message says why.
            StoppedError: `should_stop` said so.
        """
        head, arrays = self._ask({"path": str(path)}, [], MAX_TIME)
        vertices = np.frombuffer(arrays[: 24 * head["vertices"]])
        triangles = np.frombuffer(arrays[24 * head["vertices"] :], np.int64)
        digest = bytes.fromhex(head["digest"])
        return vertices.reshape(-1, 3), triangles.reshape(-1, 3), digest

    def cover(
        self, vertices: Array, triangles: Triangles, tolerance: float, seconds: float = MAX_TIME
    ) -> Cover:
        """The convex cover of a mesh, as `core.body.convex_cover` makes it.

        Args:
            seconds: of processor time that it may take.

        Raises:
            ValueError: it cannot be made; the message says why.
            ProcessorTimeError: making it took longer than that.
            TimeoutError: it took longer than `MAX_WAIT`.
            StoppedError: `should_stop` said so.
        """
        request: dict[str, object] = {
            "tolerance": tolerance,
            "seconds": seconds,
            "vertices": len(vertices),
            "triangles": len(triangles),
        }
        given = [
            np.ascontiguousarray(vertices, np.float64),
            np.ascontiguousarray(triangles, np.int64),
        ]
        head, arrays = self._ask(request, given, MAX_WAIT)
        points = np.frombuffer(arrays).reshape(-1, 3)
        parts = np.split(points, np.cumsum(head["parts"])[:-1])
        return Cover(tuple(parts), head["excess"], head["closed"])

    def _ask(
        self, request: dict[str, object], given: list[Bytes], patience: float
    ) -> tuple[dict[str, Any], bytes]:
        """The answer's head, and the bytes that follow it, within `patience` seconds."""
        if self._child is None:
            self._child = _spawn()
        child, end = self._child, time.monotonic() + patience
        assert child.stdin is not None
        try:
            child.stdin.write(json.dumps(request).encode() + b"\n")
            for array in given:
                child.stdin.write(array.tobytes())
            child.stdin.flush()
            head = json.loads(self._take(child, None, end))
            if "error" in head:
                raise ValueError(head["error"])
            return head, self._take(child, head["bytes"], end)
        except (EOFError, BrokenPipeError) as error:
            ended = child.wait()  # its end of the pipe is closed, so it has ended or is about to
            self.close()
            if ended == -signal.SIGXCPU:
                seconds = request.get("seconds", MAX_TIME)
                words = f"it took more than {seconds:g} s of processor time"
                raise ProcessorTimeError(words) from error
            raise ValueError("it ended the process that did it") from error
        except TimeoutError:
            self.close()
            raise TimeoutError(f"it took longer than {patience:g} s") from None
        except MeshProcessStoppedError:
            self.close()
            raise

    def _take(self, child: subprocess.Popen[bytes], count: int | None, end: float) -> bytes:
        """So many bytes, or a line, as they come."""
        assert child.stdout is not None
        taken = bytearray()
        with selectors.DefaultSelector() as selector:
            selector.register(child.stdout, selectors.EVENT_READ)
            while count is None or len(taken) < count:
                if self._should_stop():
                    raise MeshProcessStoppedError
                if time.monotonic() > end:
                    raise TimeoutError
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


def _read(request: dict[str, Any]) -> tuple[dict[str, object], list[Bytes]]:
    path = Path(request["path"])
    vertices, triangles = read_mesh(path)
    arrays = [
        np.ascontiguousarray(vertices, np.float64),
        np.ascontiguousarray(triangles, np.int64),
    ]
    head = {
        "vertices": len(vertices),
        "triangles": len(triangles),
        "digest": content_digest(path.suffix.lower(), path.read_bytes()).hex(),
    }
    return head, arrays


def _cover(request: dict[str, Any], given: IO[bytes]) -> tuple[dict[str, object], list[Bytes]]:
    vertices = np.frombuffer(given.read(24 * request["vertices"])).reshape(-1, 3)
    triangles = np.frombuffer(given.read(24 * request["triangles"]), np.int64).reshape(-1, 3)
    cover = convex_cover(vertices, triangles, request["tolerance"])
    head = {
        "parts": [len(part) for part in cover.parts],
        "excess": cover.excess,
        "closed": cover.closed,
    }
    return head, list(cover.parts)


def _answer(request: dict[str, Any], given: IO[bytes], out: IO[bytes]) -> None:
    try:
        head, arrays = _read(request) if "path" in request else _cover(request, given)
    except MemoryError:
        words = f"it takes more than {MAX_MEMORY} bytes of memory"
        out.write(json.dumps({"error": words}).encode() + b"\n")
    except Exception as error:  # whatever loaders raise at what they are given
        words = " ".join(str(error).split())[:300] or "it holds what no such file does"
        known = isinstance(error, (ValueError, OSError))
        words = words if known else f"{type(error).__name__}: {words}"
        out.write(json.dumps({"error": words}).encode() + b"\n")
    else:
        head["bytes"] = sum(array.nbytes for array in arrays)
        out.write(json.dumps(head).encode() + b"\n")
        for array in arrays:
            out.write(array.tobytes())
    out.flush()


def main() -> None:
    """Read the files, and cover the meshes, that lines of the standard input ask for."""
    resource.setrlimit(resource.RLIMIT_DATA, (MAX_MEMORY, MAX_MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # Loaders may print; what they print is no answer.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    for line in sys.stdin.buffer:
        request = json.loads(line)
        # Should the node die without a word, this process does not read on for ever.
        seconds = int(time.process_time() + request.get("seconds", MAX_TIME)) + 1
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, resource.RLIM_INFINITY))
        _answer(request, sys.stdin.buffer, out)


if __name__ == "__main__":
    main()
