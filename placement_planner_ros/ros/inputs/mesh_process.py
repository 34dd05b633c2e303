"""Reads mesh files, and covers meshes, in a process of its own, which may run out of memory or
time, or die.

Whatever a file does to the loaders, the node lives and goes on answering, and the work can be ended
at any moment. What was read or covered once is kept on disk.
"""

from __future__ import annotations

import os
import pickle
import resource
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any

from placement_planner_ros.core.body.convex_cover import Cover, convex_cover, hull_cover
from placement_planner_ros.core.body.covered_mesh import kept_cover
from placement_planner_ros.core.body.mesh_components import Triangles
from placement_planner_ros.core.child_process import child_environment
from placement_planner_ros.core.disk_cache import stored_result
from placement_planner_ros.core.meshes.read import check_header, content_digest, read_mesh
from placement_planner_ros.core.stopping import StoppedError, step
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.patience import LOOK_S, PREPARING_S

MAX_MEMORY_BYTES = 2_000_000_000
"""That reading or covering a mesh may take."""
COVER_TIME_S = 16.0
"""Of processor time, that covering a mesh may take."""


class ProcessorTimeError(TimeoutError):
    """The work took more processor time than it may."""


class MeshProcess:
    """Reads meshes one after the other, `stoppable`, until closed; not for several threads."""

    def __init__(self) -> None:
        self._child: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> MeshProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process, if there is one."""
        child, self._child = self._child, None
        if child is not None:
            child.kill()
            child.communicate()

    def read(self, path: Path) -> tuple[Array, Triangles]:
        """The mesh of a file, as `read_mesh` has it.

        Raises:
            ValueError: it cannot be read; the message says why.
            TimeoutError: that took longer than `PREPARING_S` of processor time, or four times as
                long on a machine that is busy.
        """
        made: tuple[Array, Triangles] = self._ask(("read", path), PREPARING_S)
        return made

    def cover(self, vertices: Array, triangles: Triangles) -> Cover:
        """The convex cover of a mesh, as `core.body.convex_cover` makes it.

        Raises:
            ValueError: it cannot be made; the message says why.
            ProcessorTimeError: making it took longer than `COVER_TIME_S`.
            TimeoutError: it took four times as long, on a machine that is busy.
        """
        made: Cover = self._ask(("cover", vertices, triangles), COVER_TIME_S)
        return made

    def _ask(self, request: tuple[object, ...], seconds: float) -> Any:
        """The answer to a request, within so many seconds of processor time, and four times as many
        by the clock: a machine that is busy makes no mesh a bad one."""
        # one process for all requests, begun with the first
        if self._child is None:
            self._child = _spawn()
        child, patience = self._child, 4.0 * seconds
        end = time.monotonic() + patience
        assert child.stdin is not None
        assert child.stdout is not None
        try:
            pickle.dump((seconds, *request), child.stdin)
            child.stdin.flush()
            # looked at in between, as a large mesh may take a minute
            while not select.select([child.stdout], [], [], LOOK_S)[0]:
                step("reading and covering meshes")
                if time.monotonic() > end:
                    raise TimeoutError(f"it took longer than {patience:g} s")
            answer = pickle.load(child.stdout)
        except (EOFError, BrokenPipeError, pickle.UnpicklingError) as error:
            ended = child.wait()  # its end of the pipe is closed, so it has ended or is about to
            self.close()
            # the signal by which the system ends what exceeds its processor time
            if ended == -signal.SIGXCPU:
                words = f"it took more than {seconds:g} s of processor time"
                raise ProcessorTimeError(words) from error
            raise ValueError("it ended the process that did it") from error
        except (TimeoutError, StoppedError):
            self.close()
            raise
        # words in place of a result say why there is none
        if isinstance(answer, str):
            raise ValueError(answer)
        return answer


def read_kept(process: MeshProcess, path: Path) -> tuple[Array, Triangles]:
    """Vertices (n, 3) and triangles (t, 3) of a file whose header was looked at.

    Starting the process takes a second of processor time, reading a large text some tenths: neither
    is needed where a file of that content was read before.

    Raises:
        OSError: it cannot be opened.
        ValueError: it cannot be read; the message says why.
    """
    digest = content_digest(path.suffix.lower(), path.read_bytes())

    def read() -> tuple[Array, Triangles]:
        made = process.read(path)
        # else the digest would stand for another content
        if content_digest(path.suffix.lower(), path.read_bytes()) != digest:
            raise ValueError("it was changed while it was read")
        return made

    return stored_result("read meshes", digest, read)


KeptMesh = tuple[Hashable, Callable[[MeshProcess], tuple[Array, Triangles]]]
"""What tells a mesh from others, and what reads its vertices (n, 3) and triangles (t, 3)."""


def mesh_of_file(path: Path) -> KeptMesh:
    """The mesh of a file in the state in which it is now, its header found in order.

    Raises:
        OSError, ValueError: it is no mesh file.
    """
    check_header(path)
    found = path.stat()
    # a file that was written anew is another mesh
    key = path, found.st_ino, found.st_size, found.st_mtime_ns
    return key, lambda process: read_kept(process, path)


def cover_in(process: MeshProcess, vertices: Array, triangles: Triangles) -> Cover:
    """The cover of a mesh from disk, or made in the process and kept; the hull where that takes too
    long, which is kept, so as not to try again each time, or too much memory.

    Args:
        vertices, triangles: as of `convex_cover`.
    """

    def make(*_: object) -> Cover:
        try:
            return process.cover(vertices, triangles)
        except ProcessorTimeError:
            return hull_cover(vertices, triangles)

    try:
        return kept_cover(vertices, triangles, make)
    except (ValueError, TimeoutError):
        return hull_cover(vertices, triangles)


def _spawn() -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", __name__],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # a terminal's Ctrl-C is the node's to handle
        env={**child_environment(), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
    )


def _answer(what: str, *given: Any) -> object:
    """What was asked for, or in words why not."""
    try:
        return convex_cover(*given) if what == "cover" else read_mesh(*given)
    except MemoryError:
        return f"it takes more than {MAX_MEMORY_BYTES} bytes of memory"
    except Exception as error:  # whatever else covering a mesh raises
        words = " ".join(str(error).split())[:300] or "it holds what no such file does"
        known = isinstance(error, (ValueError, OSError))
        return words if known else f"{type(error).__name__}: {words}"


def _end_with_node() -> None:
    """End this process, whatever it does, once nobody has the other end of its standard input."""
    hung_up = select.poll()
    hung_up.register(sys.stdin, 0)  # which leaves POLLHUP alone: requests are read elsewhere
    hung_up.poll()
    os._exit(1)


def main() -> None:
    """Read the files, and cover the meshes, that the standard input asks for."""
    # a node that crashes can end no other process
    threading.Thread(target=_end_with_node, daemon=True).start()
    # a mesh that takes too much memory fails here, and the node goes on
    resource.setrlimit(resource.RLIMIT_DATA, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # Loaders may print; what they print is no answer.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    while True:
        try:
            seconds, *request = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        # of processor time, counted from the beginning of the process
        latest = int(time.process_time() + seconds) + 1
        resource.setrlimit(resource.RLIMIT_CPU, (latest, resource.RLIM_INFINITY))
        pickle.dump(_answer(*request), out, protocol=5)
        out.flush()


if __name__ == "__main__":
    main()
