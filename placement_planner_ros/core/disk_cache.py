"""Results on disk for the next process, by `joblib.Memory`: never needed, and checked when read.

A result is found by its key, which is a digest of all that it depends on: the content that it is
made of, and the code that makes it (`code_digest`). So what older code made is not found; it goes
when the folder is full, what was used longest ago first. Files are written aside and moved into
place, so that processes that write at once do not harm each other. They are compressed, and so
hold a checksum, since a file may lose a block. They are pickled: only a folder that belongs to the
user is read.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import logging
import os
import pickle
import re
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import Any, TypeVar

import joblib
import numpy as np
import scipy

Result = TypeVar("Result")

MAX_BYTES = 1_000_000_000
"""That results of one kind may take on disk: an object of 200,000 triangles takes 35 MB."""

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
            digest.update(f"{part.dtype} {part.shape} ".encode() + part.tobytes())
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
        make: makes it; what it raises ends it.
    """
    result: Result | None = find_result(kind, key)
    if result is None:
        result = make()
        keep_result(kind, key, result)
    return result


def recalled_result(kind: str, key: str, make: Callable[[], Result]) -> Result:
    """A `stored_result` that is small and asked for again and again: this process remembers it."""
    if _BYPASSED.get():
        return make()
    # From memory, else from disk, else made.
    held = _recalled_results(kind, key)
    if not held:
        held.append(stored_result(kind, key, make))
    result: Result = held[0]
    return result


@functools.lru_cache(maxsize=MAX_RECALLED)
def _recalled_results(kind: str, key: str) -> list[Any]:
    """Where that result is kept in memory: nothing as long as there is none."""
    return []


def find_result(kind: str, key: str) -> Any:
    """The result that was kept of that kind and key; None where there is none."""
    results = _results_of_kind(kind)
    return None if results is None else results.find(key)


def keep_result(kind: str, key: str, result: object) -> None:
    """Keep a result, which is not None, for `find_result`; arrays that are read-only stay so."""
    results = _results_of_kind(kind)
    if results is not None:
        results.keep(key, pickle.dumps(result, protocol=5))


_BYPASSED: ContextVar[bool] = ContextVar("bypassed", default=False)


@contextlib.contextmanager
def bypassed_cache() -> Iterator[None]:
    """Meanwhile all results are made, and none is found or kept."""
    before = _BYPASSED.set(True)
    try:
        yield
    finally:
        _BYPASSED.reset(before)


def _kept_content(key: str, content: bytes | None) -> bytes:
    """What joblib keeps by its key; to ask for what is not there is to give None."""
    if content is None:
        raise LookupError(key)
    return content


class _Results:
    """Results of one kind.

    Raises:
        OSError: their folder cannot be made or written, or is another user's.
    """

    def __init__(self, kind: str, folder: Path) -> None:
        # Others could have what they like unpickled.
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if folder.stat().st_uid != os.geteuid():
            raise PermissionError("it belongs to another user")
        self._kind = kind
        self._folder = folder
        self._memory = joblib.Memory(folder, verbose=0, compress=1)
        self._kept = self._memory.cache(_kept_content, ignore=["content"])
        # So that the first that is kept has the folder looked at.
        self._unlimited = MAX_BYTES
        with contextlib.suppress(LookupError):  # has joblib write down whose results these are
            self._kept("", None)

    def find(self, key: str) -> Any:
        try:
            # As it was kept, or not at all.
            return pickle.loads(self._kept(key, None))
        except OSError as error:
            _note_unwritten(self._kind, self._folder, error)
        except (LookupError, ValueError, pickle.UnpicklingError):
            if self._kept.check_call_in_cache(key, None):
                words = f"one of the {self._kind} in {self._folder} is damaged and made anew"
                TROUBLES.note("results damaged", words)
        return None

    def keep(self, key: str, content: bytes) -> None:
        try:
            # Then looked at whether it is there: joblib only warns.
            self._kept.call(key, content)
            self._limit(len(content))
            if not self._kept.check_call_in_cache(key, None):
                raise OSError("it is full or read-only")
        except OSError as error:
            _note_unwritten(self._kind, self._folder, error)

    def _limit(self, added: int) -> None:
        """Keep to `MAX_BYTES`, looking at all files now and then: others write there, too."""
        # A tenth of what there may be, then all files are counted.
        self._unlimited += added
        if self._unlimited > 0.1 * MAX_BYTES:
            self._memory.reduce_size(bytes_limit=MAX_BYTES)
            self._unlimited = 0


def _results_of_kind(kind: str) -> _Results | None:
    folder = cache_folder()
    if folder is None or _BYPASSED.get():
        return None
    return _open_results(kind, folder / "results" / kind.replace(" ", "-"))


@functools.lru_cache(maxsize=64)
def _open_results(kind: str, folder: Path) -> _Results | None:
    try:
        return _Results(kind, folder)
    except OSError as error:
        _note_unwritten(kind, folder, error)
        return None


def _note_unwritten(kind: str, folder: Path, error: OSError) -> None:
    TROUBLES.note(
        "results unwritten",
        f"what takes long, such as {kind}, cannot be kept in {folder}: "
        f"{error.strerror or error}; each start makes it again until XDG_CACHE_HOME "
        "names a folder that can be written",
    )
