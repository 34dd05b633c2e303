"""Reads mesh files, and covers meshes, in a process of its own, which may run out of memory or
time, or die.

Whatever a file does to the loaders, the node lives and goes on answering, and the work can be ended
at any moment.
"""

from __future__ import annotations

import io
import os
import resource
import selectors
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.convex_cover import Cover, convex_cover
from placement_planner_ros.core.meshes.read import Triangles, content_digest, read_mesh
from placement_planner_ros.core.types import Array

Arrays = dict[str, npt.NDArray[Any]]

MAX_MEMORY = 2_000_000_000
"""Bytes that reading or covering a mesh may take."""

MAX_TIME = 60.0
"""Seconds that reading a mesh may take; of processor time, what covering one may."""

MAX_WAIT = 240.0
"""Seconds to wait for a cover, since a busy machine gives its process less than a core."""

LOOK_S = 0.05
"""Seconds between looks at whether to go on."""


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

    def __exit__(self, *raised: object) -> None:
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
        made = self._ask(MAX_TIME, path=str(path))
        return made["vertices"], made["triangles"], bytes(made["digest"])

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
        made = self._ask(
            MAX_WAIT, vertices=vertices, triangles=triangles, tolerance=tolerance, seconds=seconds
        )
        parts = np.split(made["points"], np.cumsum(made["counts"])[:-1])
        return Cover(tuple(parts), float(made["excess"]), bool(made["closed"]))

    def _ask(self, patience: float, **request: Any) -> Arrays:
        """The answer, within `patience` seconds."""
        if self._child is None:
            self._child = _spawn()
        child, end = self._child, time.monotonic() + patience
        assert child.stdin is not None
        try:
            child.stdin.write(_packed(**request))
            (size,) = struct.unpack("<Q", self._take(child, 8, end))
            answer = _unpacked(self._take(child, size, end))
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
        if "error" in answer:
            raise ValueError(str(answer["error"]))
        return answer

    def _take(self, child: subprocess.Popen[bytes], count: int, end: float) -> bytes:
        """So many bytes, as they come."""
        assert child.stdout is not None
        taken = bytearray()
        with selectors.DefaultSelector() as selector:
            selector.register(child.stdout, selectors.EVENT_READ)
            while len(taken) < count:
                if self._should_stop():
                    raise MeshProcessStoppedError
                if time.monotonic() > end:
                    raise TimeoutError
                if selector.select(LOOK_S):
                    data = os.read(child.stdout.fileno(), min(1 << 20, count - len(taken)))
                    if not data:
                        raise EOFError
                    taken += data
        return bytes(taken)


def _packed(**values: Any) -> bytes:
    """Numbers, words and arrays, and before them how many bytes they are."""
    out = io.BytesIO()
    np.savez(out, **values)
    return struct.pack("<Q", out.tell()) + out.getvalue()


def _unpacked(data: bytes) -> Arrays:
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


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


def _read(request: Arrays) -> bytes:
    path = Path(str(request["path"]))
    vertices, triangles = read_mesh(path)
    digest = content_digest(path.suffix.lower(), path.read_bytes())
    return _packed(
        vertices=vertices, triangles=triangles, digest=np.frombuffer(digest, dtype=np.uint8)
    )


def _cover(request: Arrays) -> bytes:
    cover = convex_cover(request["vertices"], request["triangles"], float(request["tolerance"]))
    return _packed(
        points=np.concatenate(cover.parts),
        counts=np.array([len(part) for part in cover.parts]),
        excess=cover.excess,
        closed=cover.closed,
    )


def _answered(request: Arrays) -> bytes:
    try:
        return _read(request) if "path" in request else _cover(request)
    except MemoryError:
        return _packed(error=f"it takes more than {MAX_MEMORY} bytes of memory")
    except Exception as error:  # whatever loaders raise at what they are given
        words = " ".join(str(error).split())[:300] or "it holds what no such file does"
        known = isinstance(error, (ValueError, OSError))
        return _packed(error=words if known else f"{type(error).__name__}: {words}")


def main() -> None:
    """Read the files, and cover the meshes, that the standard input asks for."""
    resource.setrlimit(resource.RLIMIT_DATA, (MAX_MEMORY, MAX_MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # Loaders may print; what they print is no answer.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    while head := sys.stdin.buffer.read(8):
        request = _unpacked(sys.stdin.buffer.read(struct.unpack("<Q", head)[0]))
        # Should the node die without a word, this process does not read on for ever.
        seconds = int(time.process_time() + float(request.get("seconds", MAX_TIME))) + 1
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, resource.RLIM_INFINITY))
        out.write(_answered(request))
        out.flush()


if __name__ == "__main__":
    main()
