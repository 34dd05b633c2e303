"""Compiled kernels on disk, for the next process: checked as they are read, and never needed.

Each version of a kernel, for one kind of arguments on one kind of processor, is a file of its own
whose name says which. It is written aside and then moved into its place, so that processes that
compile at once do not meet. A damaged one is removed and compiled anew; where none can be read or
kept, kernels are compiled by each process. Numba's own cache has an index, which processes that
write at once give the same numbers for different kernels, and raises where a file is damaged or the
disk is full; what lost a block it runs.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

Trouble = Literal["damaged", "unread", "unwritten"]
_DIGEST = hashlib.sha256().digest_size


class Troubles:
    """What keeps kernels from being kept, each kind once. Safe to use from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._known: dict[Trouble, str] = {}
        self._listener: Callable[[str], None] | None = None

    def listen(self, listener: Callable[[str], None]) -> None:
        """Call this with words for each trouble there was so far, and for each that comes."""
        with self._lock:
            self._listener = listener
            known = list(self._known.values())
        for words in known:
            listener(words)

    def note(self, trouble: Trouble, words: str) -> None:
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


class KernelCache:
    """The versions of one kernel, as numba's dispatcher asks for them.

    Args:
        function: what is compiled.
        folder: for the kernels of its file, made once it is needed; empty where there is none.
    """

    def __init__(self, function: Callable[..., Any], folder: str) -> None:
        self._code = function.__code__
        self._cells = [cell.cell_contents for cell in function.__closure__ or ()]
        self._name = f"{function.__qualname__}-{self._code.co_firstlineno}"
        self._folder = folder
        self._enabled = bool(folder)

    @property
    def cache_path(self) -> str:
        """The folder."""
        return self._folder

    def enable(self) -> None:
        """Read and write from now on."""
        self._enabled = bool(self._folder)

    def disable(self) -> None:
        """Neither read nor write from now on."""
        self._enabled = False

    def flush(self) -> None:
        """Forget all versions."""
        for path in Path(self._folder).glob(f"{self._name}.*") if self._folder else ():
            path.unlink(missing_ok=True)

    def load_overload(self, signature: object, target_context: Any) -> Any:
        """The version for these arguments, None where it has to be compiled."""
        target_context.refresh()
        if not self._enabled:
            return None
        path = self._path(signature, target_context.codegen())
        try:
            content = path.read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            words = f"kernels in {self._folder} cannot be read and are compiled: {error.strerror}"
            TROUBLES.note("unread", words)
            return None
        try:
            return CompileResult._rebuild(target_context, *_unpacked(content))
        except Exception:  # whatever a damaged file, or one of another make, leads to
            TROUBLES.note("damaged", f"{path} is damaged; that kernel is compiled anew")
            with contextlib.suppress(OSError):
                path.unlink()
            return None

    def save_overload(self, signature: object, compiled: Any) -> None:
        """Keep that version, where there is room for it."""
        if not self._enabled or compiled.lifted or compiled.library.has_dynamic_globals:
            return
        path = self._path(signature, compiled.codegen)
        try:
            _write(path, _packed(compiled._reduce()))
        except OSError as error:
            TROUBLES.note(
                "unwritten",
                f"kernels cannot be kept in {self._folder}: {error.strerror or error}; each start "
                "compiles them again until NUMBA_CACHE_DIR or XDG_CACHE_HOME names a folder that "
                "can be written",
            )

    def _path(self, signature: object, codegen: Any) -> Path:
        state = (str(signature), codegen.magic_tuple(), sys.implementation.cache_tag)
        digest = hashlib.sha256(repr(state).encode() + self._code.co_code + dumps(self._cells))
        return Path(self._folder) / f"{self._name}.{digest.hexdigest()[:24]}.nbc"


def _packed(parts: tuple[Any, ...]) -> bytes:
    content: bytes = dumps(parts)
    return hashlib.sha256(content).digest() + content


def _unpacked(content: bytes) -> tuple[Any, ...]:
    """What was packed; machine code that lost a block would end the process once it is run.

    Raises:
        ValueError: it is not as it was written.
    """
    digest, content = content[:_DIGEST], content[_DIGEST:]
    if hashlib.sha256(content).digest() != digest:
        raise ValueError("damaged")
    parts: tuple[Any, ...] = pickle.loads(content)
    return parts


def _write(path: Path, content: bytes) -> None:
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
