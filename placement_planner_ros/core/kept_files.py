"""Files kept for the next process: checked as they are read, and never needed.

Each is written aside and then moved into its place, so that processes that write at once do not
meet, and holds a digest of its content, since a file may lose a block. What former versions of this
package kept goes some time after the last of them ran.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import re
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from io import BytesIO
from pathlib import Path
from typing import Any

import numba
import numpy as np

_config: Any = numba.config
_PACKAGE = Path(__file__).parents[1]
_DIGEST = hashlib.sha256().digest_size

MAX_KEPT = 1_000_000_000
"""Bytes that arrays of one kind may take on disk: an object of 200,000 triangles takes 35 MB."""

UNUSED = 60 * 24 * 3600.0
"""Seconds after which a folder goes that nobody used while others were: kernels of a version of
this package are in folders of their own."""

_DAY = 24 * 3600.0
"""Seconds."""

_VERSION = re.compile(r"-[0-9a-f]{16}$")
_KERNELS = re.compile(r".+\.nbk")
_ARRAYS = re.compile(r"[0-9a-f]{32}\.[a-z]+")
"""How folders of kernels end, and how what is kept is named."""

_USED: set[str] = set()
"""Folders of kernels that this process uses."""


class Troubles:
    """What keeps files from being kept, each kind once. Safe to use from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._known: dict[str, str] = {}
        self._listener: Callable[[str], None] | None = None

    def listen(self, listener: Callable[[str], None]) -> None:
        """Call this with words for each trouble there was so far, and for each that comes."""
        with self._lock:
            self._listener = listener
            known = list(self._known.values())
        for words in known:
            listener(words)

    def note(self, trouble: str, words: str) -> None:
        """There is trouble of that kind."""
        with self._lock:
            if trouble in self._known:
                return
            self._known[trouble] = words
            listener = self._listener
        if listener is not None:
            listener(words)


TROUBLES = Troubles()
"""Of this process."""


def kept_folder() -> Path | None:
    """Where files are kept: NUMBA_CACHE_DIR, or below XDG_CACHE_HOME or ~/.cache; None without."""
    if _config.CACHE_DIR:
        return Path(_config.CACHE_DIR)
    caches = os.environ.get("XDG_CACHE_HOME")
    try:
        return Path(caches or Path.home() / ".cache") / _PACKAGE.name
    except RuntimeError:
        return None


def sealed(content: bytes, name: str) -> bytes:
    """The content of the file of that name, after the digest of both."""
    return hashlib.sha256(name.encode() + content).digest() + content


def unsealed(data: bytes, name: str) -> bytes:
    """The content that was sealed for the file of that name.

    Raises:
        ValueError: it is not as it was written there.
    """
    content = memoryview(data)[_DIGEST:]  # as some are large
    found = hashlib.sha256(name.encode())
    found.update(content)
    if found.digest() != data[:_DIGEST]:
        raise ValueError("damaged")
    return bytes(content)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file that others see whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor, aside = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".tmp")
    try:
        with open(descriptor, "wb") as stream:
            stream.write(content)
        os.replace(aside, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(aside)
        raise


Arrays = dict[str, np.ndarray[Any, Any]]

_AFRESH: ContextVar[bool] = ContextVar("afresh", default=False)


@contextlib.contextmanager
def made_afresh() -> Iterator[None]:
    """Meanwhile arrays are made, not taken from disk: what makes them is to be passed, too."""
    before = _AFRESH.set(True)
    try:
        yield
    finally:
        _AFRESH.reset(before)


def kept_arrays(what: str, key: bytes, make: Callable[[], Arrays]) -> Arrays:
    """Arrays from disk, or made and kept there.

    Args:
        what: they are, in words: `convex covers`.
        key: all that they depend on.
        make: makes them; what it raises ends it.
    """
    found = found_arrays(what, key)
    if found is None:
        found = make()
        keep_arrays(what, key, found)
    return found


def found_arrays(what: str, key: bytes) -> Arrays | None:
    """Arrays that were kept as `kept_arrays` does; None where there are none."""
    path = _path(what, key)
    return None if path is None else _read_arrays(what, path)


def keep_arrays(what: str, key: bytes, arrays: Arrays) -> None:
    """Keep arrays for `found_arrays`."""
    path = _path(what, key)
    if path is not None:
        _write_arrays(what, path, arrays)


def _path(what: str, key: bytes) -> Path | None:
    folder = kept_folder()
    if folder is None or _AFRESH.get():
        return None
    name = f"{hashlib.sha256(key).hexdigest()[:32]}.{what.split()[-1]}"
    return folder / what.replace(" ", "-") / name


def _read_arrays(what: str, path: Path) -> Arrays | None:
    try:
        data = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        words = f"{what} in {path.parent} cannot be read and are made: {error.strerror}"
        TROUBLES.note(f"{what} unread", words)
        return None
    try:
        with np.load(BytesIO(unsealed(data, path.name)), allow_pickle=False) as kept:
            found = dict(kept)
    except Exception:  # whatever a damaged file, or one of another make, leads to
        TROUBLES.note(f"{what} damaged", f"{path}, of {what}, is damaged and made anew")
        with contextlib.suppress(OSError):
            path.unlink()
        return None
    with contextlib.suppress(OSError):
        os.utime(path)  # the last to go
    return found


def _write_arrays(what: str, path: Path, arrays: Arrays) -> None:
    stream = BytesIO()
    named: Any = arrays
    np.savez(stream, **named)  # not compressed: that takes longer than it saves
    try:
        write_whole(path, sealed(stream.getvalue(), path.name))
        _make_room(path.parent, stream.tell())
    except OSError as error:
        TROUBLES.note(
            f"{what} unwritten",
            f"{what} cannot be kept in {path.parent}: {error.strerror or error}; each start "
            "makes them again until NUMBA_CACHE_DIR or XDG_CACHE_HOME names a folder that can be "
            "written",
        )
        return
    with contextlib.suppress(OSError):  # another process may remove the same
        _remove_unused(path.parents[1])


_ROOM: dict[Path, int] = {}
"""Bytes that this process may still add to a folder before it looks what is there."""


def _make_room(folder: Path, added: int) -> None:
    """Remove what was not read for longest, where there is more than `MAX_KEPT`.

    Who is reading it goes on; who comes later makes it anew. As other processes may write there,
    too, the folder is looked at again after a tenth of what there was room for.
    """
    left = _ROOM.get(folder, 0) - added
    if left <= 0:
        total, found = 0, []
        for entry in os.scandir(folder):
            with contextlib.suppress(FileNotFoundError):  # another process removed it
                state = entry.stat()
                total += state.st_size
                found.append((state.st_mtime_ns, state.st_size, entry.path))
        for _, size, path in sorted(found):
            if total <= MAX_KEPT:
                break
            total -= size
            with contextlib.suppress(FileNotFoundError):
                os.unlink(path)
        left = (MAX_KEPT - total) // 10
    _ROOM[folder] = left


def note_used(folder: Path) -> None:
    """Somebody uses the kernels in that folder, if there is one: once a day it is made as new.

    Never made older, as the clock of a robot may have been set back.
    """
    _USED.add(str(folder))
    with contextlib.suppress(OSError):
        if folder.stat().st_mtime < time.time() - _DAY:
            os.utime(folder)


@functools.cache
def _remove_unused(caches: Path) -> None:
    """Remove folders that were last used `UNUSED` before another was; once in a process.

    By one another's age, not by a clock, which may be wrong; only where all in them is of ours, as
    NUMBA_CACHE_DIR may be everybody's.
    """
    found = [(_last_used(entry), entry.path) for entry in os.scandir(caches) if _is_ours(entry)]
    newest = max((used for used, _ in found), default=0.0)
    for used, path in found:
        if used < newest - UNUSED and path not in _USED:
            with contextlib.suppress(OSError):  # another process removes it, or uses it again
                for entry in os.scandir(path):
                    os.unlink(entry.path)
                os.rmdir(path)


def _is_ours(folder: os.DirEntry[str]) -> bool:
    """Whether in that folder there are kernels or arrays of one kind, by their names, and nothing
    else."""
    if not folder.is_dir(follow_symlinks=False):
        return False
    name = _KERNELS if _VERSION.search(folder.name) else _ARRAYS
    try:
        names = [entry.name for entry in os.scandir(folder)]
    except OSError:  # somebody else's, or gone
        return False
    return bool(names) and all(name.fullmatch(each) for each in names)


def _last_used(folder: os.DirEntry[str]) -> float:
    """Seconds since 1970."""
    times = [folder.stat().st_mtime]
    for entry in os.scandir(folder):
        with contextlib.suppress(FileNotFoundError):
            times.append(entry.stat().st_mtime)
    return max(times)


def version_of(file: str, names: Sequence[str]) -> str:
    """Of the files of these names beside `file`: what they make is kept for it alone.

    Args:
        names: `shapes.py`, or `../body/polytope.py` for a file in a folder nearby.
    """
    digest = hashlib.sha256()
    for name in names:
        digest.update(Path(file).parent.joinpath(name).read_bytes())
    return digest.hexdigest()
