"""Compilation of kernels, and the folder where what was compiled is kept.

Every kernel is cached in a folder named after the state of the file that holds it and of all files
with kernels, or with named tuples that kernels take, that it imports. Numba itself only notices
changes in the file that holds a kernel, not in what it calls from other files, and would go on
using what was compiled from an older version of those. The folder lies in NUMBA_CACHE_DIR, in
XDG_CACHE_HOME or in ~/.cache; where other packages keep their kernels stays as it is. How they
are kept there says `kernel_cache`.

Lean kernels are compiled without numba's reference counts. Arrays that are handed to a kernel
belong to its caller, yet numba counts a reference to each of them, those within tuples too: with
the tuples of the collision check that takes longer than most of its calls. Kernels that make no
array, not even for a while, can go without.

A kernel is compiled once for its kinds of arguments: numba would compile it anew for each constant
that another kernel calls it with, and for each first value of a loop, which is a constant too.
"""

from __future__ import annotations

import functools
import hashlib
import inspect
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core.options import DefaultOptions
from numba.core.registry import cpu_target
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature
from numba.core.types import unliteral

from placement_planner_ros.core.disk_cache import TROUBLES, cache_folder
from placement_planner_ros.core.kernel_cache import KernelCache
from placement_planner_ros.core.kernel_compiler import NAMES, KernelCompiler

_F = TypeVar("_F", bound=Callable[..., Any])
_PACKAGE = Path(__file__).parents[1]
_IMPORT = re.compile(rf"^\s*from {_PACKAGE.name}([.\w]*) import (\([^)]*|.*)", re.MULTILINE)
_SHAPING = re.compile(r"@kernel\(|NamedTuple\)")
UNCOUNTED: dict[str, Any] = {"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {}
"""What makes a kernel lean; empty, and lean kernels like others, where numba does not know it."""


_COMPILER = tuple(Path(__file__).with_name(f"kernel{name}.py") for name in ("_cache", "_compiler"))
"""What shapes the files of all kernels."""

_KERNELS: list[tuple[str, KernelCache]] = []
"""Module and cache of each kernel that is compiled by itself."""


def not_kept() -> tuple[list[str], int]:
    """Which of the core's kernels, as far as they are imported, are on disk in no version.

    Returns:
        their names, and how many kernels there are.
    """
    core = _of_core()
    return [cache.name for cache in core if not cache.is_kept], len(core)


def forget_all() -> None:
    """Remove all versions of the core's kernels from disk.

    Raises:
        OSError: one cannot be removed.
    """
    for cache in _of_core():
        cache.flush()


def version_of_kernels() -> str:
    """Of all kernels of the core, this Python and this processor, in a few characters."""
    names = sorted({Path(cache.cache_path).name for cache in _of_core()})
    machine = (cpu_target.target_context.codegen().magic_tuple(), sys.implementation.cache_tag)
    return hashlib.sha256(repr((names, machine)).encode()).hexdigest()[:16]


def _of_core() -> list[KernelCache]:
    return [cache for module, cache in _KERNELS if module.startswith(f"{_PACKAGE.name}.core.")]


def kernel(*, lean: bool = False, nogil: bool = False, inline: bool = False) -> Callable[[_F], _F]:
    """`numba.njit`, its result kept on disk for the next process.

    Args:
        lean: without reference counts; it does not compile what makes arrays.
        nogil: other threads run while it does.
        inline: written into its callers.
    """
    # The wrapper for callers in C, of whom there are none, would only take time to compile.
    options: dict[str, Any] = {
        "nogil": nogil,
        "no_cfunc_wrapper": True,
        "pipeline_class": KernelCompiler,
        **(UNCOUNTED if lean else {}),
    }
    if inline:
        options["inline"] = "always"

    def decorate(function: _F) -> _F:
        file = inspect.getfile(function)
        called = _Kernel(function, options, _cache_folder(file))
        NAMES[function] = _kernel_name(function, file)
        if not inline:
            _KERNELS.append((function.__module__, called.compiled._cache))
        return cast(_F, called.compiled)

    return decorate


class _Kernel:
    """A function compiled for Python, and once more for the kernels that call it.

    Those need no wrapper around it that takes apart what Python gives, which takes a fifth of the
    time to compile.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any], folder: str) -> None:
        self.compiled: Any = numba.njit(**options)(function)
        self._inner: Any = numba.njit(**{**options, "no_cpython_wrapper": True})(function)
        KernelCache(function, "python", folder).serve(self.compiled)
        KernelCache(function, "kernels", folder).serve(self._inner)
        self._own_overload = self.compiled.get_overload
        self._own_template = self.compiled.get_call_template
        self.compiled.get_call_template = self._template
        self.compiled.get_overload = self._overload
        self.compiled.inner = self._inner

    def _template(self, args: Any, kws: Any) -> Any:
        """What numba types a kernel's call with."""
        args = [unliteral(a) for a in args]
        kws = {name: unliteral(a) for name, a in kws.items()}
        if self._is_there(args, kws):
            return self._own_template(args, kws)
        return self._inner.get_call_template(args, kws)

    def _is_there(self, args: Any, kws: Any) -> bool:
        """Whether the version for Python is there already."""
        _, args = self.compiled._compiler.fold_argument_types(tuple(args), kws)
        signature = tuple(args)
        if signature in self._inner.overloads:
            return False
        return signature in self.compiled.overloads or self.compiled._cache.keeps(
            signature, self.compiled.targetctx
        )

    def _overload(self, signature: Any) -> Any:
        """What numba calls in a kernel that it has typed."""
        if tuple(normalize_signature(signature)[0]) in self._inner.overloads:
            return self._inner.get_overload(signature)
        return self._own_overload(signature)


def _kernel_name(function: Callable[..., Any], file: str) -> str:
    """What tells it from all other kernels, and is the same in each process."""
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    own = (function.__module__, function.__qualname__, function.__code__.co_firstlineno)
    digest = hashlib.sha256(_source_state(file).encode() + repr(own).encode())
    digest.update(function.__code__.co_code + dumps(cells))
    return digest.hexdigest()[:16]


@functools.cache
def _cache_folder(file: str) -> str:
    """For the kernels in `file`, as long as these and all they call stay as they are.

    Empty where there is neither a cache nor a home.
    """
    caches = _kernel_caches()
    if caches is None:
        return ""
    return str(caches / f"{Path(file).stem}-{_source_state(file)}")


@functools.cache
def _source_state(file: str) -> str:
    """Of that file, of all it calls and of what compiles and keeps it."""
    # Kernels that look whether each index is within its array are others.
    looks = getattr(numba.config, "BOUNDSCHECK", None)
    digest = hashlib.sha256(repr((numba.__version__, looks)).encode())
    for path in (*_COMPILER, *sorted(_imported_files(Path(file), {}))):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _kernel_caches() -> Path | None:
    caches = cache_folder()
    if caches is None:
        TROUBLES.note(
            "unwritten",
            "kernels are not kept, for there is no home folder; each start compiles them again "
            "until NUMBA_CACHE_DIR, XDG_CACHE_HOME or HOME names a folder",
        )
    return caches


def _imported_files(path: Path, found: dict[Path, None]) -> dict[Path, None]:
    """`path` and what it imports, itself or through others, as far as it shapes kernels."""
    found[path] = None
    for file in _kernel_imports(path):
        if file not in found:
            _imported_files(file, found)
    return found


@functools.cache
def _kernel_imports(path: Path) -> list[Path]:
    """The files with kernels, or with what they take, that `path` itself imports."""
    found: list[Path] = []
    for module, names in _IMPORT.findall(_source_text(path)):
        target = _PACKAGE.joinpath(*module.split(".")[1:])
        files = _imported_modules(target, names) if target.is_dir() else [target.with_suffix(".py")]
        found += [file for file in files if _shapes_kernels(file)]
    return found


def _imported_modules(folder: Path, names: str) -> list[Path]:
    """Those that are imported from a package; all of it where a name is not that of a module."""
    files = [folder / f"{name}.py" for name in re.findall(r"\w+", names)]
    return files if all(file.is_file() for file in files) else sorted(folder.glob("*.py"))


@functools.cache
def _shapes_kernels(file: Path) -> bool:
    return bool(_SHAPING.search(_source_text(file)))


@functools.cache
def _source_text(path: Path) -> str:
    return path.read_text(encoding="utf-8")
