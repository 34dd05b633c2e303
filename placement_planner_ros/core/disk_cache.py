"""Results on disk for the next process, by `joblib.Memory`: never needed, and checked when read.

A result is found by its key, which is a digest of all that it depends on: the content that it is
made of, and the code that makes it (`code_digest`). So what older code made is not found; it goes
where there is too much, what was used longest ago first. joblib moves files into place, so that
processes that write at once do not harm each other, and makes anew what it cannot load, and says
so; compressed files hold a checksum. They are pickled: only a folder that belongs to the user is
read.
"""

from __future__ import annotations

import functools
import hashlib
import logging
import os
import pickle
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import joblib
import numpy as np
import scipy

Result = TypeVar("Result")

MAX_BYTES = 1_000_000_000
"""That results may take on disk when a process begins; of 200,000 triangles they take 35 MB."""

MAX_RECALLED = 1024
"""Results of all kinds that `recalled_result` remembers: shapes of a few robots."""

_PACKAGE = Path(__file__).parents[1]
_IMPORT = re.compile(rf"^\s*from ({_PACKAGE.name}[.\w]*) import", re.MULTILINE)


class Troubles:
    """What keeps files from being kept or read, each kind said once."""

    def __init__(self) -> None:
        self._known: dict[str, str] = {}
        self._listener: Callable[[str], None] = logging.getLogger(__name__).warning

    def listen(self, listener: Callable[[str], None]) -> None:
        """Call this with words for each trouble there was so far, and for each that comes, instead
        of logging them."""
        self._listener = listener
        for words in list(self._known.values()):
            listener(words)

    def note(self, trouble: str, words: str) -> None:
        """There is trouble of that kind."""
        if trouble not in self._known:
            self._known[trouble] = words
            self._listener(words)


TROUBLES = Troubles()
"""Of this process."""


def cache_folder() -> Path | None:
    """One below XDG_CACHE_HOME or ~/.cache; None where there is no home."""
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / _PACKAGE.name
    except RuntimeError:
        return None


def digest_of(*parts: object) -> str:
    """A digest of parts in order: of arrays and bytes their content, of tuples that of each of
    theirs, of all else its `repr`."""
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            digest.update(f"{part.dtype.str} {part.shape} ".encode() + part.tobytes())
        elif isinstance(part, bytes):
            digest.update(f"{len(part)} ".encode() + part)
        elif isinstance(part, tuple):
            digest.update(digest_of(*part).encode())
        else:
            digest.update(f"{part!r} ".encode())
    return digest.hexdigest()


@functools.cache
def code_digest(module: str) -> str:
    """A digest of a module of this package, of all that it imports from there, itself or through
    others, and of the libraries that results are made with.

    Args:
        module: its `__name__`.
    """
    # The module, and all that it leads to.
    contents: dict[Path, bytes] = {}
    waiting = [_file_of(module)]
    while waiting:
        file = waiting.pop()
        if file not in contents:
            contents[file] = file.read_bytes()
            waiting += _imported_modules(file)
    return digest_of(np.__version__, scipy.__version__, *(contents[f] for f in sorted(contents)))


@functools.cache
def _imported_modules(file: Path) -> list[Path]:
    """The modules of this package that a file imports; all of a folder where it names that."""
    found: list[Path] = []
    for module in _IMPORT.findall(file.read_text(encoding="utf-8")):
        other = _file_of(module)
        found += [other] if other.is_file() else sorted(other.with_suffix("").glob("*.py"))
    return found


def _file_of(module: str) -> Path:
    return _PACKAGE.parent.joinpath(*module.split(".")).with_suffix(".py")


def stored_result(kind: str, key: str, make: Callable[[], Result]) -> Result:
    """The result of that kind and key from disk, or made and kept there.

    Args:
        kind: in words, such as `convex covers`.
        key: of all that it depends on (`digest_of`).
        make: makes it; what it raises ends it. Arrays that are read-only stay so.
    """
    kept = _opened_results(cache_folder())
    if kept is None:
        return make()
    result: Result = pickle.loads(kept(kind, key, make))
    return result


def recalled_result(kind: str, key: str, make: Callable[[], Result]) -> Result:
    """A `stored_result` that is small and asked for again and again: this process remembers it."""
    held = _recalled_results(kind, key)
    if not held:
        held.append(stored_result(kind, key, make))
    result: Result = held[0]
    return result


@functools.lru_cache(maxsize=MAX_RECALLED)
def _recalled_results(kind: str, key: str) -> list[Any]:
    """Where that result is kept in memory: nothing as long as there is none."""
    return []


@functools.lru_cache(maxsize=8)
def _opened_results(folder: Path | None) -> Callable[..., bytes] | None:
    """`_pickled_result`, what it returns being kept on disk; None where that cannot be."""
    if folder is None:
        return None
    place = folder / "results"
    try:
        # Others could have what they like unpickled.
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        if place.stat().st_uid != os.geteuid():
            raise PermissionError("it belongs to another user")
        memory = joblib.Memory(place, verbose=0, compress=1)
        memory.reduce_size(bytes_limit=MAX_BYTES)
        kept: Callable[..., bytes] = memory.cache(_pickled_result, ignore=["make"])
        kept("", "", lambda: None)  # has joblib write down whose results these are
    except OSError as error:
        TROUBLES.note(
            "results unwritten",
            f"what takes long, such as convex covers, cannot be kept in {place}: "
            f"{error.strerror or error}; each start makes it again until XDG_CACHE_HOME names a "
            "folder that can be written",
        )
        return None
    return kept


def _pickled_result(kind: str, key: str, make: Callable[[], Any]) -> bytes:
    """What joblib keeps by kind and key; it would make all arrays writeable."""
    return pickle.dumps(make(), protocol=5)
