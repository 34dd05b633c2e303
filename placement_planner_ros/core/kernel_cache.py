"""Compiled kernels on disk, for the next process: checked as they are read, and never needed.

Each version of a kernel, for one kind of arguments on one kind of processor, is a file of its own
whose name says which. A damaged one is removed and compiled anew; where none can be read or
kept, kernels are compiled by each process. Numba's own cache has an index, which processes that
write at once give the same numbers for different kernels, and raises where a file is damaged or the
disk is full; what lost a block it runs.

A kernel's machine code calls that of other kernels (`kernel_compiler`), which its file names: they
are loaded before it. A process can say which versions it has in the end, so that the next one loads
all of them without first calling what needs them.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import hashlib
import os
import pickle
import sys
import tempfile
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from placement_planner_ros.core.disk_cache import TROUBLES, seal_content, unseal_content
from placement_planner_ros.core.kernel_compiler import KernelLibrary, is_long, note_long

_Maker = tuple[str, str]
"""What compiles and loads versions of a kernel: whether for Python or for kernels, and its name."""

_MAKERS: weakref.WeakValueDictionary[_Maker, Any] = weakref.WeakValueDictionary()
"""numba's dispatchers."""

_MADE: dict[str, tuple[_Maker, object]] = {}
"""For the symbol of each version in this process: what makes it, for which arguments."""

_CLAIMED: dict[Path, IO[bytes]] | None = None
"""The versions that this process compiles while others wait for them; None where none does."""


class KernelCache:
    """The versions of one kernel, as numba's dispatcher asks for them.

    Args:
        function: what is compiled.
        kind: whether to be called from Python or from kernels.
        folder: for the kernels of its file, made once it is needed; empty where there is none.
    """

    def __init__(self, function: Callable[..., Any], kind: str, folder: str) -> None:
        self._code = function.__code__
        self._cells = [cell.cell_contents for cell in function.__closure__ or ()]
        self._name = f"{function.__qualname__}-{self._code.co_firstlineno}"
        self._kind = kind
        self._maker = (kind, f"{function.__module__}.{self._name}")
        self._folder = folder
        self._enabled = bool(folder)

    def serve(self, dispatcher: Any) -> None:
        """Be the cache of a dispatcher of numba's."""
        dispatcher._cache = self
        _MAKERS[self._maker] = dispatcher

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

    def keeps(self, signature: object, target_context: Any) -> bool:
        """Whether the version for these arguments is on disk, and whole."""
        path = self._path(signature, target_context.codegen())
        try:
            return self._enabled and bool(unseal_content(path.read_bytes(), path.name))
        except (OSError, ValueError):
            return False

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
        _refresh_numba(target_context)
        if not self._enabled:
            return None
        path = self._path(signature, target_context.codegen())
        found = self._load(path, signature, target_context)
        if found is None and _claim_file(path):
            found = self._load(path, signature, target_context)  # made by another meanwhile
            if found is not None:
                _give_back(path)
        return found

    def _load(self, path: Path, signature: object, target_context: Any) -> Any:
        try:
            content = path.read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            words = f"kernels in {self._folder} cannot be read and are compiled: {error.strerror}"
            TROUBLES.note("unread", words)
            return None
        try:
            called, long, *parts = _unpacked_parts(content, path.name)
            if not _load_all(called, target_context):
                return None
            compiled = CompileResult._rebuild(_Kernels(target_context), *parts)
            compiled = compiled._replace(target_context=target_context)
            self._note(signature, compiled, long)
            return compiled
        except Exception:  # whatever a damaged file, or one of another make, leads to
            TROUBLES.note("damaged", f"{path} is damaged; that kernel is compiled anew")
            with contextlib.suppress(OSError):
                path.unlink()
            return None

    def save_overload(self, signature: object, compiled: Any) -> None:
        """Keep that version, where there is room for it."""
        long = is_long(compiled)
        self._note(signature, compiled, long)
        if not self._enabled or compiled.lifted or compiled.library.has_dynamic_globals:
            return
        path = self._path(signature, compiled.codegen)
        try:
            called = _called_by(compiled)
            write_whole(path, _packed_parts((called, long, *compiled._reduce()), path.name))
        except OSError as error:
            TROUBLES.note(
                "unwritten",
                f"kernels cannot be kept in {self._folder}: {error.strerror or error}; each start "
                "compiles them again until NUMBA_CACHE_DIR or XDG_CACHE_HOME names a folder that "
                "can be written",
            )
        finally:
            _give_back(path)

    def _note(self, signature: object, compiled: Any, long: bool) -> None:
        _MADE[compiled.fndesc.llvm_func_name] = (self._maker, signature)
        if long:
            note_long(compiled.library)

    def _path(self, signature: object, codegen: Any) -> Path:
        state = (self._kind, str(signature), codegen.magic_tuple(), sys.implementation.cache_tag)
        digest = hashlib.sha256(repr(state).encode() + self._code.co_code + dumps(self._cells))
        return Path(self._folder) / f"{self._name}.{digest.hexdigest()[:24]}.nbk"


def claim_versions() -> None:
    """From now on, wait where another process that does so compiles the same version."""
    global _CLAIMED
    _CLAIMED = {}


def _claim_file(path: Path) -> bool:
    """Have others wait until `_give_back`, after those that came first; False where none waits.

    No two processes wait for each other: who has claimed a kernel waits for what that calls only,
    and no kernel calls itself through others.
    """
    if _CLAIMED is None or path in _CLAIMED:
        return False
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        claim = path.with_suffix(".claim").open("wb")
        fcntl.flock(claim, fcntl.LOCK_EX)
    except OSError:  # then both compile it
        return False
    _CLAIMED[path] = claim
    return True


def _give_back(path: Path) -> None:
    claim = None if _CLAIMED is None else _CLAIMED.pop(path, None)
    if claim is not None:
        path.with_suffix(".claim").unlink(missing_ok=True)
        claim.close()


class _Kernels:
    """Numba's target context, but that what is loaded with it is kernels."""

    def __init__(self, target_context: Any) -> None:
        self._given = target_context

    def codegen(self) -> _Kernels:
        """What loads machine code."""
        return self

    def unserialize_library(self, state: Any) -> KernelLibrary:
        """A kernel's machine code."""
        return KernelLibrary._unserialize(self._given.codegen(), state)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._given, name)


@functools.cache
def _refresh_numba(target_context: Any) -> None:
    """Know numba's own functions, once: before it compiles, numba does so itself."""
    target_context.refresh()


def kernel_versions(of: str) -> bytes:
    """Which versions of kernels this process has, for `load_kernels`.

    Args:
        of: how the names of their modules begin.
    """
    made = [(maker, signature) for maker, signature in _MADE.values() if maker[1].startswith(of)]
    return dumps(sorted(made, key=repr))


def load_kernels(versions: bytes) -> bool:
    """Have all these versions, from disk.

    Args:
        versions: of kernels whose modules are imported, as `kernel_versions` said.

    Returns:
        whether all of them are there; if not, none is loaded.
    """
    made: list[tuple[_Maker, Any]] = pickle.loads(versions)
    if not all(_is_there(maker, signature) for maker, signature in made):
        return False
    for maker, signature in made:
        _MAKERS[maker].compile(signature)
    return True


def _is_there(maker: _Maker, signature: Any) -> bool:
    """Whether that version is loaded, or on disk and whole."""
    dispatcher = _MAKERS.get(maker)
    return dispatcher is not None and (
        signature in dispatcher.overloads
        or dispatcher._cache.keeps(signature, dispatcher.targetctx)
    )


_Called = dict[str, tuple[_Maker, object]]


def _called_by(compiled: Any) -> _Called:
    """The kernels that the machine code of a kernel calls, by their symbols."""
    functions = compiled.library._final_module.functions
    return {f.name: _MADE[f.name] for f in functions if f.is_declaration and f.name in _MADE}


def _load_all(called: _Called, target_context: Any) -> bool:
    """Whether all these are there now; code that calls what is not there would end the process."""
    engine = target_context.codegen()._engine
    for symbol, (maker, signature) in called.items():
        dispatcher = _MAKERS.get(maker)
        if dispatcher is None:
            return False
        dispatcher.compile(signature)
        if not engine.is_symbol_defined(symbol):
            return False
    return True


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


def _packed_parts(parts: tuple[Any, ...], name: str) -> bytes:
    return seal_content(dumps(parts), name)


def _unpacked_parts(content: bytes, name: str) -> tuple[Any, ...]:
    """What was packed for the file of that name.

    Machine code that lost a block, or of another kernel, would end the process once it is run.

    Raises:
        ValueError: it is not as it was written there.
    """
    parts: tuple[Any, ...] = pickle.loads(unseal_content(content, name))
    return parts
