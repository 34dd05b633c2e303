"""Compiled kernels on disk, for the next process: checked as they are read, and never needed.

Each version of a kernel, for one kind of arguments on one kind of processor, is a file of its own
whose name says which. A damaged one is removed and compiled anew; where none can be read or
kept, kernels are compiled by each process. Numba's own cache has an index, which processes that
write at once give the same numbers for different kernels, and raises where a file is damaged or the
disk is full; what lost a block it runs.
"""

from __future__ import annotations

import contextlib
import hashlib
import pickle
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from placement_planner_ros.core.kept_files import TROUBLES, sealed, unsealed, write_whole


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

    @property
    def name(self) -> str:
        """The kernel's, and the line it begins in."""
        return self._name

    @property
    def is_kept(self) -> bool:
        """Whether a version of it is on disk, for whatever arguments and sound or not."""
        return bool(self._folder) and any(Path(self._folder).glob(f"{self._name}.*.nbk"))

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
            return CompileResult._rebuild(target_context, *_unpacked(content, path.name))
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
            write_whole(path, _packed(compiled._reduce(), path.name))
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
        return Path(self._folder) / f"{self._name}.{digest.hexdigest()[:24]}.nbk"


def _packed(parts: tuple[Any, ...], name: str) -> bytes:
    return sealed(dumps(parts), name)


def _unpacked(content: bytes, name: str) -> tuple[Any, ...]:
    """What was packed for the file of that name.

    Machine code that lost a block, or of another kernel, would end the process once it is run.

    Raises:
        ValueError: it is not as it was written there.
    """
    parts: tuple[Any, ...] = pickle.loads(unsealed(content, name))
    return parts
